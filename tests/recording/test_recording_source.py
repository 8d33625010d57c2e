"""Frames that are read while the ones before are used."""

import threading

import pytest

from deckline.recording.source import BadFrame, read_ahead

ITEMS = [BadFrame(f"{number}.png", "") for number in range(5)]


def test_all_items_come_in_their_order():
    assert list(read_ahead(iter(ITEMS))) == ITEMS
    assert list(read_ahead(iter([]))) == []


def test_the_next_item_is_read_while_one_is_used_and_no_later_one():
    taken, second = [], threading.Event()

    def items():
        for item in ITEMS:
            taken.append(item)
            if len(taken) == 2:
                second.set()
            yield item

    ahead = read_ahead(items())
    next(ahead)
    assert second.wait(10.0)
    assert taken == ITEMS[:2]
    ahead.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("read")]


def test_an_error_comes_where_its_item_would():
    def items():
        yield ITEMS[0]
        raise ValueError("no more")

    ahead = read_ahead(items())
    assert next(ahead) == ITEMS[0]
    with pytest.raises(ValueError, match="no more"):
        next(ahead)
