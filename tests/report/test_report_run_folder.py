import numpy as np
import pytest

from deckline.report.overlay import Panels
from deckline.report.run_folder import PictureSample

SMALL = Panels(np.zeros((8, 8, 3), dtype=np.uint8), np.zeros((8, 8, 3), dtype=np.uint8))


@pytest.mark.parametrize("count", [1, 7, 8, 9, 100, 1000])
def test_pictures_are_few_and_evenly_spread_however_long_the_run(tmp_path, count):
    sample = PictureSample(tmp_path / "pictures", most=8)
    for index in range(count):
        sample.add(index, SMALL)
    kept = sample.kept()
    assert len(kept) <= 8
    assert len(kept) >= min(count, 4)
    assert kept[0] == 0
    assert len(set(np.diff(kept))) <= 1
    assert len(list((tmp_path / "pictures").iterdir())) == 2 * len(kept)
    assert all(jpeg.startswith(b"\xff\xd8") for index in kept for jpeg in sample.read(index))


def test_a_sample_taken_over_goes_on_as_if_never_stopped(tmp_path):
    whole, stopped = PictureSample(tmp_path / "a", most=8), PictureSample(tmp_path / "b", most=8)
    for index in range(50):
        whole.add(index, SMALL)
        if index == 30:
            stopped = PictureSample(tmp_path / "b", most=8)
        stopped.add(index, SMALL)
    assert stopped.kept() == whole.kept()

    with pytest.raises(ValueError, match=r"pictures.* 1"):
        PictureSample(tmp_path, most=1)
