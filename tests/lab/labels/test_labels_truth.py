import dataclasses

import numpy as np
import pytest

from deckline.geometry import Camera, pose
from deckline.haze import Atmosphere
from deckline.types import Frame, Segment, Truth
from deckline_lab.labels.of_frame import SHORTEST_PX, label_frame
from deckline_sim.visible_line import compute_transmission, find_visible_line, measure_contrast, project_line

CAMERA = Camera.from_fov(320, 180, np.pi / 2)  # focal length 160 px
LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))
SHAPE = (360, 640)
LEFT_PX = np.stack([np.linspace(250, 300, 65), np.linspace(340, 40, 65)], axis=1)
RIGHT_PX = np.stack([np.linspace(450, 360, 65), np.linspace(340, 40, 65)], axis=1)


def frame_at(x_m: float, camera: Camera = CAMERA, height_m: float = 20.0, **truth) -> Frame:
    """Level, `height_m` above the lines' plane, looking along them."""
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    at = pose([x_m, 0.0, -height_m], [1.0, 0.0, 0.0, 0.0])
    return Frame("a.png", 0.0, image, camera, world_from_body=at, truth=Truth(LEFT, RIGHT, **truth))


def test_points_are_where_a_pinhole_puts_them_and_even_in_the_image():
    points, ranges = project_line(frame_at(-100.0), LEFT, 5)
    # A point at x has depth x + 100: u = 159.5 - 1600 / depth, v = 89.5 + 3200 / depth.
    depth = 3200 / (points[:, 1] - 89.5)
    np.testing.assert_allclose(depth[[0, -1]], [100, 300])
    np.testing.assert_allclose(points[:, 0], 159.5 - 1600 / depth)
    np.testing.assert_allclose(ranges, np.sqrt(depth**2 + 100 + 400))
    steps = np.diff(points, axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (4, 1)))


def test_a_line_is_seen_from_the_images_edge_on():
    # v = 89.5 + 3200 / depth reaches the last row, 179, at depth 35.75: 15.75 m along the line.
    seen = find_visible_line(frame_at(-20.0), RIGHT)
    assert seen.points_px[0, 1] == pytest.approx(179.0, abs=0.4)  # points are 0.35 px apart
    assert seen.points_px[-1] == pytest.approx([159.5 + 1600 / 220, 89.5 + 3200 / 220])
    assert seen.share == pytest.approx((200 - 15.75) / 200, abs=0.003)
    assert seen.length_px == pytest.approx(np.hypot(89.5 - 3200 / 220, 44.75 - 1600 / 220), abs=0.3)


def test_a_line_is_seen_as_far_as_the_visibility():
    seen = find_visible_line(frame_at(-100.0, visibility_m=150.0), LEFT)
    assert seen.ranges_m.max() == pytest.approx(150.0, abs=1.0)
    assert find_visible_line(frame_at(-100.0, visibility_m=90.0), LEFT) is None
    np.testing.assert_allclose(
        compute_transmission(np.array([[0.0, 0.0, 150.0], [0.0, 75.0, 0.0]]), frame_at(0.0, visibility_m=150.0)),
        [0.02, 0.02**0.5],
    )


def test_in_recorded_air_a_line_is_seen_as_far_as_two_percent_of_its_light_come_through():
    # 20 m above the water, which the line lies on; the air thins by e every 10 m:
    # a ray of length d meets d (10 / 20) (1 - exp(-2)) m of the air at the water.
    extinction, share = 0.03, 0.5 * (1 - np.exp(-2.0))
    air = Atmosphere((extinction,) * 3, (0.5, 0.5, 0.5), base_z_m=0.0, scale_height_m=10.0)
    conditions = {"air": air.to_mapping()}
    seen = find_visible_line(frame_at(-100.0, visibility_m=3.912 / extinction, conditions=conditions), LEFT)
    assert seen.ranges_m.max() == pytest.approx(3.912 / extinction / share, rel=5e-3)
    assert compute_transmission(np.array([[0.0, 20.0, 0.0]]), frame_at(0.0, conditions=conditions)) == pytest.approx(
        np.exp(-20 * extinction * share)
    )  # straight down to the water
    with pytest.raises(ValueError, match="fog"):
        find_visible_line(frame_at(-100.0, conditions={"air": {"fog": 1}}), LEFT)


def test_what_is_behind_or_beside_the_camera_is_not_seen():
    assert find_visible_line(frame_at(300.0), LEFT) is None
    assert project_line(frame_at(300.0), LEFT) is None
    assert find_visible_line(frame_at(-50.0, height_m=400.0), LEFT) is None
    assert find_visible_line(dataclasses.replace(frame_at(-100.0), world_from_body=None), LEFT) is None


def test_a_strong_lens_does_not_bend_far_points_back_into_the_image():
    bent = Camera(320, 180, 160, 160, 159.5, 89.5, (-0.3, 0.0, 0.0, 0.0, 0.0))
    near = frame_at(-1.0, bent, height_m=3.0)
    points, _ = project_line(near, RIGHT, 2000)
    inside = np.all((points >= 0) & (points <= [319, 179]), axis=1)
    seen = find_visible_line(near, RIGHT)
    assert seen.ranges_m.min() > project_line(near, RIGHT, 2000)[1][inside].min() + 1.0
    rays = bent.rays(seen.points_px)
    np.testing.assert_allclose(rays[:, 1] / rays[:, 0], 3.0 / 10.0, rtol=1e-3)


def test_labels_are_the_seen_lines_and_frames_without_any_are_labelled_so():
    image = label_frame(frame_at(-100.0), "b.png")
    assert (image.file, image.size_px) == ("b.png", (320, 180))
    np.testing.assert_array_equal(image.right_px, find_visible_line(frame_at(-100.0), RIGHT).points_px)
    far = label_frame(frame_at(-5000.0), "b.png")
    assert find_visible_line(frame_at(-5000.0), LEFT).length_px < SHORTEST_PX
    assert far.left_px is None and far.right_px is None
    sea = dataclasses.replace(frame_at(-100.0), truth=Truth(), world_from_body=None)
    assert label_frame(sea, "b.png").left_px is None


@pytest.mark.parametrize("missing", ["truth", "world_from_body"])
def test_frames_that_cannot_be_labelled_are_named(missing):
    with pytest.raises(ValueError, match=r"a\.png"):
        label_frame(dataclasses.replace(frame_at(-100.0), **{missing: None}), "b.png")


def drawn(level: float, width: float = 0.06, deck: float = 60.0) -> np.ndarray:
    """A stripe along the left line, its width in parts of the way to the right one."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    left, right = (np.interp(v, line[::-1, 1], line[::-1, 0]) for line in (LEFT_PX, RIGHT_PX))
    image = np.full((*SHAPE, 3), deck)
    image[np.abs(u - left) <= width / 2 * (right - left)] += level
    return image


U_OF_LEFT = np.interp(np.arange(SHAPE[0]), LEFT_PX[::-1, 1], LEFT_PX[::-1, 0])[:, None]
EDGE = drawn(0.0) + 20.0 * (np.arange(SHAPE[1]) > U_OF_LEFT)[..., None]
DASHES = np.where((np.arange(SHAPE[0]) // 8 % 2 == 0)[:, None, None], 60.0, drawn(80.0))
NOISE = drawn(0.0) + np.random.default_rng(1).normal(0, 3, (*SHAPE, 3))
RED = np.stack([drawn(30.0)[..., 0], *2 * [drawn(0.0)[..., 0]]], axis=2)


@pytest.mark.parametrize(
    ("image", "least", "most"),
    [
        *((drawn(level, width), 0.8 * abs(level), 1.2 * abs(level))
          for level in (-30.0, 4.0, 100.0) for width in (0.04, 0.08, 0.14)),
        (EDGE, 18.0, 22.0),
        (DASHES, 32.0, 48.0),
        (200 + 0.1 * (DASHES - 200), 3.2, 4.8),  # in haze
        (RED, 0.8 * 30 / 3**0.5, 1.2 * 30 / 3**0.5),
        (NOISE, 0.0, 2.0),
        (drawn(100.0)[:, ::-1], 0.0, 1.0),  # a line elsewhere
    ],
)  # fmt: skip
def test_contrast_is_that_of_what_was_drawn_at_the_line(image, least, most):
    assert least <= np.median(measure_contrast(image, LEFT_PX, RIGHT_PX)) <= most
    assert np.isfinite(measure_contrast(image, LEFT_PX - [400.0, 0.0], RIGHT_PX - [400.0, 0.0])).all()
