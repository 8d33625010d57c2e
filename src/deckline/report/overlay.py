"""What people see of a frame: hazy and dehazed picture side by side, a far deck magnified, the instrument below."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.flight import FrameResult
from deckline.geometry import intersect_plane
from deckline.report import draw
from deckline.report.draw import Colour, Image, draw_dashes, draw_dot, draw_segment, draw_text, measure_text, shorten
from deckline.report.instrument import BAND, draw_instrument
from deckline.types import SIDES, Frame, Guidance, LinePoints, PixelLine, RunwayEstimate

PANEL_PX = (640, 360)  # width, height of each picture at most
MATCHED_PX = 24  # width of the dehazed part that a magnified view is matched to, at least
MATCH_RIDGE = 4.0  # grey levels squared: contrast below which nothing is told of it
MAX_GAIN = 10.0  # of contrast
INSET_PX = (272, 153)  # width, height of the magnified view
INSET_MARGIN_PX = 10
MIN_MAGNIFICATION = 2.0  # a smaller gain is not worth hiding a corner for
WINDOW_SHARE = 0.6  # of the magnified view's width or height that the lines fill
MIN_WINDOW_PX = 48  # width of the magnified part of the image, at least
DOT_PX = (1.5, 4.0)  # radius of a point of no and of full confidence, where points lie apart
RIM_PX = 2.2  # smaller points have no dark rim: they would be all rim
COLOURS = {"left": draw.LEFT, "right": draw.RIGHT}
NEAR_M = 1.0  # the centre line is drawn from this far in front of the camera
HEADER_PX = 40
OVERLAY_PX = (2 * PANEL_PX[0], HEADER_PX + PANEL_PX[1] + BAND[1])  # width, height; both even, as H.264 wants
Window = tuple[int, int, int, int]  # u0, v0, u1, v1, px, ends excluded


@dataclass(frozen=True, eq=False)
class Panels:
    """The two pictures of a frame, each at most 640x360 px, in the image's proportions."""

    hazy: Image  # (h, w, 3)
    marked: Image  # (h, w, 3) dehazed, with what was found
    not_dehazed: str | None = None  # why it is as the camera saw it


@dataclass(frozen=True)
class View:
    """A part of the full image shown at another size; (0, 0) is a pixel's centre in both."""

    left_px: float
    top_px: float
    x: float  # shown pixels per image pixel
    y: float

    def __call__(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image pixels (N, 2) as they are shown."""
        return (points_px + 0.5 - [self.left_px, self.top_px]) * [self.x, self.y] - 0.5

    def window(self, window: Window) -> NDArray[np.float64]:
        """u0, v0, u1, v1 of a part of the image."""
        return self(np.array(window, dtype=np.float64).reshape(2, 2)).ravel()


def draw_panels(result: FrameResult) -> Panels:
    """The small pictures of one result."""
    camera, hazy_rgb = result.frame.camera, result.frame.image_rgb
    clear_rgb = result.dehazing.shown(max(PANEL_PX)).image_rgb
    scale = min(PANEL_PX[0] / camera.width, PANEL_PX[1] / camera.height)
    size = max(round(camera.width * scale), 2), max(round(camera.height * scale), 2)
    view = View(0.0, 0.0, size[0] / camera.width, size[1] / camera.height)
    hazy, clear = _resize(hazy_rgb, size), _resize(clear_rgb, size)
    marked = clear.copy()
    window = find_window(result, view.x)
    corner = None if window is None else find_corner(size, view, window)
    _mark(marked, view, result, with_points=corner is None)
    if window is not None and corner is not None:
        u0, v0, u1, v1 = window
        hazy_inset = _magnify(hazy_rgb, window, camera.width)
        marked_inset = match_contrast(hazy_inset, *(_around(image, window, camera.width) for image in (hazy, clear)))
        close = View(u0, v0, INSET_PX[0] / (u1 - u0), INSET_PX[1] / (v1 - v0))
        _mark(marked_inset, close, result, with_points=True)
        _place_inset(hazy, hazy_inset, corner, view, window)
        _place_inset(marked, marked_inset, corner, view, window)
    return Panels(hazy, marked, result.dehazing.note)


def match_contrast(image: Image, hazy: Image, clear: Image) -> Image:
    """An image (H, W, 3) with the gain and offset of each channel that take a hazy picture (h, w, 3) to a clear one.

    The frame is dehazed as small as it is shown; this brings a magnified part of it to the same look.
    """
    before, after = (part.reshape(-1, 3).astype(np.float32) for part in (hazy, clear))
    means = before.mean(axis=0), after.mean(axis=0)
    covariance = ((before - means[0]) * (after - means[1])).mean(axis=0)
    gain = np.clip((covariance + MATCH_RIDGE) / (before.var(axis=0) + MATCH_RIDGE), 1 / MAX_GAIN, MAX_GAIN)
    matched: Image = np.rint((image - means[0]) * gain + means[1]).clip(0, 255).astype(np.uint8)
    return matched


def _around(image: Image, window: Window, width_px: int) -> Image:
    """The part of a picture (h, w, 3) of a frame that is `width_px` wide, about a window of the frame."""
    scale = image.shape[1] / width_px
    u0, v0, u1, v1 = (scale * edge for edge in window)
    half = max((u1 - u0) / 2, MATCHED_PX / 2), max((v1 - v0) / 2, MATCHED_PX / 2)
    left, top = max(round((u0 + u1) / 2 - half[0]), 0), max(round((v0 + v1) / 2 - half[1]), 0)
    return image[top : round((v0 + v1) / 2 + half[1]) + 1, left : round((u0 + u1) / 2 + half[0]) + 1]


def find_window(result: FrameResult, scale: float) -> Window | None:
    """The image part to magnify; None when the lines are large enough, or none. `scale`: panel px an image px."""
    lines = result.estimate.pixel_lines.values()
    camera = result.frame.camera
    if not lines:
        return None
    ends = np.concatenate([line.ends_px for line in lines])
    low, high = ends.min(axis=0), ends.max(axis=0)
    aspect = INSET_PX[0] / INSET_PX[1]
    width = max(high[0] - low[0], (high[1] - low[1]) * aspect, MIN_WINDOW_PX * WINDOW_SHARE) / WINDOW_SHARE
    height = width / aspect
    if INSET_PX[0] / (width * scale) < MIN_MAGNIFICATION or width > camera.width or height > camera.height:
        return None
    corner = (low + high - [width, height]) / 2
    u0 = int(np.clip(corner[0], 0, camera.width - width))
    v0 = int(np.clip(corner[1], 0, camera.height - height))
    return u0, v0, min(u0 + round(width), camera.width), min(v0 + round(height), camera.height)


def find_corner(size: tuple[int, int], view: View, window: Window) -> tuple[int, int] | None:
    """Left and top of the magnified view in a panel of that size, where it leaves the window free.

    The upper left corner is the first choice, so that the view stays in place during an approach. None: no room.
    """
    u0, v0, u1, v1 = view.window(window)
    far_left, far_top = (size[i] - INSET_PX[i] - INSET_MARGIN_PX for i in (0, 1))
    for top in (INSET_MARGIN_PX, far_top):
        for left in (INSET_MARGIN_PX, far_left):
            beside = left + INSET_PX[0] < u0 or left > u1 or top + INSET_PX[1] < v0 or top > v1
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
    directions = pose.rotation.apply(frame.camera.rays(ends))
    on_deck = intersect_plane(pose.translation, directions, line.height_m)
    along_m = (on_deck - line.point_m) @ line.direction
    along_m = along_m[np.isfinite(along_m)]
    if len(along_m) < 2:
        return None
    along_m = np.linspace(along_m.min(), along_m.max(), 200)
    optical = pose.inv().apply(line.point_m + along_m[:, None] * line.direction)
    in_front = optical[optical[:, 2] > NEAR_M]
    return frame.camera.project(in_front[[0, -1]]) if len(in_front) else None


def draw_overlay(frame: Frame, guidance: Guidance, pictures: Panels) -> Image:
    """The whole overlay picture, (648, 1280, 3)."""
    image = draw.blank(*OVERLAY_PX)
    for column, picture in enumerate((pictures.hazy, pictures.marked)):
        height, width = picture.shape[:2]
        left = column * PANEL_PX[0] + (PANEL_PX[0] - width) // 2
        top = HEADER_PX + (PANEL_PX[1] - height) // 2
        image[top : top + height, left : left + width] = picture
    image[HEADER_PX : HEADER_PX + PANEL_PX[1], PANEL_PX[0] - 1 : PANEL_PX[0] + 1] = draw.BACKGROUND
    image[HEADER_PX + PANEL_PX[1] :] = draw_instrument(guidance)
    draw_text(image, "HAZY", (16, 26), 15, draw.INK, 600)
    draw_text(image, "as the camera saw it", (68, 26), 14, draw.DIM)
    title = "DEHAZED" if pictures.not_dehazed is None else "NOT DEHAZED"
    draw_text(image, title, (PANEL_PX[0] + 16, 26), 15, draw.INK, 600)
    draw_text(image, "with the lines found", (PANEL_PX[0] + 28 + measure_text(title, 15, 600), 26), 14, draw.DIM)
    time = f"  ·  {frame.time_s:.6f} s"
    name = shorten(frame.file, 14, 380 - measure_text(time, 14)) + time
    draw_text(image, name, (OVERLAY_PX[0] - 16 - measure_text(name, 14), 26), 14, draw.DIM)
    return image


def _mark(image: Image, view: View, result: FrameResult, with_points: bool) -> None:
    centre = project_centre_line(result.frame, result.estimate)
    if centre is not None:
        _draw_centre_line(image, view(centre))
    for side in SIDES:
        line = result.estimate.pixel_lines.get(side)
        colour = COLOURS[side]
        if with_points:
            _draw_points(image, view, getattr(result.detection, side), line, colour)
            red, green, blue = (round(c + 0.65 * (255 - c)) for c in colour)  # mixed with white, to be seen on points
            colour = red, green, blue
        if line is not None:
            draw_segment(image, view(line.ends_px), colour, 1 if with_points else 2, halo=0)


def _draw_points(image: Image, view: View, points: LinePoints, line: PixelLine | None, colour: Colour) -> None:
    """Points sized by their confidence; those that RANSAC left out are rings."""
    shown = view(points.points_px)
    kept = np.zeros(len(points), dtype=bool) if line is None else line.inliers
    rows = np.sort(shown[:, 1])
    spacing = float(np.median(np.diff(rows))) if len(rows) > 1 else DOT_PX[1]
    largest = float(np.clip(1.2 * spacing, RIM_PX, DOT_PX[1]))
    for at, confidence, inlier in zip(shown, points.confidence, kept, strict=True):
        radius = DOT_PX[0] + (largest - DOT_PX[0]) * float(np.clip(confidence, 0.0, 1.0))
        draw_dot(image, at, radius, colour, filled=bool(inlier), rim=radius > RIM_PX)


def _draw_centre_line(image: Image, ends: NDArray[np.float64]) -> None:
    """Dashes, only where they are inside the picture: a near end may lie far outside."""
    height, width = image.shape[:2]
    whole = np.rint(np.clip(ends, -1e6, 1e6)).astype(int)
    inside, start, end = cv2.clipLine((0, 0, width, height), whole[0].tolist(), whole[1].tolist())
    if inside:
        draw_dashes(image, [start, end], draw.CENTRE, 1)


def _place_inset(panel: Image, inset: Image, corner: tuple[int, int], view: View, window: Window) -> None:
    left, top = corner
    u0, v0, u1, v1 = view.window(window)
    corners = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        draw_segment(panel, [start, end], draw.INK, 1, halo=1)
    cv2.rectangle(panel, (left - 2, top - 2), (left + INSET_PX[0] + 1, top + INSET_PX[1] + 1), draw.INK, -1)
    panel[top : top + INSET_PX[1], left : left + INSET_PX[0]] = inset


def _magnify(image: Image, window: Window, width: int) -> Image:
    """The magnified view of a window of the frame, from the frame, this wide, or from a smaller copy of it."""
    corners = np.rint(np.array(window) * (image.shape[1] / width)).astype(int).reshape(2, 2)
    (u0, v0), (u1, v1) = corners[0], np.maximum(corners[1], corners[0] + 1)
    return _resize(image[v0:v1, u0:u1], INSET_PX)


def _resize(image: Image, size: tuple[int, int]) -> Image:
    shrinks = size[0] < image.shape[1]
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC)
    return np.ascontiguousarray(small, dtype=np.uint8)
