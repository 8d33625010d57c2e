"""Paint that is put onto, or taken from, the deck of a rendered frame, seen through the frame's haze."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.haze import beta_from_visibility, blend_airlight, transmission
from deckline.types import Frame, Segment
from deckline_lab.evaluation.integrity_sensors import to_right

PAINT_WIDTH_M, PAINT_LEVEL = 0.8, 210.0
STEP_M, NEAR_M = 5.0, 2.0  # pieces that a line is painted in; nearer ones are left out
FINE = 4  # subpixels a side of a painted line's edge

Colour = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # of a point (3,) of the deck -> RGB (3,) in the image


def paint(frame: Frame, line: Segment, width_m: float = PAINT_WIDTH_M, level: float = PAINT_LEVEL) -> Frame:
    """The frame with a line of a grey level from 0 to 255 on its deck.

    Raises:
        ValueError: a frame without pose or truth.
    """
    return _cover(frame, line, width_m, lambda point_m: see_through_haze(frame, point_m, level))


def erase(frame: Frame, line: Segment, width_m: float, right_m: float) -> Frame:
    """The frame where what lies so far to the right of a line covers it; errors as in `paint`."""
    right = right_m * to_right(line)
    last = np.array(frame.image_rgb.shape[1::-1]) - 1

    def beside(point_m: NDArray[np.float64]) -> NDArray[np.float64]:
        (pixel,) = frame.camera.project(_to_camera(frame, (point_m + right)[None]))
        u, v = np.clip(np.rint(pixel), 0, last).astype(int)
        return frame.image_rgb[v, u].astype(np.float64)

    return _cover(frame, line, width_m, beside)


def draw_boxes(
    frame: Frame, line: Segment, places: ArrayLike, size_m: tuple[float, float, float], level: float
) -> Frame:
    """The frame with boxes on a line of its deck, lengthwise; errors as in `paint`.

    Args:
        frame: of which pose and air are known.
        line: of the deck, which carries them.
        places: (N, 2) of their middles: along the line, as a part of it, and m to the right of it.
        size_m: length, width and height.
        level: grey level from 0 to 255.
    """
    length, width, height = size_m
    along, right = line.p1_m - line.p0_m, to_right(line)
    ahead, aside = length / 2 * along / np.linalg.norm(along), width / 2 * right
    corners = np.array([i * ahead + j * aside - [0.0, 0.0, up] for i in (-1, 1) for j in (-1, 1) for up in (0, height)])
    colour, cover = _canvas(frame)
    for at, right_m in np.asarray(places):
        middle = line.p0_m + at * along + right_m * right
        seen = _to_camera(frame, middle + corners)
        if seen[:, 2].min() < NEAR_M:
            continue
        outline = cv2.convexHull(np.clip(frame.camera.project(seen), -8000, 8000).astype(np.float32))
        cv2.fillConvexPoly(colour, np.rint(outline).astype(np.int32), see_through_haze(frame, middle, level).tolist())
        cv2.fillConvexPoly(cover, np.rint(FINE * (outline + 0.5)).astype(np.int32), 255)
    return _blend(frame, colour, cover)


def see_through_haze(frame: Frame, point_m: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    """RGB (3,) that a point (3,) of the world with a grey level has in the frame's image; errors as in `paint`."""
    truth = frame.truth
    if truth is None:
        raise ValueError(f"{frame.file}: to paint needs the true air")
    airlight = np.full(3, level) if truth.airlight_rgb is None else np.asarray(truth.airlight_rgb, np.float64)
    beta = beta_from_visibility(truth.visibility_m) if truth.visibility_m else 0.0
    t = float(transmission(np.linalg.norm(_to_camera(frame, point_m)), beta))
    return blend_airlight(np.full(3, level), airlight, t)


def _to_camera(frame: Frame, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """World points (..., 3) in the optical frame."""
    pose = frame.true_world_from_camera
    if pose is None:
        raise ValueError(f"{frame.file}: to paint needs the true pose")
    return np.asarray(pose.inv().apply(points_m))


def _cover(frame: Frame, line: Segment, width_m: float, colour_of: Colour) -> Frame:
    along, across = line.p1_m - line.p0_m, width_m / 2 * to_right(line)
    ends = line.p0_m + np.linspace(0, 1, 1 + int(np.ceil(np.linalg.norm(along) / STEP_M)))[:, None] * along
    colour, cover = _canvas(frame)
    for start, end in pairwise(ends):
        corners = _to_camera(frame, np.array([start - across, start + across, end + across, end - across]))
        if corners[:, 2].min() < NEAR_M:
            continue
        pixels = np.clip(frame.camera.project(corners), -8000, 8000)
        cv2.fillConvexPoly(colour, np.rint(pixels).astype(np.int32), colour_of((start + end) / 2).tolist())
        cv2.fillConvexPoly(cover, np.rint(FINE * (pixels + 0.5)).astype(np.int32), 255)
    return _blend(frame, colour, cover)


def _canvas(frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A copy of the image (H, W, 3), to colour, and a mask (n H, n W) in finer pixels of what is covered."""
    height, width = frame.image_rgb.shape[:2]
    return frame.image_rgb.copy(), np.zeros((FINE * height, FINE * width), np.uint8)


def _blend(frame: Frame, colour: NDArray[np.uint8], cover: NDArray[np.uint8]) -> Frame:
    image = frame.image_rgb
    share = cv2.resize(cover, image.shape[1::-1], interpolation=cv2.INTER_AREA)[..., None] / np.float32(255)
    mixed = image + share * (colour.astype(np.float32) - image)
    return replace(frame, image_rgb=np.rint(mixed).astype(np.uint8))
