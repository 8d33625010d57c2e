import asyncio
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.recorder import Recorder, moved
from deckline.adapters.airsim.settings import Capture, default_settings
from deckline.geometry import Camera
from deckline.recording import open_recording
from deckline.types import Frame

SETTINGS = replace(default_settings(Capture(8, 6, 90.0)), interval_s=0.01)


def frame_at(number, metres):
    """A frame of its own time, so far north."""
    image = np.full((6, 8, 3), number, np.uint8)
    where = RigidTransform.from_translation([metres, 0.0, 0.0])
    return Frame(f"{number}", 100.0 + number, image, Camera.from_fov(8, 6, 1.0), world_from_body=where)


def recorded(out, settings, take, enough):
    """What a recorder says until `enough` frames were asked for, and whether it was on."""
    lines, asked = [], []

    async def frame():
        asked.append(len(asked))
        return take(asked[-1])

    async def run():
        recorder = Recorder(out, settings, frame, {"preset": "paper"}, lines.append)
        await recorder.stop()  # there is nothing to stop
        await recorder.start()
        await recorder.start()
        while len(asked) < enough and recorder.on:
            await asyncio.sleep(0.005)
        on = recorder.on
        await recorder.stop()
        assert not recorder.on
        return on

    return asyncio.run(run()), lines


def test_frames_are_whole_when_it_stops(tmp_path):
    on, lines = recorded(tmp_path, SETTINGS, lambda number: frame_at(number, float(number)), 5)
    (folder,) = tmp_path.iterdir()
    source = open_recording(folder)
    assert on and len(source) >= 4
    for index in range(len(source)):
        loaded = source.load(index)
        assert loaded.time_s == 100.0 + index and loaded.image_rgb[0, 0, 0] == index
        np.testing.assert_allclose(loaded.world_from_body.translation, [index, 0.0, 0.0])
    assert lines == [f"recording into {folder}", f"recorded {len(source)} frames into {folder}"]


def test_only_moves_count_when_they_shall(tmp_path):
    still = replace(SETTINGS, on_move=True)
    recorded(tmp_path, still, lambda number: frame_at(number, float(number // 4)), 9)
    (folder,) = tmp_path.iterdir()
    source = open_recording(folder)
    assert [source.load(index).world_from_body.translation[0] for index in range(2)] == [0.0, 1.0]
    assert len(source) <= 3


def test_two_recordings_in_one_second_have_two_folders(tmp_path):
    for _ in range(3):
        recorded(tmp_path, SETTINGS, lambda number: frame_at(number, 0.0), 1)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_picture_that_cannot_be_taken_ends_it_with_a_line(tmp_path):
    def take(number):
        if number == 2:
            raise ValueError("the camera must be above the sea")
        return frame_at(number, 0.0)

    on, lines = recorded(tmp_path, SETTINGS, take, 5)
    (folder,) = tmp_path.iterdir()
    assert not on and lines[-1] == f"recording into {folder} ended: the camera must be above the sea"
    assert len(open_recording(folder)) == 2


def test_a_folder_that_cannot_be_written_is_an_error_of_the_call(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="cannot be written"):
        recorded(tmp_path / "file", SETTINGS, lambda number: frame_at(number, 0.0), 1)


def test_turns_count_as_moves():
    here = frame_at(0, 0.0)
    assert not moved(here, frame_at(1, 0.0))
    assert moved(here, frame_at(1, 1e-6))
    turned = RigidTransform.from_exp_coords([0.0, 0.0, 1e-6, 0.0, 0.0, 0.0])
    assert moved(here, replace(here, world_from_body=turned))
