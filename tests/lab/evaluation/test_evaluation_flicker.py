"""`deckline eval flicker` on a recording, and its errors against closed forms."""

import dataclasses
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refused import refuse
from scipy.spatial.transform import RigidTransform

from deckline.cli.main import main
from deckline.geometry import Camera, attitude
from deckline.recording import RecordingWriter, open_recording
from deckline.types import Frame, Truth
from deckline_lab.evaluation.flicker import (
    DECK,
    SKY,
    WATER,
    PairError,
    clear_picture,
    compute_warp,
    flicker_figures,
    pair_errors,
    patch_means,
    sequence_errors,
    without_truth,
)
from deckline_sim import SimConfig, frames
from deckline_sim.config import DepthConfig, MotionConfig
from deckline_sim.simulate import ShipSimulator

COUNT = 4
CAMERA = Camera(80, 60, 80.0, 80.0, 39.5, 29.5)
WALL_M = 40.0  # along the optical axis
V, U = np.mgrid[0:60, 0:80]


@pytest.fixture(scope="module")
def approach(tmp_path_factory: pytest.TempPathFactory) -> Path:
    view = {"frames": COUNT, "width": 320, "height": 180, "start_m": 300, "end_m": 290}
    config = SimConfig(**view, visibility_m=(700.0, 700.0), depth=DepthConfig(range_m=np.inf))
    folder = tmp_path_factory.mktemp("approach") / "recording"
    with RecordingWriter(folder, scene={}) as writer:
        for frame in frames(config):
            writer.add(frame)
    return folder


def first_frame(folder: Path) -> Frame:
    return open_recording(folder).load(0)


def test_the_table_and_the_file_hold_the_functions_results(approach, tmp_path, capsys):
    file = tmp_path / "figures.json"
    assert main(["eval", "flicker", str(approach), "--dehazer", "none", "dark-channel", "--json", str(file)]) == 0
    figures = json.loads(file.read_text())
    expected = flicker_figures(
        list(sequence_errors((f, {"clear": f.truth.clear_rgb, "none": f.image_rgb}) for f in open_recording(approach))),
        truth="clear",
    )
    assert figures["pairs"] == COUNT - 1
    for name, value in expected.items():
        assert figures[name] == pytest.approx(value)
    assert figures["dark-channel.sky.flicker"] > figures["none.sky.flicker"]
    printed = capsys.readouterr().out
    for words in (f"pairs of frames: {COUNT - 1}", "deck", "water", "sky", "dark-channel"):
        assert words in printed
    assert f"{expected['none.deck.rmse']:.2f}" in printed


def test_every_and_limit_choose_frames(approach, tmp_path):
    file = tmp_path / "figures.json"
    for options, pairs in ((["--every", "3"], 1), (["--limit", "2"], 1), (["--every", "2", "--limit", "9"], 1)):
        assert main(["eval", "flicker", str(approach), "--dehazer", "none", "--json", str(file), *options]) == 0
        assert json.loads(file.read_text())["pairs"] == pairs


def test_a_frame_that_cannot_be_read_parts_its_neighbours(approach, tmp_path, capsys):
    broken = Path(shutil.copytree(approach, tmp_path / "broken"))
    name = open_recording(broken).load(1).file
    (broken / "images" / name).write_bytes(b"cut")
    assert main(["eval", "flicker", str(broken), "--dehazer", "none"]) == 0
    printed = capsys.readouterr()
    assert f"skipped {name}" in printed.err
    assert "pairs of frames: 1," in printed.out  # 3 frames are left; the first has no neighbour


def test_a_dehazer_sees_no_truth_and_only_near_depth(approach):
    frame = first_frame(approach)
    assert np.nanmax(frame.depth_m) > 1000
    flown = without_truth(frame, 200.0)
    assert flown.truth is None
    near = frame.depth_m <= 200.0
    np.testing.assert_array_equal(flown.depth_m[near], frame.depth_m[near])
    assert np.isnan(flown.depth_m[~near]).all()
    assert without_truth(frame, 0.0).depth_m is None
    np.testing.assert_array_equal(flown.image_rgb, frame.image_rgb)


def test_clear_air_is_its_own_truth(approach):
    frame = first_frame(approach)
    np.testing.assert_array_equal(clear_picture(frame), frame.truth.clear_rgb)
    fair = replace(frame, truth=replace(frame.truth, clear_rgb=None, visibility_m=np.inf))
    assert clear_picture(fair) is fair.image_rgb
    with pytest.raises(ValueError, match=re.escape(frame.file)):
        clear_picture(replace(frame, truth=None))


def test_one_frame_has_no_pair(approach, capsys):
    assert "two frames" in refuse(capsys, "flicker", approach, "--every", 9)


def frame(
    name: str = "a",
    *,
    depth: np.ndarray | float = WALL_M,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    ship: tuple[float, float, float] | None = None,
    deck_z_m: float = -100.0,
    image: np.ndarray | None = None,
) -> Frame:
    """Faces along world x towards a wall at one depth, by default, all of it below the deck's height."""
    return Frame(
        name,
        0.0,
        np.zeros((60, 80, 3), np.uint8) if image is None else image,
        CAMERA,
        depth_m=np.full((60, 80), depth, np.float32),
        world_from_body=RigidTransform.from_components(position, attitude(0.0, 0.0, yaw_rad)),
        deck_z_m=deck_z_m,
        truth=Truth(world_from_ship=None if ship is None else RigidTransform.from_translation(ship)),
    )


def texture() -> np.ndarray:
    """Multiples of 50, whose 2 % are whole levels."""
    return (50 * np.random.default_rng(1).integers(1, 5, (60, 80, 3))).astype(np.uint8)


def test_a_gain_that_goes_up_and_down_is_measured_exactly() -> None:
    still = texture()
    steps = [
        (frame(), {"clear": still, "out": np.rint(still * (1 + 0.02 * (-1) ** k)).astype(np.uint8)}) for k in range(6)
    ]
    figures = flicker_figures(list(sequence_errors(steps)), truth="clear")
    levels = still.astype(float)
    assert figures["pairs"] == 5
    assert figures["clear.water.rmse"] == figures["clear.water.flicker"] == figures["clear.water.jump"] == 0
    assert figures["clear.water.psnr_db"] == np.inf
    assert figures["out.water.rmse"] == pytest.approx(0.04 * np.sqrt(np.mean(levels**2)), rel=1e-6)
    assert figures["out.water.psnr_db"] == pytest.approx(10 * np.log10(255**2 / np.mean((0.04 * levels) ** 2)))
    of_channels = 0.04 * levels.mean(axis=(0, 1))
    assert figures["out.water.jump"] == pytest.approx(np.sqrt(np.mean(of_channels**2)), rel=1e-6)
    assert figures["out.water.pump"] == pytest.approx(figures["out.water.jump"])  # it turns round every time
    patches = patch_means((0.04 * levels).astype(np.float32), np.ones((60, 80), bool))
    assert figures["out.water.flicker"] == pytest.approx(np.sqrt(np.mean(patches**2)), rel=1e-5)


def test_a_steady_drift_jumps_but_does_not_pump() -> None:
    still = texture()
    steps = [(frame(), {"clear": still, "out": still + np.uint8(3 * k)}) for k in range(5)]
    figures = flicker_figures(list(sequence_errors(steps)), truth="clear")
    assert figures["out.water.jump"] == pytest.approx(3)
    assert figures["out.water.pump"] == pytest.approx(0, abs=1e-9)


def test_the_truths_own_change_is_taken_out() -> None:
    pairs = [{name: {WATER: PairError(*error)} for name, error in errors.items()} for errors in (
        {"clear": (9.0, 4.0, np.full(3, 1.0)), "out": (25.0, 13.0, np.full(3, 4.0))},
        {"clear": (7.0, 2.0, np.full(3, -1.0)), "out": (23.0, 11.0, np.full(3, -2.0))},
    )]  # fmt: skip
    figures = flicker_figures(pairs, truth="clear")
    assert figures["out.water.rmse"] == pytest.approx(np.sqrt(24))
    assert figures["out.water.flicker"] == pytest.approx(3)  # 12 - 3 squared levels
    assert figures["out.water.jump"] == pytest.approx(np.sqrt((9 + 1) / 2))
    assert figures["out.water.pump"] == pytest.approx(2)  # from 3 to -1
    assert figures["clear.water.jump"] == pytest.approx(1)


def test_a_camera_that_slides_by_three_pixels_sees_the_same_wall() -> None:
    """3 px right at 40 m is 1.5 m; the picture moves left by 3 px, and the last three columns are new."""
    wide = (50 * np.random.default_rng(2).integers(1, 5, (60, 83, 3))).astype(np.uint8)
    before, after = frame("a"), frame("b", position=(0.0, 1.5, 0.0))
    warp = compute_warp(before, after)
    seen = warp.regions[WATER]
    assert seen[:, :77].all() and not seen[:, 78:].any()  # the 77th may fall on either side of the edge
    np.testing.assert_allclose(warp.before_px[:, :77], np.stack([U[:, :77] + 3, V[:, :77]], axis=2), atol=1e-4)
    error = pair_errors(wide[:, :80], wide[:, 3:83] + np.uint8(2), warp)[WATER]
    assert error.mse == pytest.approx(4, rel=1e-4)
    np.testing.assert_allclose(error.jump, 2, rtol=1e-4)


def test_flying_towards_a_wall_with_a_ramp_painted_on_it_shows_no_error() -> None:
    """A function that is linear on the wall is linear in every picture of it, where bilinear sampling is exact."""

    def ramp(depth_m: float) -> np.ndarray:
        y, z = (U - 39.5) * depth_m / 80, (V - 29.5) * depth_m / 80
        return np.stack([100 + 3 * y, 100 - 2 * z, 100 + y + z], axis=2).astype(np.float32)

    warp = compute_warp(frame("a"), frame("b", depth=36.0, position=(4.0, 0.0, 0.0)))
    assert warp.regions[WATER].all()
    error = pair_errors(ramp(40.0), ramp(36.0), warp)[WATER]
    assert error.mse < 1e-6


def test_a_sloping_plane_is_visible_all_over() -> None:
    """Water from 20 m: depth changes by 7 % from row to row, far more than the tolerance, and still agrees."""

    def water(z_m: float, x_m: float) -> Frame:
        down = (V - 29.5) / 80
        depth = np.where(down > 0, z_m / np.maximum(down, 1e-9), np.nan)
        return frame("w", depth=depth, position=(x_m, 0.0, -z_m), deck_z_m=-50.0)

    warp = compute_warp(water(20.0, 0.0), water(19.5, 5.0))
    assert warp.regions[WATER][35:40, 10:70].all()
    assert warp.regions[SKY][2:28].all()  # the aircraft did not turn: the sky stays where it is
    np.testing.assert_allclose(warp.before_px[2:28], np.stack([U, V], axis=2)[2:28], atol=1e-4)


def test_the_sky_turns_with_the_camera() -> None:
    yaw = np.arctan(1 / 80)
    sky = np.full((60, 80), np.nan)
    warp = compute_warp(frame("a", depth=sky), frame("b", depth=sky, yaw_rad=yaw))
    middle = warp.before_px[20, 40]
    expected = CAMERA.project(attitude(0.0, 0.0, yaw).apply([[1.0, 0.5 / 80, -9.5 / 80]])[:, [1, 2, 0]])[0]
    np.testing.assert_allclose(middle, expected, atol=1e-4)
    assert warp.regions[SKY][20, 40]
    assert not warp.regions[SKY][31:].any()  # unknown depth below the horizon is no sky


def test_what_was_hidden_before_is_left_out() -> None:
    """A post at 20 m before the wall hides other columns after a step aside; both strips are left out."""
    depths = [np.full((60, 80), WALL_M), np.full((60, 80), WALL_M)]
    depths[0][:, 30:40] = 20.0
    depths[1][:, 24:34] = 20.0  # 1.5 m aside: 6 px at 20 m, 3 px at 40 m
    warp = compute_warp(frame("a", depth=depths[0]), frame("b", depth=depths[1], position=(0.0, 1.5, 0.0)))
    seen = warp.regions[WATER][30]
    assert seen[25:33].all() and seen[:23].all() and seen[38:76].all()
    assert not seen[34:37].any()  # columns 37 to 39 of the wall were behind the post


def test_the_deck_moves_with_the_ship_and_the_rest_does_not() -> None:
    """The ship sails 1.5 m to the right: what is high enough slides by 3 px, the water below stays."""
    high = -1.0 - 5.0  # deck height that makes the upper half deck: z < -1 m is higher than the camera's axis
    before = frame("a", ship=(0.0, 0.0, 0.0), deck_z_m=high)
    after = frame("b", ship=(0.0, 1.5, 0.0), deck_z_m=high)
    warp = compute_warp(before, after)
    assert warp.regions[DECK][10, 40] and warp.regions[WATER][50, 40]
    np.testing.assert_allclose(warp.before_px[10, 40], [37, 10], atol=1e-4)
    np.testing.assert_allclose(warp.before_px[50, 40], [40, 50], atol=1e-4)


def test_a_missing_frame_parts_its_neighbours_and_a_small_region_is_left_out() -> None:
    picture = {"clear": texture()}
    assert len(list(sequence_errors([(frame(), picture), None, (frame(), picture), (frame(), picture)]))) == 1
    depth = np.full((60, 80), np.nan)
    depth[30:, :3] = WALL_M
    warp = compute_warp(frame(depth=depth), frame(depth=depth))
    assert 0 < np.count_nonzero(warp.regions[WATER]) <= 90
    assert set(pair_errors(texture(), texture(), warp)) == {SKY}
    with pytest.raises(ValueError):
        flicker_figures([], truth="clear")


def test_patches_are_means_over_their_part_of_a_region() -> None:
    rng = np.random.default_rng(4)
    values, region = rng.normal(size=(30, 200, 3)).astype(np.float32), rng.random((30, 200)) < 0.5
    means = patch_means(values, region)  # 200 px wide: patches of 5 px
    for v, u in ((0, 0), (15, 100), (29, 199)):
        window = np.s_[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3]
        np.testing.assert_allclose(means[v, u], values[window][region[window]].mean(axis=0), atol=1e-5)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"depth_m": None}, "depth"),
        ({"world_from_body": None, "deck_z_m": None}, "pose.*deck height"),
        (
            {"image_rgb": np.zeros((6, 8, 3), np.uint8), "camera": CAMERA.resized(8, 6), "depth_m": np.ones((6, 8))},
            r"\(6, 8, 3\).*\(60, 80, 3\) of a",
        ),
    ],
    ids=["depth", "pose", "size"],
)
def test_frames_that_cannot_be_compared_are_refused(changes: dict, named: str) -> None:
    with pytest.raises(ValueError, match=rf"^b: .*{named}"):
        compute_warp(frame("a"), dataclasses.replace(frame("b"), **changes))


def test_rendered_frames_of_a_sailing_ship_fit_each_other() -> None:
    """A quarter of a second apart; without the ship's motion, 3 m of it, they fit much worse."""
    view = {"frames": 40, "width": 320, "height": 180, "fov_deg": 35, "start_m": 150, "end_m": 60, "seed": 5}
    motion = MotionConfig(sea_state=5, ship_speed_m_s=12.0)
    config = SimConfig(**view, depth=DepthConfig(range_m=np.inf), motion=motion)
    with ShipSimulator(config) as simulator:
        pair = [simulator.frame(index) for index in (10, 16)]
    errors = [
        pair_errors(a.image_rgb, b.image_rgb, compute_warp(a, b))[DECK]
        for a, b in (pair, [dataclasses.replace(item, truth=None) for item in pair])
    ]
    assert pair[1].time_s - pair[0].time_s == pytest.approx(0.26, abs=0.01)
    assert np.sqrt(errors[0].mse) < 10
    assert errors[1].mse > 2 * errors[0].mse
