import numpy as np
import pytest
from recording_bytes import images

from deckline.recording import RecordingError, open_recording, select_frames


@pytest.fixture
def folder(tmp_path):
    """Eight images, half a second apart, of a clock that began at 100 s."""
    rows = "".join(f"{index}.png,{100 + index / 2}\n" for index in range(8))
    return images(tmp_path, [f"{index}.png" for index in range(8)], times="file,time_s\n" + rows)


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ({}, "01234567"),
        ({"every": 3}, "036"),
        ({"start_s": 1.0}, "234567"),
        ({"start_s": 0.75, "duration_s": 1.5}, "234"),
        ({"start_s": 1.0, "duration_s": 2.0, "every": 2}, "24"),
    ],
)
def test_frames_are_chosen_by_number_and_time(folder, options, names):
    source = select_frames(open_recording(folder), **options)
    assert "".join(frame.file[0] for frame in source) == names
    assert len(source) == source.length == len(names)
    np.testing.assert_array_equal(source.times(), [100 + int(name) / 2 for name in names])
    assert source.load(1).file == f"{names[1]}.png"
    with pytest.raises(IndexError):
        source.load(len(names))


@pytest.mark.parametrize("options", [{"every": 0}, {"start_s": -1.0}, {"duration_s": 0.0}, {"start_s": float("nan")}])
def test_options_out_of_range(folder, options):
    with pytest.raises(ValueError, match=str(next(iter(options.values())))):
        select_frames(open_recording(folder), **options)


def test_a_start_after_the_end_says_how_long_it_lasts(folder):
    with pytest.raises(RecordingError, match=r"3\.500 s.*from 9 s"):
        select_frames(open_recording(folder), start_s=9.0)
