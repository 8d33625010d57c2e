"""Annotators: each draws one thing of a result on a picture of its frame.

    picture = LineAnnotator().annotate(result.frame.image_rgb, result)

A picture shows the whole frame, hazy or dehazed, in any size: (H, W, 3) uint8 RGB. `annotate` returns a new one. Give a
picture to the magnifier before lines are drawn on it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.flight import FrameResult
from deckline.geometry import intersect_plane, rotation_matrix
from deckline.report import draw
from deckline.report.draw import Colour, Image, draw_dashes, draw_dot, draw_segment
from deckline.report.instrument import draw_indicator
from deckline.types import SIDES, Frame, LinePoints, PixelLine, RunwayEstimate

MATCHED_PX = 24  # width of the part of a picture that a magnified view is matched to, at least
MATCH_RIDGE = 4.0  # grey levels squared: contrast below which it is not matched
MAX_GAIN = 10.0  # of contrast
INSET_PX = (272, 153)  # width, height of the magnified view
MARGIN_PX = 10  # of what is placed in a corner
MIN_MAGNIFICATION = 2.0  # a smaller gain is not worth hiding a corner for
WINDOW_SHARE = 0.6  # of the magnified view's width or height that the lines fill
MIN_WINDOW_PX = 48  # width of the magnified part of the image, at least
DOT_PX = (1.5, 4.0)  # radius of a point of no and of full confidence, where points lie apart
RIM_PX = 2.2  # smaller points have no dark rim: they would be all rim
COLOURS = {"left": draw.LEFT, "right": draw.RIGHT}
NEAR_HEIGHTS = 0.1  # the centre line is drawn from this far in front of the camera, in its heights above the deck
NEEDLES_PX = 160  # side of the indicator
Window = tuple[int, int, int, int]  # u0, v0, u1, v1, px, ends excluded


@dataclass(frozen=True)
class Viewport:
    """A part of the full image shown at another size; (0, 0) is a pixel's centre in both."""

    left_px: float
    """Left edge of the part, image px."""
    top_px: float
    """Top edge of the part, image px."""
    x: float
    """Shown pixels per image pixel, across."""
    y: float
    """Shown pixels per image pixel, down."""

    def __call__(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image pixels (N, 2) as they are shown."""
        return (points_px + 0.5 - [self.left_px, self.top_px]) * [self.x, self.y] - 0.5

    def window(self, window: Window) -> NDArray[np.float64]:
        """u0, v0, u1, v1 of a part of the image."""
        return self(np.array(window, dtype=np.float64).reshape(2, 2)).ravel()


class Annotator(Protocol):
    """What draws on a picture."""

    def annotate(self, image: Image, result: FrameResult) -> Image:
        """The picture (H, W, 3) of the result's frame with what this draws; the given one stays as it is."""
        ...


class ViewportAnnotator:
    """An annotator that draws into any part of the frame at any size: into a magnified view as well."""

    def annotate(self, image: Image, result: FrameResult) -> Image:
        """The picture (H, W, 3) of the result's frame with what this draws.

        Raises:
            ValueError: no image of uint8.
        """
        check_image(image)
        marked = image.copy()
        self.draw(marked, whole_view(image, result.frame), result)
        return marked

    def draw(self, image: Image, view: Viewport, result: FrameResult) -> None:
        """Draw into `image`, which shows the part of the frame that `view` states."""
        raise NotImplementedError


@dataclass(frozen=True)
class LineAnnotator(ViewportAnnotator):
    """The edge lines, and the centre line in dashes where a pose gives it.

    Args:
        width_px: of the edge lines.
        pale: share of white in their colours, to be seen on points.
    """

    width_px: int = 2
    pale: float = 0.0

    def draw(self, image: Image, view: Viewport, result: FrameResult) -> None:
        """Draw into `image`, which shows the part of the frame that `view` states."""
        centre = project_centre_line(result.frame, result.estimate)
        if centre is not None:
            _draw_centre_line(image, view(centre))
        for side, line in result.estimate.pixel_lines.items():
            red, green, blue = (round(c + self.pale * (255 - c)) for c in COLOURS[side])
            draw_segment(image, view(line.ends_px), (red, green, blue), self.width_px, halo=0)


@dataclass(frozen=True)
class PointAnnotator(ViewportAnnotator):
    """The detected points of both edge lines, larger with their confidence; those that no line took are rings."""

    def draw(self, image: Image, view: Viewport, result: FrameResult) -> None:
        """Draw into `image`, which shows the part of the frame that `view` states."""
        for side in SIDES:
            line = result.estimate.pixel_lines.get(side)
            _draw_points(image, view, getattr(result.detection, side), line, COLOURS[side])


CLOSE_UP: tuple[ViewportAnnotator, ...] = (PointAnnotator(), LineAnnotator(width_px=1, pale=0.65))


@dataclass(frozen=True)
class MagnifierAnnotator:
    """A far deck magnified in a corner of the picture, from the frame's own pixels in the picture's contrast.

    Args:
        marks: drawn into the magnified view.
        size_px: its width and height.
    """

    marks: Sequence[ViewportAnnotator] = CLOSE_UP
    size_px: tuple[int, int] = INSET_PX

    def annotate(self, image: Image, result: FrameResult) -> Image:
        """The picture (H, W, 3) with the magnified view; as it was where `find_place` finds none.

        Raises:
            ValueError: no image of uint8.
        """
        check_image(image)
        found, shown = self.find_place(image, result), image.copy()
        if found is None:
            return shown
        window, corner = found
        u0, v0, u1, v1 = window
        frame = result.frame.image_rgb
        hazy = frame if frame.shape == image.shape else resize(frame, (image.shape[1], image.shape[0]))
        width = frame.shape[1]
        inset = resize(frame[v0:v1, u0:u1], self.size_px)
        inset = match_contrast(inset, crop_around(hazy, window, width), crop_around(image, window, width))
        close = Viewport(u0, v0, self.size_px[0] / (u1 - u0), self.size_px[1] / (v1 - v0))
        for mark in self.marks:
            mark.draw(inset, close, result)
        _place_inset(shown, inset, corner, whole_view(image, result.frame).window(window))
        return shown

    def find_place(self, image: Image, result: FrameResult) -> tuple[Window, tuple[int, int]] | None:
        """What is magnified, and left and top of where; None: no lines, large ones, or no room beside them."""
        view = whole_view(image, result.frame)
        window = find_window(result, view.x, self.size_px)
        if window is None:
            return None
        corner = find_corner((image.shape[1], image.shape[0]), view.window(window), self.size_px)
        return None if corner is None else (window, corner)


@dataclass(frozen=True)
class NeedleAnnotator:
    """The course and glideslope indicator in the lower left corner: needles are fly-to, what is not known is a flag.

    Args:
        side_px: of the indicator; a smaller picture gets a smaller one.
    """

    side_px: int = NEEDLES_PX

    def annotate(self, image: Image, result: FrameResult) -> Image:
        """The picture (H, W, 3) with the indicator of the result's guidance.

        Raises:
            ValueError: no image of uint8.
        """
        check_image(image)
        shown, height = image.copy(), image.shape[0]
        side = min(self.side_px, *image.shape[:2])
        margin = min(MARGIN_PX, *(size - side for size in image.shape[:2]))
        top = height - margin - side
        shown[top : top + side, margin : margin + side] = resize(draw_indicator(result.guidance), (side, side))
        return shown


def whole_view(image: Image, frame: Frame) -> Viewport:
    """How a picture (H, W, 3) shows the whole frame."""
    return Viewport(0.0, 0.0, image.shape[1] / frame.camera.width, image.shape[0] / frame.camera.height)


def match_contrast(image: Image, hazy: Image, clear: Image) -> Image:
    """An image (H, W, 3) with the gain and offset of each channel that take a hazy picture (h, w, 3) to a clear one.

    The frame is dehazed as small as it is shown; this gives a magnified part of it the same contrast.
    """
    before, after = (part.reshape(-1, 3).astype(np.float32) for part in (hazy, clear))
    means = before.mean(axis=0), after.mean(axis=0)
    covariance = ((before - means[0]) * (after - means[1])).mean(axis=0)
    gain = np.clip((covariance + MATCH_RIDGE) / (before.var(axis=0) + MATCH_RIDGE), 1 / MAX_GAIN, MAX_GAIN)
    matched: Image = np.rint((image - means[0]) * gain + means[1]).clip(0, 255).astype(np.uint8)
    return matched


def find_window(result: FrameResult, scale: float, size_px: tuple[int, int]) -> Window | None:
    """The image part to magnify to a size; None when the lines are large enough, or none.

    Args:
        scale: shown px an image px.
    """
    lines = result.estimate.pixel_lines.values()
    camera = result.frame.camera
    if not lines:
        return None
    ends = np.concatenate([line.ends_px for line in lines])
    low, high = ends.min(axis=0), ends.max(axis=0)
    aspect = size_px[0] / size_px[1]
    width = max(high[0] - low[0], (high[1] - low[1]) * aspect, MIN_WINDOW_PX * WINDOW_SHARE) / WINDOW_SHARE
    height = width / aspect
    if size_px[0] / (width * scale) < MIN_MAGNIFICATION or width > camera.width or height > camera.height:
        return None
    corner = (low + high - [width, height]) / 2
    u0 = int(np.clip(corner[0], 0, camera.width - width))
    v0 = int(np.clip(corner[1], 0, camera.height - height))
    return u0, v0, min(u0 + round(width), camera.width), min(v0 + round(height), camera.height)


def find_corner(
    size: tuple[int, int], window: Sequence[float] | NDArray[np.float64], inset: tuple[int, int] = INSET_PX
) -> tuple[int, int] | None:
    """Left and top of the magnified view in a picture of that size, where it leaves the shown window free.

    The upper left corner is the first choice, so that the view stays in place during an approach. None: no room.
    """
    u0, v0, u1, v1 = window
    far_left, far_top = (size[i] - inset[i] - MARGIN_PX for i in (0, 1))
    for top in (MARGIN_PX, far_top):
        for left in (MARGIN_PX, far_left):
            beside = left + inset[0] < u0 or left > u1 or top + inset[1] < v0 or top > v1
            if beside and far_left >= 0 and far_top >= 0:
                return left, top
    return None


def project_centre_line(frame: Frame, estimate: RunwayEstimate) -> NDArray[np.float64] | None:
    """Ends (2, 2), px, of the measured centre line in the image, as long as the lines beside it were seen.

    None without a pose or a centre line, or when it lies behind the camera.
    """
    pose, line = frame.world_from_camera, estimate.lines.get("centre")
    if pose is None or line is None or not estimate.pixel_lines:
        return None
    ends = np.concatenate([pixel_line.ends_px for pixel_line in estimate.pixel_lines.values()])
    origin, rotation = pose.translation, rotation_matrix(pose)
    on_deck = intersect_plane(origin, frame.camera.rays(ends) @ rotation.T, line.height_m)
    along_m = (on_deck - line.point_m) @ line.direction
    along_m = along_m[np.isfinite(along_m)]
    if len(along_m) < 2:
        return None
    along_m = np.linspace(along_m.min(), along_m.max(), 200)
    optical = (line.point_m + along_m[:, None] * line.direction - origin) @ rotation
    in_front = optical[optical[:, 2] > NEAR_HEIGHTS * abs(line.height_m - origin[2])]
    return frame.camera.project(in_front[[0, -1]]) if len(in_front) else None


def resize(image: Image, size: tuple[int, int]) -> Image:
    """A picture (h, w, 3) in another width and height."""
    shrinks = size[0] < image.shape[1]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
    return np.ascontiguousarray(small, dtype=np.uint8)


def _draw_points(image: Image, view: Viewport, points: LinePoints, line: PixelLine | None, colour: Colour) -> None:
    shown = view(points.points_px)
    inliers = np.zeros(len(points), dtype=bool) if line is None else line.inliers
    rows = np.sort(shown[:, 1])
    spacing = float(np.median(np.diff(rows))) if len(rows) > 1 else DOT_PX[1]
    largest = float(np.clip(1.2 * spacing, RIM_PX, DOT_PX[1]))
    radii = DOT_PX[0] + (largest - DOT_PX[0]) * np.clip(points.confidence, 0.0, 1.0)
    for at, radius, inlier in zip(shown, radii.tolist(), inliers.tolist(), strict=True):
        draw_dot(image, at, radius, colour, filled=inlier, rim=radius > RIM_PX)


def _draw_centre_line(image: Image, ends: NDArray[np.float64]) -> None:
    """Dashes, only where they are inside the picture: a near end may lie far outside."""
    height, width = image.shape[:2]
    whole = np.rint(np.clip(ends, -1e6, 1e6)).astype(int)
    inside, start, end = cv2.clipLine((0, 0, width, height), whole[0].tolist(), whole[1].tolist())
    if inside:
        draw_dashes(image, [start, end], draw.CENTRE, 1)


def crop_around(image: Image, window: Window, width_px: int) -> Image:
    """The part of a picture (h, w, 3) of a frame that is `width_px` wide, about a window of the frame."""
    scale = image.shape[1] / width_px
    u0, v0, u1, v1 = (scale * edge for edge in window)
    half = max((u1 - u0) / 2, MATCHED_PX / 2), max((v1 - v0) / 2, MATCHED_PX / 2)
    left, top = max(round((u0 + u1) / 2 - half[0]), 0), max(round((v0 + v1) / 2 - half[1]), 0)
    return image[top : round((v0 + v1) / 2 + half[1]) + 1, left : round((u0 + u1) / 2 + half[0]) + 1]


def _place_inset(image: Image, inset: Image, corner: tuple[int, int], window: NDArray[np.float64]) -> None:
    """Put the magnified view into a corner and a frame around what it shows."""
    (left, top), (height, width) = corner, inset.shape[:2]
    u0, v0, u1, v1 = window
    corners = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        draw_segment(image, [start, end], draw.INK, 1, halo=1)
    cv2.rectangle(image, (left - 2, top - 2), (left + width + 1, top + height + 1), draw.INK, -1)
    image[top : top + height, left : left + width] = inset
