from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, attitude
from deckline.types import Detection, Frame, LinePoints, Segment, Truth
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.integrity_faults import FAULTS, Runs, inject
from deckline_lab.evaluation.integrity_sensors import (
    BORESIGHT_RAD,
    CATAPULT_M,
    DECK_M,
    DEPTH_BIAS,
    FOUL_M,
    move_points,
    offset_line,
    pose_at,
    u_at,
)
from deckline_lab.evaluation.metrics import normal_pixel_error

LEFT = Segment(np.array([0.0, -10.0, 5.0]), np.array([200.0, -10.0, 5.0]))
RIGHT = Segment(np.array([0.0, 10.0, 5.0]), np.array([200.0, 10.0, 5.0]))
CAMERA = Camera.from_fov(640, 360, np.pi / 2)
SPEED_M_S, RATE_HZ = 60.0, 5.0


def points(frame: Frame, line: Segment) -> LinePoints:
    along = line.p0_m + np.linspace(0.1, 0.9, 25)[:, None] * (line.p1_m - line.p0_m)
    pixels = frame.camera.project(frame.true_world_from_camera.inv().apply(along))
    return LinePoints(pixels, np.full(25, 0.9), np.full(25, 0.3))


def sighting(index: int) -> Sighting:
    time_s = index / RATE_HZ
    body = RigidTransform.from_components(
        [-200.0 + SPEED_M_S * time_s, 1.0, -20.0], attitude(0.02 * time_s, -0.05, 0.01)
    )
    frame = Frame(
        f"{index}.png",
        time_s,
        np.full((360, 640, 3), index, np.uint8),
        CAMERA,
        depth_m=np.full((360, 640), 100.0, np.float32),
        world_from_body=body,
        deck_z_m=5.0,
        truth=Truth(LEFT, RIGHT),
    )
    return Sighting(frame, Detection(points(frame, LEFT), points(frame, RIGHT)))


SIGHTINGS = [sighting(index) for index in range(8)]
ONSET_S = 0.7  # between the fourth and the fifth frame
MODELLED = [name for name, fault in FAULTS.items() if Runs.MODELLED in fault.runs]


def with_fault(name: str, seed: int = 0) -> list[Sighting]:
    return [at for at, _ in inject(SIGHTINGS, FAULTS[name], ONSET_S, np.random.default_rng(seed))]


def distance_px(at: Sighting, side: str, line: Segment) -> np.ndarray:
    ends = at.frame.true_world_from_camera.inv().apply(np.stack([line.p0_m, line.p1_m]))
    return normal_pixel_error(getattr(at.detection, side).points_px, ends, at.frame.camera)


@pytest.mark.parametrize("name", MODELLED)
def test_sudden_faults_leave_what_was_before_untouched(name):
    faulty = with_fault(name)
    assert len(faulty) == len(SIGHTINGS)
    same = [a is b for a, b in zip(faulty, SIGHTINGS, strict=True)]
    if FAULTS[name].sudden:
        assert all(same[:4])
    assert same[4] == (FAULTS[name].width_off > 0)  # what is stated is wrong, and no frame
    if name != "deck height once" and not FAULTS[name].width_off:
        assert not any(same[4:])


@pytest.mark.parametrize("name", MODELLED)
def test_the_truth_stays_what_it_was(name):
    for before, after in zip(SIGHTINGS, with_fault(name), strict=True):
        assert after.frame.truth.left is LEFT
        assert after.frame.time_s == before.frame.time_s
        true = after.frame.true_world_from_body
        np.testing.assert_array_equal(true.as_matrix(), before.frame.true_world_from_body.as_matrix())


def test_without_a_fault_nothing_changes():
    assert list(inject(SIGHTINGS, None, 0.0, np.random.default_rng(0))) == [(at, False) for at in SIGHTINGS]


@pytest.mark.parametrize("distorted", [False, True])
def test_frames_that_a_fault_cannot_change_are_named(distorted):
    camera = replace(CAMERA, distortion=(0.1, 0.0, 0.0, 0.0, 0.0)) if distorted else CAMERA
    at = Sighting(replace(SIGHTINGS[0].frame, camera=camera), SIGHTINGS[0].detection if distorted else None)
    with pytest.raises(ValueError, match=r"^0\.png: "):
        list(inject([at], FAULTS["foul line"], 0.0, np.random.default_rng(0)))


def test_lines_are_swapped_depths_scaled_and_the_camera_turned():
    swapped, right = with_fault("swapped lines")[5].detection, SIGHTINGS[5].detection
    assert swapped.left is right.right and swapped.right is right.left
    ratio = with_fault("depth bias 3 %")[0].frame.depth_m[0, 0] / 100.0
    assert abs(ratio - 1.0) == pytest.approx(DEPTH_BIAS, rel=1e-5)
    turned = with_fault("boresight 1 deg")[5].frame.body_from_camera.rotation
    turn = SIGHTINGS[5].frame.body_from_camera.rotation.inv() * turned
    assert turn.magnitude() == pytest.approx(BORESIGHT_RAD)


@pytest.mark.parametrize("px", [15.0, 60.0])
def test_a_principal_point_is_stated_beside_the_true_one(px):
    after = [at.frame.camera.cx - CAMERA.cx for at in with_fault(f"cx {px:g} px off")]
    assert len(set(after)) == 1
    assert abs(after[0]) == px


def test_what_is_cut_off_at_the_left_shifts_picture_depth_and_points():
    before, after = SIGHTINGS[5], with_fault("left 15% cropped")[5]
    cut = round(0.15 * CAMERA.width)
    assert after.frame.image_rgb.shape == before.frame.image_rgb.shape
    assert after.frame.camera is before.frame.camera
    np.testing.assert_array_equal(after.frame.image_rgb[:, :-cut], before.frame.image_rgb[:, cut:])
    assert not after.frame.image_rgb[:, -cut:].any()
    assert np.isnan(after.frame.depth_m[:, -cut:]).all()
    points, was = after.detection.left.points_px, before.detection.left.points_px
    inside = was[:, 0] >= cut
    np.testing.assert_allclose(points, was[inside] - [cut, 0.0])
    assert len(after.detection.left.sigma_px) == inside.sum()


@pytest.mark.parametrize("seed", range(4))
def test_a_foul_line_runs_beside_its_edge_outside(seed):
    after = with_fault("foul line", seed)[5]
    sides = [
        side for side in ("left", "right") if distance_px(after, side, LEFT if side == "left" else RIGHT).min() > 1
    ]
    assert len(sides) == 1
    outwards, line = (-1, LEFT) if sides[0] == "left" else (1, RIGHT)
    near, far = (offset_line(line, outwards * reach, 0.0) for reach in FOUL_M)
    moved = getattr(after.detection, sides[0]).points_px
    limits = [u_at(edge, moved[:, 1], after.frame) for edge in (near, far)]
    assert np.all((moved[:, 0] >= np.minimum(*limits) - 1e-6) & (moved[:, 0] <= np.maximum(*limits) + 1e-6))


def test_a_catapult_track_is_no_parallel():
    after = with_fault("catapult track", 1)[5]
    side, line = next(
        (side, line) for side, line in (("left", LEFT), ("right", RIGHT)) if distance_px(after, side, line).max() > 1
    )
    moved = getattr(after.detection, side).points_px
    offset = moved[:, 0] - u_at(line, moved[:, 1], after.frame)
    scale = u_at(RIGHT, moved[:, 1], after.frame) - u_at(LEFT, moved[:, 1], after.frame)
    across = 20.0 * offset / scale  # metres on the deck
    assert np.ptp(across) > 2.0
    assert abs(across[-1] if len(across) else 0.0) < CATAPULT_M[1] + 200 * np.tan(0.16)


def test_moved_points_have_the_same_noise_and_may_leave_the_image():
    noise = np.random.default_rng(0).normal(0, 0.5, 25)
    seen = SIGHTINGS[0].detection.right
    noisy = LinePoints(seen.points_px + np.column_stack([noise, np.zeros(25)]), seen.confidence, seen.sigma_px)
    other = offset_line(RIGHT, 3.0, 0.05)
    moved = move_points(noisy, RIGHT, other, SIGHTINGS[0].frame)
    np.testing.assert_allclose(moved.points_px[:, 0] - u_at(other, moved.points_px[:, 1], SIGHTINGS[0].frame), noise)
    assert len(move_points(noisy, RIGHT, offset_line(RIGHT, 1000.0, 0.0), SIGHTINGS[0].frame)) == 0


def test_where_a_line_crosses_rows():
    seen = points(SIGHTINGS[3].frame, LEFT).points_px
    np.testing.assert_allclose(u_at(LEFT, seen[:, 1], SIGHTINGS[3].frame), seen[:, 0], atol=1e-9)
    assert np.isnan(u_at(LEFT, np.array([0.0]), SIGHTINGS[3].frame)).all()  # above the horizon the line is behind


def test_a_frozen_camera_shows_one_picture_while_the_pose_goes_on():
    after = with_fault("frozen camera")
    for k in (4, 5, 7):
        assert after[k].frame.image_rgb is SIGHTINGS[3].frame.image_rgb
        assert after[k].detection is SIGHTINGS[3].detection
        assert after[k].frame.world_from_body is SIGHTINGS[k].frame.world_from_body


def test_a_late_pose_is_where_the_aircraft_was():
    after = with_fault("pose late by 0.2 s")[6].frame
    np.testing.assert_allclose(after.world_from_body.translation, SIGHTINGS[5].frame.world_from_body.translation)
    moved = after.true_world_from_body.translation - after.world_from_body.translation
    assert moved[0] == pytest.approx(0.2 * SPEED_M_S)


def test_poses_between_two_known_ones():
    first = RigidTransform.from_components([0.0, 0.0, 0.0], Rotation.identity())
    last = RigidTransform.from_components([4.0, 8.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 0.4]))
    between = pose_at([(1.0, first), (2.0, last)], 1.25)
    np.testing.assert_allclose(between.translation, [1.0, 2.0, 0.0])
    np.testing.assert_allclose(between.rotation.as_rotvec(), [0.0, 0.0, 0.1], atol=1e-12)
    assert pose_at([(1.0, first), (2.0, last)], 0.0) is first


def test_a_wrong_deck_height_once_and_for_ever():
    always = [at.frame.deck_z_m - 5.0 for at in with_fault("deck height")]
    once = [at.frame.deck_z_m - 5.0 for at in with_fault("deck height once")]
    assert DECK_M[0] <= abs(always[0]) <= DECK_M[1]
    assert len(set(always)) == 1
    assert [value != 0.0 for value in once] == [False] * 4 + [True] + [False] * 3
