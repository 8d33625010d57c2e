"""What threads hand to each other, and when a picture was taken."""

import threading
import time

import pytest
from loopback import wait_until

from deckline.live.clock import StreamClock
from deckline.live.mailbox import BackgroundWriter, Mailbox
from deckline.live.tally import REPORT_EVERY_S, Tally


def test_the_newest_item_wins_and_the_others_are_counted():
    box = Mailbox()
    assert box.take(0.0) is None
    for item in (1, 2, 3):
        box.put(item)
    assert (box.take(0.0), box.take(0.0), box.dropped) == (3, None, 2)


def test_the_last_item_waits_for_the_one_before():
    box, taken = Mailbox(), []
    box.put(1)
    thread = threading.Thread(target=box.put_last, args=(2, 30.0))
    thread.start()
    while len(taken) < 2:
        if (item := box.take(0.1)) is not None:
            taken.append(item)
    thread.join()
    assert (taken, box.dropped) == ([1, 2], 0)


def test_a_slow_disk_loses_items_and_says_so():
    go_on, written = threading.Event(), []

    def write(item):
        go_on.wait()
        if item == 1:
            raise OSError("disk full")
        written.append(item)

    writer = BackgroundWriter(write, 2)
    writer.offer(0)
    wait_until(lambda: writer._queue.empty())
    for item in (1, 2, 3, 4):
        writer.offer(item)
    assert writer.lost == 2  # two wait, two do not fit
    go_on.set()
    writer.close()
    assert (written, writer.lost, writer.error) == ([0, 2], 3, "disk full")


def test_losses_are_told_at_first_and_then_seldom(monkeypatch):
    now_s, lines = 100.0, []
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    tally = Tally("poses refused", lines.append)
    tally.close()
    assert not lines
    for reason in "abc":
        tally.add(reason)
    now_s += 2 * REPORT_EVERY_S
    tally.add("d")
    tally.add("e")
    assert [line.split()[0] for line in lines] == ["1", "4"]
    tally.close()
    tally.close()
    assert [line.split()[0] for line in lines] == ["1", "4", "5"]
    assert (tally.count, tally.reason) == (5, "e")


def test_a_picture_that_was_there_already_has_waited_as_long_as_its_presentation_time_says():
    clock = StreamClock()
    assert not clock.is_set
    for index in range(4):
        assert clock.capture_time(index / 30, 100.0 + index / 30, waited=True) == pytest.approx(100.0 + index / 30)
    # nobody read for half a second: fifteen pictures come at once
    captured = [clock.capture_time(index / 30, 100.6 + 1e-3 * index, waited=False) for index in range(4, 19)]
    assert captured == pytest.approx([100.0 + index / 30 for index in range(4, 19)])


def test_a_picture_that_comes_behind_a_long_silence_is_old():
    clock = StreamClock()
    for index in range(4):
        clock.capture_time(index / 30, 100.0 + index / 30, waited=True)
    assert clock.capture_time(4 / 30, 103.0, waited=True) == pytest.approx(100.0 + 4 / 30)


@pytest.mark.parametrize("presented_s", [-50.0, 5e5, None])
def test_a_presentation_clock_that_jumps_or_ends_gives_way_to_the_arrival(presented_s):
    clock = StreamClock()
    clock.capture_time(0.0, 100.0, waited=True)
    assert clock.capture_time(presented_s, 100.03, waited=True) == 100.03


def test_capture_times_ascend_and_follow_a_wrong_frame_rate():
    clock, before_s = StreamClock(), 0.0
    for index in range(300):  # states 30 pictures a second, sends 20
        arrival_s = 100.0 + index / 20
        captured_s = clock.capture_time(index / 30, arrival_s, waited=True)
        assert before_s < captured_s <= arrival_s < captured_s + 0.15
        before_s = captured_s
