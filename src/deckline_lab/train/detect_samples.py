"""One training sample: a view with its lines -> the network's input and its targets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from deckline.checks import check_numbers
from deckline.detect.anchors import EDGES, STRIDE, RowGrid
from deckline.detect.crop import Crop, full_crop, normalise, sample_crop
from deckline.types import EdgeKind
from deckline_lab.train.airlight import random_airlight
from deckline_lab.train.detect_losses import DetectTargets
from deckline_lab.train.line_targets import encode, encode_region
from deckline_lab.train.line_views import LineView
from deckline_lab.train.view_sets import Views
from deckline_sim.camera.foreground import draw_foreground, lay_over
from deckline_sim.camera.phone import phone_picture
from deckline_sim.camera.sensor import jpeg

# Grey levels between an edge line and what it lies on: white paint on a dark deck, asphalt beside grass, a lamp.
EDGE_CONTRAST = {EdgeKind.PAINT: 100.0, EdgeKind.PAVEMENT: 40.0, EdgeKind.LIGHTS: 100.0}
VISIBLE_CONTRAST = 1.5  # grey levels; paint with less of it left is "no line here"
HIDDEN = 0.5  # of a foreground's cover
VISIBLE_SHARE = 0.15  # of both lines' points; with less there is no runway in the view
CLOSE_MIN_PX = 4.0  # a box narrower than that in the frame gets no close crop
MIRRORED = [1, 0, 2]  # the left line is then the right one
MARGIN_PX = 12  # around a crop, for blur and resampling
OBJECT_M = 5000.0  # ranges are cut off here, so that the horizon is no object
OBJECT_STEP = 0.1  # of a range's logarithm from one column to the next; the sea has no such step
BACKDROP_M = (2e3, 3e4)  # to a photograph behind a view, log-uniform
BESIDE = 0.35  # largest distance of an object from the middle of a close crop, relative to the crop's size


@dataclass(frozen=True)
class DetectAugmentation:
    """How training views are made. Shares are probabilities."""

    haze_share: float = 0.75
    optical_depth_max: float = 3.2  # of the haze up to the ramp; uniform from 0
    horizon_share: float = 0.4  # of the airlights are near the sky's colour, the others random
    fade_share: float = 0.25  # contrast taken off without haze
    close_share: float = 0.55  # of close crops, around the runway; the others show most of the image
    empty_share: float = 0.06  # of close crops beside the runway
    object_share: float = 0.8  # of those, and of close crops without a runway, at an object: a ship, a coast
    flip_share: float = 0.5
    rotate_share: float = 0.35
    rotate_max_deg: float = 5.0
    centre_jitter: float = 0.25  # of a close crop, relative to the box
    fill: tuple[float, float] = (0.36, 0.86)  # of a close crop by the runway; the runtime aims at 0.6
    min_width_px: tuple[float, float] = (30.0, 64.0)  # of a close crop in 640-px frames
    wide_scale: tuple[float, float] = (0.55, 1.3)  # of a wide crop, relative to the whole image
    colour_share: float = 0.7
    grey_share: float = 0.1
    blur_share: float = 0.25
    vertical_blur_share: float = 0.25
    noise_share: float = 0.6
    noise_max: float = 8.0  # grey levels, 1-sigma; most views get much less
    jpeg_share: float = 0.3
    jpeg_scale: tuple[float, float] = (0.1, 2.0)  # of the standard's tables, log-uniform; from quality 95 to 25
    patch_share: float = 0.2
    backdrop_share: float = 0.15  # of the views with sky get a photograph's instead, where there are photographs
    foreground_share: float = 0.3  # seen from a cockpit, past a drone's legs, through dirty glass, under captions
    phone_share: float = 0.25  # taken as phones and video do
    upside_down_share: float = 0.02  # turned by 180 degrees: no runway

    def __post_init__(self) -> None:
        check_numbers(self, "", *(name for name in vars(self) if name.endswith("_share")), least=0, most=1)


class TrainingSample(NamedTuple):
    """One view (3, height, width), and its encoded truth: what `DetectTargets` has, of one image."""

    image: NDArray[np.float32]
    cell: NDArray[np.float32]
    known: NDArray[np.bool_]
    region: NDArray[np.float32]
    box: NDArray[np.float32]
    box_weight: NDArray[np.float32]
    edge: np.int64


class _Scene(NamedTuple):
    """A hazy, flipped, rotated view."""

    image: NDArray[np.float32]  # (H, W, 3) grey levels
    lines_px: NDArray[np.float64]  # (3, N, 2) left, right, centre; N is 0 where there is no runway
    visible: NDArray[np.bool_]  # (3, N) painted and not lost in haze
    known: NDArray[np.bool_]  # (3,) lines whose truth is known
    objects_px: NDArray[np.float64]  # (0 or 1, 2) edge of an object: a ship, a coast


def make_sample(
    view: LineView,
    grid: RowGrid,
    augment: DetectAugmentation,
    rng: np.random.Generator,
    backdrops: Sequence[NDArray[np.uint8]] = (),
) -> TrainingSample:
    """Haze, flip, rotate, a foreground, choose a crop, degrade it, sample it. A labelled picture gets no haze.

    `backdrops` are photographs (H, W, 3) to take the sky's place.
    """
    if len(backdrops) and rng.random() < augment.backdrop_share:
        view = _replace_sky(view, backdrops[int(rng.integers(len(backdrops)))], rng)
    scene = _turn(_add_haze(view, augment, rng), augment, rng)
    if rng.random() < augment.foreground_share:
        scene = _lay_foreground(scene, rng)
    height, width = scene.image.shape[:2]
    box = visible_box(scene.lines_px[:2], scene.visible[:2], (0, 0, width - 1, height - 1))
    crop = choose_crop(box, scene.objects_px, (width, height), (grid.width, grid.height), augment, rng)
    u0, v0, u1, v1 = crop.bounds(grid.width, grid.height)
    left, top = (int(np.clip(np.floor(edge) - MARGIN_PX, 0, None)) for edge in (u0, v0))
    left, top = min(left, width - 1), min(top, height - 1)
    right, bottom = int(max(np.ceil(u1) + MARGIN_PX, left + 1)), int(max(np.ceil(v1) + MARGIN_PX, top + 1))
    size = (1e3, 1e3) if box is None else (box[2] - box[0], box[3] - box[1])
    part = degrade(scene.image[top:bottom, left:right], size, augment, rng)
    inner = Crop(crop.left - left, crop.top - top, crop.step)
    image = normalise(sample_crop(part, inner, (grid.width, grid.height)))
    cell, region, offsets, weight = encode_view(scene.lines_px, scene.visible, crop, (width, height), grid)
    edge = -1 if view.edge is None or region[-1] == 1 else EDGES.index(view.edge)
    return TrainingSample(image, cell, scene.known, region, offsets, weight, np.int64(edge))


def make_batch(
    views: Views[LineView],
    batch: int,
    grid: RowGrid,
    augment: DetectAugmentation,
    seed: list[int],
    backdrops: Sequence[NDArray[np.uint8]] = (),
) -> tuple[Tensor, DetectTargets]:
    """Views (batch, 3, height, width) and targets; the same for the same seed, so that resuming changes nothing."""
    rng = np.random.default_rng(seed)
    samples = [make_sample(views.draw(rng), grid, augment, rng, backdrops) for _ in range(batch)]
    columns = [torch.from_numpy(np.stack(column)) for column in zip(*samples, strict=True)]
    return columns[0], DetectTargets(*columns[1:])


def encode_view(
    lines_px: NDArray[np.float64], visible: NDArray[np.bool_], crop: Crop, image_size: tuple[int, int], grid: RowGrid
) -> tuple[NDArray[np.float32], ...]:
    """Targets of a crop: cell (3, rows), region classes, box offsets, box weights; the edges define the runway.

    Args:
        lines_px: (3, N, 2) left, right and centre, image px.
        visible: (3, N) which points are painted and not lost in haze.
        crop: the network's part of the image.
        image_size: width and height of the image.
        grid: the row anchors.
    """
    region_grid = (grid.width // STRIDE, grid.height // STRIDE)
    lines = crop.to_network(lines_px.reshape(-1, 2)).reshape(lines_px.shape)
    edges = crop.to_network([[-0.5, -0.5], [image_size[0] - 0.5, image_size[1] - 0.5]])
    low, high = np.maximum(edges[0], 0), np.minimum(edges[1], [grid.width - 1, grid.height - 1])
    box = None
    if visible.size and visible[:2].mean() >= VISIBLE_SHARE:
        box = visible_box(lines[:2], visible[:2], (*low, *high))
    if box is None or box[2] - box[0] < 2 or box[3] - box[1] < 1:
        return np.full((len(lines), grid.rows), np.nan, dtype=np.float32), *encode_region(None, region_grid)
    cell = np.stack([encode(*line, grid) for line in zip(lines, visible, strict=True)])
    x = grid.x_from_cell(cell)
    inside = (x > edges[0, 0]) & (x < edges[1, 0]) & (grid.row_y > edges[0, 1]) & (grid.row_y < edges[1, 1])
    cell[~inside] = np.nan
    return cell, *encode_region(box, region_grid)


def visible_box(
    lines_px: NDArray[np.float64], visible: NDArray[np.bool_], limits: tuple[float, float, float, float]
) -> NDArray[np.float64] | None:
    """Bounding box (u0, v0, u1, v1) of the visible points inside limits (u0, v0, u1, v1); None without any."""
    points = lines_px[visible]
    points = points[np.all((points >= limits[:2]) & (points <= limits[2:]), axis=1)]
    if len(points) < 2:
        return None
    box = np.concatenate([points.min(axis=0), points.max(axis=0)])
    return box if box[2] > box[0] and box[3] > box[1] else None


def _add_haze(view: LineView, augment: DetectAugmentation, rng: np.random.Generator) -> _Scene:
    """The view in random haze or faded; which points of the lines can still be seen."""
    image = view.image_rgb.astype(np.float32)
    lines = np.zeros((3, 0, 2)) if view.lines_px is None else view.lines_px
    if view.clear is None:  # what a person labelled can be seen
        seen = np.asarray(np.isfinite(lines).all(axis=2))
        return _Scene(image, lines, seen, np.array([True, True, view.lines_px is None]), np.zeros((0, 2)))
    ranges = view.clear.range_m.astype(np.float32)
    line_ranges = np.zeros((3, 0)) if view.ranges_m is None else view.ranges_m
    contrast = np.full(line_ranges.shape, EDGE_CONTRAST[view.edge or EdgeKind.PAINT])
    contrast[2] *= bool(view.centre_painted)
    object_px, object_m = _find_object(ranges, rng)
    if rng.random() < augment.haze_share:
        ramp_m = float(line_ranges.min()) if line_ranges.size else object_m
        beta = rng.uniform(0, augment.optical_depth_max) / max(ramp_m, 20.0)
        airlight = random_airlight(view.clear.horizon_rgb, augment.horizon_share, rng).astype(np.float32)
        image = airlight + (image - airlight) * np.exp(-np.float32(beta) * ranges)[..., None]
        contrast = contrast * np.exp(-beta * line_ranges)
    if rng.random() < augment.fade_share:
        fade = rng.uniform(0.2, 0.8)
        image = np.float32(rng.uniform(40, 220)) * np.float32(1 - fade) + image * np.float32(fade)
        contrast = contrast * fade
    known = np.array([True, True, view.lines_px is None or view.centre_painted is not None])
    return _Scene(image, lines, contrast >= VISIBLE_CONTRAST, known, object_px)


def _replace_sky(view: LineView, photograph: NDArray[np.uint8], rng: np.random.Generator) -> LineView:
    """The view with a random part of a photograph where its sky was, so far away that haze dims it."""
    if view.clear is None:
        return view
    height, width = view.image_rgb.shape[:2]
    scale = max(width / photograph.shape[1], height / photograph.shape[0]) * rng.uniform(1.0, 1.5)
    size = (max(width, round(photograph.shape[1] * scale)), max(height, round(photograph.shape[0] * scale)))
    shown = cv2.resize(photograph, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    top, left = int(rng.integers(size[1] - height + 1)), int(rng.integers(size[0] - width + 1))
    shown = shown[top : top + height, left : left + width]
    sky, far_m = np.isinf(view.clear.range_m), np.float16(np.exp(rng.uniform(*np.log(BACKDROP_M))))
    clear = replace(view.clear, range_m=np.where(sky, far_m, view.clear.range_m))
    return replace(view, image_rgb=np.where(sky[..., None], shown, view.image_rgb), clear=clear)


def _lay_foreground(scene: _Scene, rng: np.random.Generator) -> _Scene:
    """What hides the scene from its camera; the lines behind it cannot be seen."""
    height, width = scene.image.shape[:2]
    runway = visible_box(scene.lines_px[:2], scene.visible[:2], (0, 0, width - 1, height - 1))
    foreground = draw_foreground(width, height, rng, runway)
    at = np.nan_to_num(scene.lines_px, nan=-1.0).round()
    u, v = np.clip(at, 0, [width - 1, height - 1]).astype(int).transpose(2, 0, 1)
    visible = scene.visible & (foreground.cover[v, u] < HIDDEN)
    return scene._replace(image=lay_over(scene.image, foreground), visible=visible)


def _find_object(ranges_m: NDArray[np.float32], rng: np.random.Generator) -> tuple[NDArray[np.float64], float]:
    """A pixel (1, 2) at which the range (H, W) jumps from one column to the next, and how far the nearer side is, m.

    Without such a jump: no pixel (0, 2), and the median range.
    """
    near = np.minimum(ranges_m, OBJECT_M)
    depth = np.log(np.maximum(near, 1.0))
    jumps = np.flatnonzero(np.abs(np.diff(depth, axis=1)) > OBJECT_STEP)
    if not len(jumps):
        return np.zeros((0, 2)), float(np.median(near))
    row, column = divmod(int(rng.choice(jumps)), ranges_m.shape[1] - 1)
    return np.array([[column + 0.5, row]]), float(near[row, column : column + 2].min())


def _turn(scene: _Scene, augment: DetectAugmentation, rng: np.random.Generator) -> _Scene:
    """Mirrored left to right and rotated, each at random."""
    image, lines, visible, known, objects = scene
    if rng.random() < augment.flip_share:
        image, lines, visible, objects = image[:, ::-1], lines[MIRRORED], visible[MIRRORED], objects.copy()
        for points in (lines, objects):
            points[..., 0] = image.shape[1] - 1 - points[..., 0]
    if rng.random() < augment.upside_down_share:
        none = np.zeros((3, 0, 2)), np.zeros((3, 0), dtype=bool), np.ones(3, dtype=bool), np.zeros((0, 2))
        return _Scene(np.ascontiguousarray(image[::-1, ::-1]), *none)
    if rng.random() < augment.rotate_share:
        angle = np.deg2rad(rng.uniform(-augment.rotate_max_deg, augment.rotate_max_deg))
        image, matrix, offset = rotate(image, angle)
        lines, objects = (points @ matrix.T + offset for points in (lines, objects))
    return _Scene(image, lines, visible, known, objects)


def choose_crop(
    box: NDArray[np.float64] | None,
    objects_px: NDArray[np.float64],
    image_size: tuple[int, int],
    network_size: tuple[int, int],
    augment: DetectAugmentation,
    rng: np.random.Generator,
) -> Crop:
    """A crop close around the runway, at an object or anywhere, or of most of the image.

    Without a runway as many crops are close as with one: a detector crops closely whatever it takes for a runway.
    """
    net = np.array(network_size, dtype=np.float64)
    size = np.array(image_size, dtype=np.float64)
    whole = full_crop(image_size, network_size)
    narrowest = rng.uniform(*augment.min_width_px) / net[0]
    close = rng.random() < augment.close_share
    if close and box is not None and box[2] - box[0] >= CLOSE_MIN_PX:
        extent = box[2:] - box[:2]
        step = float(max(np.max(extent / net) / rng.uniform(*augment.fill), narrowest))
        middle = (box[:2] + box[2:]) / 2 + rng.uniform(-1, 1, 2) * augment.centre_jitter * extent
        step = min(step, whole.step * augment.wide_scale[1])
    elif (close and box is None) or rng.random() < augment.empty_share / max(1 - augment.close_share, 1e-6):
        step = float(np.exp(rng.uniform(np.log(narrowest), np.log(whole.step))))
        if len(objects_px) and rng.random() < augment.object_share:
            middle = objects_px[0] + rng.uniform(-BESIDE, BESIDE, 2) * net * step
        else:
            middle = rng.uniform(0, 1, 2) * (size - 1)
    elif rng.random() < 0.4:
        return whole
    else:
        step = whole.step * rng.uniform(*augment.wide_scale)
        middle = (size - 1) / 2 + rng.uniform(-0.5, 0.5, 2) * np.abs(size - net * step)
        if box is not None and rng.random() < 0.85:  # the runway's middle stays in the crop
            reach = net * step * 0.47
            centre = (box[:2] + box[2:]) / 2
            middle = np.clip(middle, centre - reach, centre + reach)
    left, top = middle + 0.5 - net * step / 2
    return Crop(float(left), float(top), step)


def rotate(
    image: NDArray[np.float32], angle_rad: float
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """An image (H, W, C) turned about its middle, its edges mirrored.

    Returns:
        image; (2, 2) and (2,) of the map of its points: new = matrix @ old + offset, px.
    """
    height, width = image.shape[:2]
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    matrix = np.array([[cosine, -sine], [sine, cosine]])
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    offset = middle - matrix @ middle
    new_from_old = np.column_stack([matrix, offset])
    rotated = cv2.warpAffine(np.ascontiguousarray(image), new_from_old, (width, height), borderMode=cv2.BORDER_REFLECT)
    return np.asarray(rotated, np.float32).reshape(image.shape), matrix, offset


def recolour(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Exposure, gamma, white balance and saturation of another camera."""
    levels = np.clip(image / 255.0, 0.0, 1.0) ** np.float32(np.exp(rng.uniform(-0.5, 0.5)))
    levels *= rng.uniform(0.6, 1.25) * (1 + rng.normal(0, 0.07, 3)).astype(np.float32)
    grey = levels.mean(axis=2, keepdims=True)
    levels = grey + (levels - grey) * np.float32(rng.uniform(0.2, 1.7))
    return np.clip(levels * 255.0, 0.0, 255.0).astype(np.float32)


def blur(image: NDArray[np.float32], sigma_v_px: float, sigma_u_px: float) -> NDArray[np.float32]:
    """Gaussian blur, its widths apart: a renderer's mip-maps and far flat decks blur along v only."""
    width, height = (2 * round(3 * sigma) + 1 for sigma in (sigma_u_px, sigma_v_px))  # 1 px: no blur
    blurred = cv2.GaussianBlur(image, (width, height), sigma_u_px, sigmaY=sigma_v_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def compress(image: NDArray[np.float32], scale: float) -> NDArray[np.float32]:
    """The image after JPEG with `scale` times the standard's quantisation tables: 1 is libjpeg's quality 50."""
    quality = round(100 - 50 * scale if scale < 1 else 50 / scale)
    levels = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return jpeg(levels, quality).astype(np.float32)


def degrade(
    image: NDArray[np.float32], box_size_px: tuple[float, float], augment: DetectAugmentation, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Colour, blur, noise, compression and patches; blur stays small against the runway's (width, height)."""
    if rng.random() < augment.colour_share:
        image = recolour(image, rng)
    if rng.random() < augment.grey_share:
        image = np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)
    if rng.random() < augment.patch_share:
        image = _add_patches(image, rng)
    if rng.random() < augment.phone_share:
        image = phone_picture(image, rng)
    if rng.random() < augment.blur_share:
        sigma = rng.uniform(0.3, min(2.0, 0.3 + 0.04 * box_size_px[0]))
        image = blur(image, sigma, sigma)
    if rng.random() < augment.vertical_blur_share:
        image = blur(image, rng.uniform(0.3, min(5.0, 0.5 + 0.1 * box_size_px[1])), 0.0)
    if rng.random() < augment.noise_share:
        noise = rng.standard_normal(image.shape, dtype=np.float32)
        image = image + noise * np.float32(augment.noise_max * rng.random() ** 2)
    if rng.random() < augment.jpeg_share:
        image = compress(image, float(np.exp(rng.uniform(*np.log(augment.jpeg_scale)))))
    return np.clip(np.rint(image), 0, 255)


def _add_patches(image: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Up to three rectangles of one colour: parked or flying objects before the runway."""
    image = image.copy()
    height, width = image.shape[:2]
    for _ in range(rng.integers(1, 4)):
        tall, wide = max(1, int(height * rng.uniform(0.02, 0.2))), max(1, int(width * rng.uniform(0.02, 0.2)))
        top, left = rng.integers(0, height - tall + 1), rng.integers(0, width - wide + 1)
        image[top : top + tall, left : left + wide] = rng.uniform(10, 240) + rng.normal(0, 15, 3)
    return image
