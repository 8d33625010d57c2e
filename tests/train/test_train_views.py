from pathlib import Path

import numpy as np
import pytest

from deckline.recording import FrameError
from deckline.train.views import Views, made_ahead

A, B = Path("a"), Path("b")


class Letters(Views[str, str]):
    """Views of texts, in which a dash is a damaged frame."""

    def load(self, source: str, index: int) -> str:
        if source[index] == "?":
            raise ValueError("no depth")
        if source[index] == "-":
            raise FrameError(f"{index}.png", "damaged")
        return source[index]


def test_the_end_of_every_recording_is_held_out() -> None:
    sources = {A: "abcd", B: "ef"}
    training = Letters(sources, [A, B, B], 0.5, True)
    assert [training[k] for k in range(len(training))] == ["a", "b", "e", "e"]
    held_out = Letters(sources, [A, B, B], 0.5, False)
    assert [held_out[k] for k in range(len(held_out))] == ["c", "d", "f"]
    with pytest.raises(ValueError, match="no held-out views in"):
        Letters(sources, [A, B], 0.0, False)


def test_damaged_frames_are_noted_and_others_drawn() -> None:
    views = Letters({A: "a-b"}, [A], 0.0, True)
    rng = np.random.default_rng(0)
    assert {views.draw(rng) for _ in range(20)} == {"a", "b"}
    assert views.skipped == {"1.png": "damaged"}
    assert views.usable(1) is None and views.usable(2) == "b"
    with pytest.raises(ValueError, match=r"20 frames in a row cannot be used, 0\.png as damaged"):
        Letters({A: "-"}, [A], 0.0, True).draw(rng)


def test_a_recording_that_lacks_what_training_needs_ends_it() -> None:
    views = Letters({A: "abc", B: "?"}, [A, B], 0.0, True)
    with pytest.raises(ValueError, match="no depth"):
        [views.draw(np.random.default_rng(seed)) for seed in range(20)]


def test_batches_come_in_the_order_of_their_steps() -> None:
    assert list(made_ahead(lambda step: 10 * step, 3, 7)) == [30, 40, 50, 60, 70]
