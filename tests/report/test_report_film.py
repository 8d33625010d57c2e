import errno
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from approach_scene import Approach, ExactChain, chain
from deckline.dehaze import DehazeResult
from deckline.report import film
from deckline.report.film import WAITING
from deckline.report.records import read_records
from deckline.report.run import run
from deckline.types import Value

DRAW = film.draw_overlay


class Watched(ExactChain):
    """A chain that calls `watch` before each frame."""

    def __init__(self, watch):
        self._watch = watch

    def __call__(self, frame):
        self._watch(frame)
        return super().__call__(frame)


def files(out, name="guidance.jsonl"):
    return [record["file"] for record in read_records(out / name)]


def test_guidance_does_not_wait_for_the_film(tmp_path, monkeypatch):
    released = threading.Event()
    monkeypatch.setattr(film, "draw_overlay", lambda *a: (released.wait(60), DRAW(*a))[1])

    def watch(frame):
        if frame.file == f"frame_{WAITING:03d}.png":
            assert not released.is_set()
            assert len(files(tmp_path)) == WAITING
            released.set()

    assert run(Approach(WAITING + 3), Watched(watch), tmp_path).counts["unverified"] == WAITING + 3


def test_few_results_wait_for_a_slow_film(tmp_path, monkeypatch):
    flown, ahead = [], []

    def draw(frame, *rest):
        time.sleep(0.02)
        ahead.append(len(flown) - int(frame.file[6:9]))
        return DRAW(frame, *rest)

    monkeypatch.setattr(film, "draw_overlay", draw)
    run(Approach(20), Watched(lambda frame: flown.append(frame.file)), tmp_path)
    assert len(ahead) == 20
    assert max(ahead) <= WAITING + 2


def test_an_error_of_the_film_ends_the_run_which_can_be_resumed(tmp_path, monkeypatch):
    def refuse(frame, *rest):
        if frame.file == "frame_003.png":
            raise OSError(errno.ENOSPC, "no space")
        return DRAW(frame, *rest)

    monkeypatch.setattr(film, "draw_overlay", refuse)
    with pytest.raises(OSError) as refused:
        run(Approach(20), chain, tmp_path)
    assert refused.value.errno == errno.ENOSPC
    assert 4 <= len(files(tmp_path)) <= 4 + WAITING + 2
    monkeypatch.undo()
    assert run(Approach(20), chain, tmp_path, resume=True).counts["unverified"] == 20
    assert files(tmp_path) == files(tmp_path, "dehazing.jsonl") == [f"frame_{i:03d}.png" for i in range(20)]


def test_a_frame_that_the_chain_dehazes_is_not_dehazed_again(tmp_path):
    class Dehazing(ExactChain):
        def __call__(self, frame):
            result = super().__call__(frame)
            found = DehazeResult(np.full_like(frame.image_rgb, 7), visibility_m=Value(900.0, 80.0))
            return replace(result, dehazed=found, seconds={**result.seconds, "dehaze": 5.0})

    run(Approach(1), Dehazing(), tmp_path)
    (record,), (film,) = (read_records(tmp_path / name) for name in ("guidance.jsonl", "dehazing.jsonl"))
    assert (film["seconds"], record["seconds"]["dehaze"]) == (5.0, 5.0)
    assert film["visibility_m"] == record["visibility_m"] == {"value": 900.0, "sigma": 80.0}
