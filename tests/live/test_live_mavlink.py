"""Guidance to an autopilot and poses from it, over the loopback."""

import socket
import sys
import threading
import time
from contextlib import closing, contextmanager
from dataclasses import replace

import numpy as np
import pytest
from autopilot import FIRMWARES, Autopilot
from loopback import CONFIG, MOUNTED, SHOWN, Sender, detect, free_port, wait_until
from pymavlink.dialects.v20 import common as mavlink

from approach_scene import frame
from deckline.adapters.mavlink.link import Link, parse_datagram
from deckline.adapters.mavlink.messages import TEXT_LENGTH, describe, landing_target, ship_beacon, status_text
from deckline.adapters.mavlink.timesync import TOLERANCE_NS, ClockOffset
from deckline.cli.main import main
from deckline.config import Navigation
from deckline.flight import Flight
from deckline.live.clock import WallClock
from deckline.live.messages import Answer, FrameCounts, answer_record
from deckline.live.opening import open_camera
from deckline.live.pipeline import LiveSession, Outputs
from deckline.recording import RecordingError
from deckline.recording.geodesy import ecef_from_geodetic, ecef_from_ned, geodetic_from_ned
from deckline.types import Reason, Status
from picture_scene import picture_result

# A stated width and a checked mounting: guidance of a hovering aircraft becomes `ok`.
WIDE = replace(
    CONFIG,
    deck=replace(CONFIG.deck, width_m=16.0),
    integrity=replace(CONFIG.integrity, mount_yaw_deg=1.0),
)
PROGRESS, WALL = FrameCounts(), WallClock()
TARGET_M = np.array([70.0, 0.0, -20.0])  # of a runway along world x from 0


def answers(count=8, step_s=0.1):
    """Answers about an aircraft that hovers before a deck of a known width; the last ones are `ok`."""
    flight, start_s = Flight.from_config(WIDE, detector=detect), time.monotonic()
    for index in range(count):
        result = flight(replace(SHOWN, time_s=step_s * index))
        yield Answer(result, flight.tracker.forecast(), start_s + step_s * index)


LAST = list(answers())[-1]


def ok_record():
    """The last answer as if its picture were of now."""
    now_s = time.monotonic()
    return answer_record(replace(LAST, at_s=now_s), PROGRESS, now_s, WALL.at(0.0), 0.2, WIDE.approach)


@contextmanager
def linked(firmware="px4", navigation=None, **options):
    """A link, its autopilot and its log lines."""
    port, lines = free_port(), []
    link = Link(f"udp:127.0.0.1:{port}", firmware, navigation or Navigation(), WALL, lines.append, True)
    with closing(link), Autopilot(port, firmware, **options) as autopilot:
        yield link, autopilot, lines


def send_for(link, make, seconds=0.5, rate_hz=30):
    for _ in range(round(seconds * rate_hz)):
        link.send(make())
        time.sleep(1 / rate_hz)


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_each_firmware_takes_the_target_as_it_is_sent(firmware):
    with linked(firmware) as (link, autopilot, lines):
        wait_until(lambda: lines and autopilot.answers > 2)
        send_for(link, ok_record)
        wait_until(lambda: len(autopilot.receiver.targets) == link.sent)
        targets = autopilot.receiver.targets
        wanted = TARGET_M if firmware == "px4" else SHOWN.world_from_body.inv().apply(TARGET_M)
        for target, age_us in targets:
            np.testing.assert_allclose(target, wanted, atol=2.0)
            assert -5e3 < age_us < 200e3  # in the autopilot's clock, sent a moment ago
        assert not autopilot.receiver.errors and autopilot.texts == ["deckline ok"]
        assert lines == [line for line in lines if "serving system 7" in line]


def test_a_stream_flown_by_the_autopilots_poses_gives_it_targets_until_the_wire_is_cut():
    port = free_port()
    with linked() as (link, autopilot, lines):
        camera = open_camera(f"udp://127.0.0.1:{port}", MOUNTED, WALL, log=lines.append)
        outputs = Outputs(link.send, lines.append)
        flight = Flight.from_config(WIDE, detector=detect)
        session = LiveSession(camera, flight, outputs, poses=link, wall=WALL, stale_s=1.0)
        thread = threading.Thread(target=session.run)
        thread.start()
        try:
            with Sender(port):
                wait_until(lambda: len(autopilot.receiver.targets) > 5 and autopilot.texts[-1] == "deckline ok")
            wait_until(lambda: autopilot.texts[-1].startswith("deckline stale"))
        finally:
            session.stop()
            thread.join()
        np.testing.assert_allclose(autopilot.receiver.targets[-1][0], TARGET_M, atol=10.0)
        assert link.sent <= session.counts["ok"]


def test_only_ok_has_a_target():
    record = ok_record()
    for status in set(Status) - {Status.OK}:
        other = record | {"status": str(status), "flags": [{"name": "other lines", "reason": ""}] * 9}
        assert landing_target(other, "px4") is None and ship_beacon(other, (0.0, 0.0, 0.0)) is None
        text = status_text(other, 12.34, "px4")
        assert text.text == f"deckline {status}: other lines 12.3 s"
        assert text.severity == mavlink.MAV_SEVERITY_WARNING
    assert describe(record | {"live": record["live"] | {"touchdown": None}}, "px4") == "ok: no touchdown point"
    assert status_text(record, 0.1, "px4").severity == mavlink.MAV_SEVERITY_INFO


def reason_lists():
    """Each reason alone, each two, and longer and longer lists that begin with each."""
    reasons = [str(reason) for reason in Reason]
    for first, _ in enumerate(reasons):
        turned = reasons[first:] + reasons[:first]
        yield from (turned[:count] for count in range(1, len(turned) + 1))
        yield from ([reasons[first], other] for other in reasons)


@pytest.mark.parametrize("status", sorted(set(Status) - {Status.OK}))
@pytest.mark.parametrize("silent_s", [None, 0.1, 98.97, 123456.7])
@pytest.mark.parametrize("kind", ["flags", "reasons"])
def test_no_text_is_cut_within_a_word(status, silent_s, kind):
    age = {None: "", 0.1: " 0.1 s", 98.97: " 99.0 s", 123456.7: " >99 s"}[silent_s]
    for names in reason_lists():
        flags = [{"name": name, "reason": ""} for name in names if kind == "flags"]
        text = status_text({"status": str(status), "flags": flags, "reasons": names}, silent_s, "px4").text
        assert len(text) <= TEXT_LENGTH and text.endswith(age)
        head, _, listed = text.removesuffix(age).partition(": ")
        listed, _, left_out = listed.partition(" +")
        shown = listed.split(", ") if listed else []
        known = [name for name in dict.fromkeys(names) if kind == "flags" or name != status]
        assert head == f"deckline {status}" and shown == known[: len(shown)]
        if shown:
            assert len(shown) + int(left_out or 0) == len(known)
        else:
            assert known in ([], [status])


@pytest.mark.parametrize("lost", [0.0, 0.3])
def test_poses_come_in_by_the_autopilots_clock_over_a_wire_that_loses_and_swaps(lost):
    with linked(lost=lost) as (link, autopilot, _):
        wait_until(lambda: link(time.time() - 0.1) is not None)
        found = None
        for _ in range(50):
            found = link(time.time() - 0.1)
            if found is not None:
                break
        np.testing.assert_allclose(found.translation, SHOWN.world_from_body.translation, atol=1e-3)
        assert (found.rotation.inv() * SHOWN.world_from_body.rotation).magnitude() < 1e-5
        assert link(time.time() - 3000.0) is None
        send_for(link, ok_record)
        wait_until(lambda: autopilot.receiver.targets)
        assert autopilot.commands  # it was asked for what had not come yet


def test_a_message_that_comes_too_slowly_is_asked_for_again():
    with linked(slow=True) as (_, autopilot, _):
        wait_until(lambda: not autopilot.slow)
        assert (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20_000) in autopilot.commands


def test_a_companions_heartbeat_and_the_ships_beacon_at_the_autopilots_origin():
    with linked("ardupilot") as (link, autopilot, lines):
        wait_until(lambda: lines)
        wait_until(lambda: link._origin is not None)
        send_for(link, ok_record, 1.2)
        wait_until(lambda: autopilot.beacons and len(autopilot.heartbeats) > 1)
        message, system, component, _ = autopilot.heartbeats[-1]
        assert (system, component, message.type) == (7, 191, mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
        assert autopilot.heartbeats[-1][3] - autopilot.heartbeats[-2][3] > 0.5
        beacon = autopilot.beacons[-1]
        assert beacon.get_srcSystem() == 100 and beacon.hdg % 35999 < 100
        north_m = (1e-7 * beacon.lat - 48.0) * 111_200.0
        assert north_m == pytest.approx(70.0, abs=2.0) and beacon.alt == pytest.approx(20e3, abs=2e3)


def test_another_system_another_firmware_and_garbage_change_nothing():
    with linked() as (link, autopilot, lines):
        wait_until(lambda: lines)
        address, rng = link._socket.getsockname(), np.random.default_rng(0)
        with Autopilot(address[1], "px4", system=9) as third, Autopilot(address[1], "ardupilot", system=8) as other:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
                whole = mavlink.MAVLink(None, 7, 1)
                packed = mavlink.MAVLink_heartbeat_message(1, 12, 0, 0, 4, 3).pack(whole)
                for size in rng.integers(1, 300, 300):
                    noise.sendto(rng.bytes(size), address)
                    noise.sendto(packed[: size % len(packed)], address)
            wait_until(lambda: len(lines) == 3)
            send_for(link, ok_record, 0.3)
            wait_until(lambda: autopilot.receiver.targets)
            assert not third.receiver.targets + other.receiver.targets + third.texts + other.texts
        assert link._thread.is_alive() and [line.count("not served") for line in lines] == [0, 1, 1]


def test_messages_survive_garbage_beside_them_in_a_datagram():
    rng, packed = np.random.default_rng(1), mavlink.MAVLink_statustext_message(6, b"here").pack(mavlink.MAVLink(None))
    for data in (b"", packed[:10], b"\xfd\xff" + packed[2:10], 300 * b"\xfd", 65_000 * b"\xfe"):
        assert parse_datagram(data) == []
    for _ in range(500):
        parse_datagram(rng.bytes(100))
        spoiled = bytearray(packed)
        spoiled[rng.integers(len(packed))] ^= 255
        parse_datagram(bytes(spoiled))
    assert [message.text for message in parse_datagram(b"\x00\x01garbage" + packed)] == ["here"]


def test_the_shortest_round_trip_counts_and_a_clock_that_began_anew_is_followed():
    clock, offset = ClockOffset(), 5_000_000_000
    assert clock.offset_s is None
    for start, there, back in ((0, 1e6, 30e6), (10**9, 1e6, 1e6), (2 * 10**9, 40e6, 1e6)):
        clock.add_answer(int(start + there + offset), clock.request(start), int(start + there + back))
    assert clock.offset_s == pytest.approx(5.0, abs=1e-6)
    clock.add_answer(1, 12345, 10**10)  # nobody asked
    assert clock.offset_s == pytest.approx(5.0, abs=1e-6)
    clock.add_answer(100 + TOLERANCE_NS, clock.request(3 * 10**9), 3 * 10**9 + 200)
    assert clock.offset_s == pytest.approx(-3.0, abs=2e-3)


@pytest.mark.parametrize("distance_m", [10.0, 1e4, 1e5])
def test_latitude_and_longitude_round_trip(distance_m):
    origin, wanted = (48.0, 179.99, 500.0), distance_m * np.array([0.6, -0.8, -0.1])
    found = geodetic_from_ned(wanted, origin)[None]
    at = np.array([origin])
    back = ecef_from_ned(at)[0].inv().apply(ecef_from_geodetic(found)[0] - ecef_from_geodetic(at)[0])
    np.testing.assert_allclose(back, wanted, atol=1e-3)


@pytest.mark.parametrize("address", ["tcp:h:1", "udp:127.0.0.1", "udp:h:0", "127.0.0.1:14540"])
def test_a_wrong_address_is_named(address):
    with pytest.raises(ValueError, match=address):
        Link(address, "px4", Navigation(), WALL, print, False)


def test_an_unknown_autopilot_and_a_taken_port_are_named():
    address = f"udp:127.0.0.1:{free_port()}"
    with pytest.raises(ValueError, match="betaflight"):
        Link(address, "betaflight", Navigation(), WALL, print, False)
    with closing(Link(address, "px4", Navigation(), WALL, print, False)), pytest.raises(RecordingError, match=address):
        Link(address, "px4", Navigation(), WALL, print, False)


def test_a_missing_extra_is_named(monkeypatch, capsys):
    for name in list(sys.modules):
        if name.startswith(("pymavlink", "deckline.adapters.mavlink")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pymavlink", None)
    args = ["--mavlink", "udp:127.0.0.1:1", "--autopilot", "px4", "--dehazer", "none", "--detector", "ufld"]
    assert main(["live", "udp://127.0.0.1:5600", *args]) != 0
    assert "deckline[mavlink]" in capsys.readouterr().err


class Hovering:
    """Predicts that nothing moves."""

    def __init__(self, result):
        self._result = result

    def at(self, time_s):
        return replace(self._result.track, time_s=time_s), self._result.frame.world_from_body, 0.0


def picture_record(**scene):
    """The message about a frame whose pose is the picture's, taken 0.1 s before; in widths nothing is predicted."""
    now_s, result = time.monotonic(), picture_result(**scene)
    answer = Answer(result, None if result.frame.in_widths else Hovering(result), now_s - 0.1)
    return answer_record(answer, PROGRESS, now_s, WALL.at(0.0), 0.2, WIDE.approach)


def test_a_pose_of_the_picture_gives_a_target_in_the_body_alone():
    record = picture_record(in_widths=False, is_ok=True)
    assert record["live"]["now"]["lateral_deviation_m"]["value"] == pytest.approx(3.0, abs=0.01)
    touchdown = record["live"]["touchdown"]
    assert {name for name, value in touchdown.items() if value is not None} == {"body_m"}
    assert landing_target(record, "px4") is None and ship_beacon(record, (46.0, 7.0, 100.0)) is None
    target = landing_target(record, "ardupilot")
    assert (target.frame, target.position_valid) == (mavlink.MAV_FRAME_BODY_FRD, 1)
    wanted = frame().world_from_body.inv().apply(TARGET_M)
    np.testing.assert_allclose([target.x, target.y, target.z], wanted, atol=3.0)  # as far as the ramp is seen
    assert target.distance == pytest.approx(np.linalg.norm([target.x, target.y, target.z]))
    assert 1e-6 * target.time_usec == pytest.approx(record["live"]["sent_s"])
    assert describe(record, "ardupilot") == "ok" and describe(record, "px4") == "ok: pose of the picture, no target"
    assert status_text(record, 12.3, "px4").text == "deckline ok: pose of the picture, no target 12.3 s"


@pytest.mark.parametrize("scene", [{"in_widths": True}, {"in_widths": True, "is_ok": True}, {"in_widths": False}])
def test_without_metres_or_without_ok_a_pose_of_the_picture_has_no_target(scene):
    record = picture_record(**scene)
    assert landing_target(record, "px4") is None and landing_target(record, "ardupilot") is None
    assert record["live"]["touchdown"] is None or record["status"] == "unverified"


@pytest.mark.parametrize("firmware", FIRMWARES)
def test_only_a_firmware_that_takes_the_body_frame_receives_the_pictures_target(firmware):
    with linked(firmware) as (link, autopilot, lines):
        wait_until(lambda: lines and autopilot.answers > 2)
        send_for(link, lambda: picture_record(in_widths=False, is_ok=True))
        wait_until(lambda: len(autopilot.receiver.targets) == link.sent and autopilot.texts)
        assert (link.sent > 0) == (firmware == "ardupilot") and not autopilot.receiver.errors
        text = "deckline ok" if firmware == "ardupilot" else "deckline ok: pose of the picture, no target"
        assert autopilot.texts[0] == text
