import json
import threading
import time

import pytest

from approach_scene import Approach, chain
from deckline.report import film
from deckline.report.film import WAITING, join_dehazing
from deckline.report.run import run

DRAW = film.draw_overlay


def lines(out) -> int:
    return len((out / "guidance.jsonl").read_text(encoding="utf-8").splitlines())


def test_guidance_does_not_wait_for_the_film(tmp_path, monkeypatch):
    released = threading.Event()
    monkeypatch.setattr(film, "draw_overlay", lambda *a: (released.wait(60), DRAW(*a))[1])

    def watch(frame):
        if frame.file == f"frame_{WAITING:03d}.png":
            assert not released.is_set()
            assert lines(tmp_path) == WAITING
            released.set()
        return chain(frame)

    assert run(Approach(WAITING + 3), watch, tmp_path).counts["unverified"] == WAITING + 3


def test_few_results_wait_for_a_slow_film(tmp_path, monkeypatch):
    flown, ahead = [], []

    def draw(frame, *rest):
        time.sleep(0.02)
        ahead.append(len(flown) - int(frame.file[6:9]))
        return DRAW(frame, *rest)

    monkeypatch.setattr(film, "draw_overlay", draw)
    run(Approach(20), lambda frame: flown.append(frame.file) or chain(frame), tmp_path)
    assert len(ahead) == 20
    assert max(ahead) <= WAITING + 2


def test_an_error_of_the_film_ends_the_run_which_can_be_resumed(tmp_path, monkeypatch):
    def refuse(frame, *rest):
        if frame.file == "frame_003.png":
            raise OSError("No space left on device")
        return DRAW(frame, *rest)

    monkeypatch.setattr(film, "draw_overlay", refuse)
    with pytest.raises(OSError, match="No space left"):
        run(Approach(20), chain, tmp_path)
    assert 4 <= lines(tmp_path) <= 4 + WAITING + 2
    monkeypatch.undo()
    assert run(Approach(20), chain, tmp_path, resume=True).counts["unverified"] == 20
    records = [json.loads(line) for line in (tmp_path / "guidance.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [record["file"] for record in records] == [f"frame_{i:03d}.png" for i in range(20)]
    assert all("dehaze" in record["seconds"] for record in records)


def test_what_dehazing_told_is_joined_by_index():
    records = [{"file": name, "seconds": {}} for name in "abcd"]
    told = [{"index": index, "told": {"seconds": {"dehaze": index}}} for index in (0, 1, 2, 1, 2, 3)]
    assert list(join_dehazing(records, told)) == [{"file": n, "seconds": {"dehaze": i}} for i, n in enumerate("abcd")]
    assert list(join_dehazing(records, [told[2]])) == [
        *records[:2],
        {"file": "c", "seconds": {"dehaze": 2}},
        records[3],
    ]
