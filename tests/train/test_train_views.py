from pathlib import Path

import numpy as np
import pytest

from deckline.recording import FrameError
from deckline.train.views import Views, make_ahead

A, B = Path("a"), Path("b")


def letters(texts: dict[Path, str], recordings: list[Path], held_out: float, train: bool = True) -> Views[str]:
    """Views of texts, in which a dash is a damaged frame and a question mark one without depth."""

    def load(path: Path, index: int) -> str:
        if texts[path][index] == "?":
            raise ValueError("no depth")
        if texts[path][index] == "-":
            raise FrameError(f"{index}.png", "damaged")
        return texts[path][index]

    return Views({path: len(text) for path, text in texts.items()}, recordings, held_out, train, load)


def test_the_end_of_every_recording_is_held_out() -> None:
    sources = {A: "abcd", B: "ef"}
    training = letters(sources, [A, B, B], 0.5)
    assert [training[k] for k in range(len(training))] == ["a", "b", "e", "e"]
    held_out = letters(sources, [A, B, B], 0.5, False)
    assert [held_out[k] for k in range(len(held_out))] == ["c", "d", "f"]
    with pytest.raises(ValueError, match=r"held-out.*a.*b"):
        letters(sources, [A, B], 0.0, False)


def test_damaged_frames_are_noted_and_others_drawn() -> None:
    views = letters({A: "a-b"}, [A], 0.0)
    rng = np.random.default_rng(0)
    assert {views.draw(rng) for _ in range(20)} == {"a", "b"}
    assert views.skipped == {"1.png": "damaged"}
    assert views.get_usable(1) is None and views.get_usable(2) == "b"
    with pytest.raises(ValueError, match=r"20.*0\.png.*damaged"):
        letters({A: "-"}, [A], 0.0).draw(rng)


def test_a_recording_that_lacks_what_training_needs_ends_it() -> None:
    views = letters({A: "abc", B: "?"}, [A, B], 0.0)
    with pytest.raises(ValueError, match="no depth"):
        [views.draw(np.random.default_rng(seed)) for seed in range(20)]


def test_batches_come_in_the_order_of_their_steps() -> None:
    assert list(make_ahead(lambda step: 10 * step, 3, 7)) == [30, 40, 50, 60, 70]
