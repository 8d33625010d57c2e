import asyncio
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from airsim_serving import CONFIG, WORLD_SETTINGS
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.recording import open_recording
from deckline.types import Frame
from deckline_sim.airsim_server import image_requests as images
from deckline_sim.airsim_server.image_requests import (
    Recorder,
    draw_depth,
    encode_depth,
    get_images,
    has_moved,
    read_requests,
)
from deckline_sim.airsim_server.settings import PERSPECTIVE, PLANAR, SCENE, CaptureSetting, parse_settings
from deckline_sim.airsim_server.sim_clock import SimClock
from deckline_sim.airsim_server.world import World
from deckline_sim.config import LensConfig

INTERVAL = replace(parse_settings({}, CaptureSetting(8, 6, 90.0)), interval_s=0.01)


def test_pictures_of_one_call_are_drawn_once_a_camera(world, monkeypatch):
    drawn, depths = [], []
    picture, depth = world.picture, world.depth
    monkeypatch.setattr(world, "picture", lambda *args: drawn.append(args[0]) or picture(*args))
    monkeypatch.setattr(world, "depth", lambda *args: depths.append(args[0]) or depth(*args))
    asked = [{"camera_name": name, "image_type": kind} for name in ("0", "front_center", "1") for kind in (0, 1, 2, 3)]
    answers = get_images(world, read_requests(asked, WORLD_SETTINGS))
    assert drawn == ["front_center", "front_right"] and len(answers) == 12
    assert [answer["camera_name"] for answer in answers[::4]] == ["0", "front_center", "1"]
    alone = get_images(world, read_requests(asked[1:3], WORLD_SETTINGS))
    assert depths == ["front_center"] and len(drawn) == 2
    for shown, measured in zip(answers[1:3], alone, strict=True):
        np.testing.assert_array_equal(shown["image_data_uint8"], measured["image_data_uint8"])


def test_depth_goes_through_lenses_that_bend():
    asked = [{"camera_name": "0", "image_type": PERSPECTIVE, "pixels_as_float": True}]
    lens = LensConfig(distortion=(-0.05, 0.0, 0.0, 0.0, 0.0))
    with closing(World(replace(CONFIG, lens=lens), WORLD_SETTINGS, SimClock(lambda: 0.0))) as bent:
        frame = bent.picture("front_center", SCENE, bent.state, 0.0)
        (answer,) = get_images(bent, read_requests(asked, WORLD_SETTINGS))
    v, u = np.argwhere(frame.depth_m < 1000.0)[100]
    length = np.linalg.norm(frame.camera.rays([[u, v]])[0])
    stored = answer["image_data_float"].reshape(CONFIG.height, CONFIG.width)
    assert stored[v, u] == pytest.approx(length * frame.depth_m[v, u], rel=1e-5)


def test_depth_is_stored_and_shown_as_airsim_does():
    depth = np.full((54, 96), np.nan, np.float32)
    depth[0, :4] = 0.0, 50.0, 100.0, 70000.0
    stored = encode_depth(depth, Camera.from_fov(96, 54, 1.0), PLANAR)
    np.testing.assert_array_equal(stored[0, :5], np.float32([0.0, 50.0, 100.0, 65504.0, 65504.0]))
    np.testing.assert_array_equal(draw_depth(stored)[0, :5, 0], [0, 128, 255, 255, 255])


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ("0", "64"),
        ([{}] * 65, "64"),
        ([5], "int"),
        ([{"image_type": True}], "True"),
        ([{"image_type": 0, "pixels_as_float": True}], "Scene.*pixels_as_float"),
        ([{"camera_name": "9"}], "'9'"),
    ],
)
def test_what_cannot_be_asked_for_is_named(values, says):
    with pytest.raises(ValueError, match=says):
        read_requests(values, WORLD_SETTINGS)


def test_answers_do_not_grow_without_limit(world, monkeypatch):
    monkeypatch.setattr(images, "MAX_PIXELS", 3 * CONFIG.width * CONFIG.height)
    three = read_requests(3 * [{"image_type": PLANAR}], WORLD_SETTINGS)
    assert len(get_images(world, three)) == 3
    with pytest.raises(ValueError, match="15552"):
        get_images(world, [*three, *three[:1]])


def frame_at(number, metres):
    """A frame of its own time, so far north."""
    image = np.full((6, 8, 3), number, np.uint8)
    where = RigidTransform.from_translation([metres, 0.0, 0.0])
    return Frame(f"{number}", 100.0 + number, image, Camera.from_fov(8, 6, 1.0), world_from_body=where)


def record(out, settings, take, enough):
    """Whether the recorder was on when `enough` frames were asked for, and its log."""
    lines, asked = [], []

    async def frame():
        asked.append(len(asked))
        return take(asked[-1])

    async def run():
        recorder = Recorder(out, settings, frame, {"preset": "paper"}, lines.append)
        await recorder.stop()  # there is nothing to stop
        await recorder.start()
        await recorder.start()
        while len(asked) < enough and recorder.is_on:
            await asyncio.sleep(0.005)
        on = recorder.is_on
        await recorder.stop()
        assert not recorder.is_on
        return on

    return asyncio.run(run()), lines


def test_frames_are_whole_when_it_stops(tmp_path):
    on, lines = record(tmp_path, INTERVAL, lambda number: frame_at(number, float(number)), 5)
    (folder,) = tmp_path.iterdir()
    source = open_recording(folder)
    assert on and len(source) >= 4
    for index in range(len(source)):
        loaded = source.load(index)
        assert loaded.time_s == 100.0 + index and loaded.image_rgb[0, 0, 0] == index
        np.testing.assert_allclose(loaded.world_from_body.translation, [index, 0.0, 0.0])
    begun, ended = lines
    assert str(folder) in begun and str(folder) in ended and f" {len(source)} " in ended


def test_only_moves_count_when_they_shall(tmp_path):
    still = replace(INTERVAL, on_move=True)
    record(tmp_path, still, lambda number: frame_at(number, float(number // 4)), 9)
    (folder,) = tmp_path.iterdir()
    source = open_recording(folder)
    assert [source.load(index).world_from_body.translation[0] for index in range(2)] == [0.0, 1.0]
    assert len(source) <= 3
    turned = RigidTransform.from_exp_coords([0.0, 0.0, 1e-6, 0.0, 0.0, 0.0])
    assert has_moved(frame_at(0, 0.0), replace(frame_at(1, 0.0), world_from_body=turned))


def test_two_recordings_in_one_second_have_two_folders(tmp_path):
    for _ in range(3):
        record(tmp_path, INTERVAL, lambda number: frame_at(number, 0.0), 1)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_picture_that_cannot_be_taken_ends_it_with_a_line(tmp_path):
    def take(number):
        if number == 2:
            raise ValueError("the camera must be above the sea")
        return frame_at(number, 0.0)

    on, lines = record(tmp_path, INTERVAL, take, 5)
    (folder,) = tmp_path.iterdir()
    assert not on and lines[-1].endswith("the camera must be above the sea")
    assert len(open_recording(folder)) == 2


def test_a_folder_that_cannot_be_written_is_an_error_of_the_call(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="file"):
        record(tmp_path / "file", INTERVAL, lambda number: frame_at(number, 0.0), 1)


@pytest.mark.parametrize(
    ("limit", "value", "named"), [("RECORDING_BYTES", 0, "0 GiB"), ("FREE_BYTES", 1 << 60, f"{1 << 40} MiB")]
)
def test_a_recording_ends_before_the_disk_is_full(tmp_path, monkeypatch, limit, value, named):
    monkeypatch.setattr(images, limit, value)
    on, lines = record(tmp_path, INTERVAL, lambda number: frame_at(number, float(number)), 500)
    assert not on and named in lines[-1]
