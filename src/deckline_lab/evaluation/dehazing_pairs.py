"""Pairs of a hazy and a clear picture, from recordings with clear truth and from labelled folders; and hazy pictures
of which no clear one exists.

A labelled folder's labels.json names for a hazy image the clear one of the same pose as `pair_of`, and may give its
`visibility_m`: {"frames": [{"file": "a_hazy.png", "pair_of": "a.png", "visibility_m": 900, ...}]}.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.geometry import Camera
from deckline.recording import BadFrame, FrameError, Recording, open_recording
from deckline.recording.image_folder import ImageFolder
from deckline.recording.images import read_image
from deckline.recording.source import is_inside, parse_json, read_text
from deckline.truth import range_to_ramp_m
from deckline.types import SIDES, Frame, Truth
from deckline_lab.evaluation.metrics import distance_px, normal_pixel_error
from deckline_lab.labels.lines import LABELS_FILE, Labels, read_labels
from deckline_sim.visible_line import VisibleLine, find_visible_line

FILMS = ("dry and sharp", "rain", "motion blur", "rain and motion blur")
LEAST_LINE_PX = 5.0  # of both lines inside the picture, end to end: shorter ones are not in view
LINE_SAMPLES = 400  # points along a line, to find its part in view

Distances = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # points (N, 2), px -> (N,) off the true line, px


@dataclass(frozen=True, eq=False)
class Pair:
    """A hazy picture and the clear one, where that is known."""

    frame: Frame  # hazy, without truth: dehazers never see it
    clear_rgb: NDArray[np.uint8] | None  # (H, W, 3)
    surface: NDArray[np.bool_] | None  # (H, W) sea and ship; None when there is no depth to know it from
    visibility_m: float  # 2 % contrast; NaN when unknown
    lines: Mapping[str, Distances] | None  # None: not both true lines are in view, or nobody knows them
    film: str | None = None  # of FILMS; None: not known
    in_view: tuple[VisibleLine, ...] = ()  # left and right as far as in the picture; empty: not both, or no ranges
    range_m: float = math.nan  # aircraft to the ramp, horizontal; NaN when unknown


@dataclass(frozen=True)
class PairSource:
    """A source of pairs, each loaded on demand and not cached.

    `load` takes one of the keys; it raises FrameError for a pair that cannot be used.
    """

    name: str  # absolute path
    keys: tuple[str, ...]
    load: Callable[[str], Pair]


def open_pairs(
    path: Path,
    every: int = 1,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    with_depth: bool = False,
) -> PairSource:
    """A recording or pictures, with or without clear ones.

    Args:
        path: of a recording, folder, picture or video. Of a folder with "pair_of" in labels.json only pairs are taken.
        every: take every so many of its pairs, from the first on.
        deck_z_m, sea_z_m: world z (down) of the deck plane and of the water; override the files' values.
        with_depth: give dehazers the recorded depth. A dataset's is exact and reaches everywhere, as no camera's does.

    Raises:
        ValueError: no such source.
    """
    if every < 1:
        raise ValueError(f"every must be 1 or more, got {every}")
    source = open_recording(path, deck_z_m=deck_z_m, sea_z_m=sea_z_m)
    if isinstance(source, ImageFolder) and (path / LABELS_FILE).is_file():
        return _labelled(path, source, every, with_depth)

    has_clear = _has_clear(source)
    keys = tuple(str(index) for index in range(0, len(source), every))
    return PairSource(str(path.resolve()), keys, lambda key: _recorded(source.load(int(key)), with_depth, has_clear))


def _has_clear(source: Recording) -> bool:
    """Recordings hold the clear picture of every frame or of none: the first readable frame decides."""
    for frame in source.items():
        if not isinstance(frame, BadFrame):
            return frame.truth is not None and frame.truth.clear_rgb is not None
    return True


def _recorded(frame: Frame, with_depth: bool, has_clear: bool) -> Pair:
    truth = frame.truth or Truth()
    if has_clear and truth.clear_rgb is None:
        raise FrameError(frame.file, "it has no clear picture")
    visibility_m = math.nan if truth.visibility_m is None else truth.visibility_m
    pair = _pair(frame, truth.clear_rgb, visibility_m, true_lines(frame), with_depth)
    segments = [segment for segment in (truth.left, truth.right) if segment is not None]
    seen = [find_visible_line(frame, segment, within_visibility=False) for segment in segments]
    in_view = tuple(line for line in seen if line is not None)
    in_view = in_view if len(in_view) == len(SIDES) else ()
    return replace(pair, film=film_of(truth.conditions), in_view=in_view, range_m=range_to_ramp_m(frame))


def _labelled(folder: Path, source: ImageFolder, every: int, with_depth: bool) -> PairSource:
    entries = read_pairs(folder / LABELS_FILE)
    labels = read_labels(folder / LABELS_FILE)
    missing = [file for file in entries if file not in source.files]
    if missing:
        raise ValueError(f"{folder / LABELS_FILE}: there is no image {missing[0]} in {folder}")

    def load(key: str) -> Pair:
        frame, lines = source.load(source.files.index(key)), None
        if key in labels:
            lines = labelled_lines(labels[key], frame.camera)
        if not entries:
            return _pair(frame, None, math.nan, lines, with_depth)
        clear_file, visibility_m = entries[key]
        try:
            clear = read_image(folder / clear_file)
        except ValueError as error:
            raise FrameError(frame.file, f"its clear picture {clear_file}: {error}") from None
        return _pair(frame, clear, visibility_m, lines, with_depth)

    keys = tuple(file for file in source.files if file in entries or not entries)[::every]
    return PairSource(str(folder.resolve()), keys, load)


def _pair(
    frame: Frame,
    clear_rgb: NDArray[np.uint8] | None,
    visibility_m: float,
    lines: Mapping[str, Distances] | None,
    with_depth: bool,
) -> Pair:
    if clear_rgb is not None and clear_rgb.shape != frame.image_rgb.shape:
        sizes = [f"{image.shape[1]}x{image.shape[0]} px" for image in (clear_rgb, frame.image_rgb)]
        raise FrameError(frame.file, f"its clear picture is {sizes[0]}, the hazy one {sizes[1]}")
    surface = None if frame.depth_m is None else np.isfinite(frame.depth_m)
    depth_m = frame.depth_m if with_depth else None
    return Pair(replace(frame, truth=None, depth_m=depth_m), clear_rgb, surface, visibility_m, lines)


def read_pairs(path: Path) -> dict[str, tuple[str, float]]:
    """Hazy image file -> its clear file and visibility, m, NaN when unknown; from a labels.json.

    Raises:
        ValueError: an image named twice, a `pair_of` that is no other file in the folder, or a visibility that is none.
    """
    frames: list[dict[str, Any]] = parse_json(read_text(path), str(path))["frames"]
    entries = {}
    for entry in frames:
        clear, visibility = entry.get("pair_of"), entry.get("visibility_m")
        if clear is None:
            continue
        where = f"{path}: {entry['file']}"
        if not isinstance(clear, str) or not is_inside(clear):
            raise ValueError(f"{where}: pair_of must name the clear image in this folder, or be null, got {clear!r}")
        if clear == entry["file"]:
            raise ValueError(f"{where}: pair_of must name another image than the hazy one itself")
        if entry["file"] in entries:
            raise ValueError(f"{where} has two entries: give each hazy image one")
        known = isinstance(visibility, int | float) and not isinstance(visibility, bool)
        if visibility is not None and not (known and visibility > 0):
            raise ValueError(f"{where}: visibility_m must be positive metres, or left out, got {visibility!r}")
        entries[entry["file"]] = (clear, math.nan if visibility is None else float(visibility))
    return entries


def true_lines(frame: Frame) -> dict[str, Distances] | None:
    """For each side the distance of points to the true line; None when not both lines are in view, or not known."""
    truth, pose, camera = frame.truth, frame.true_world_from_camera, frame.camera
    if truth is None or truth.left is None or truth.right is None or pose is None:
        return None
    lines: dict[str, Distances] = {}
    for side, segment in zip(SIDES, (truth.left, truth.right), strict=True):
        steps = np.linspace(0.0, 1.0, LINE_SAMPLES)[:, None]
        samples = pose.inv().apply(segment.p0_m + steps * (segment.p1_m - segment.p0_m))
        if seen_length_px(camera.project(samples), camera) < LEAST_LINE_PX:
            return None
        lines[side] = partial(normal_pixel_error, ends_optical_m=samples[[0, -1]], camera=camera)
    return lines


def labelled_lines(labels: Labels, camera: Camera) -> dict[str, Distances] | None:
    """The same for lines labelled in the image; None when not both are labelled and in view."""
    lines: dict[str, Distances] = {}
    for side in SIDES:
        line = labels[side]
        if line is None:
            return None
        at = np.linspace(0, len(line) - 1, LINE_SAMPLES)
        samples = np.stack([np.interp(at, np.arange(len(line)), line[:, axis]) for axis in (0, 1)], axis=1)
        if seen_length_px(samples, camera) < LEAST_LINE_PX:
            return None
        lines[side] = partial(distance_px, line_px=line, camera=camera)
    return lines


def seen_length_px(samples_px: ArrayLike, camera: Camera) -> float:
    """Distance between the ends of that part of a line, given as points (N, 2) along it, that is inside the image."""
    samples = np.asarray(samples_px, dtype=np.float64)
    size = [camera.width - 1, camera.height - 1]
    inside = samples[np.all((samples >= 0) & (samples <= size), axis=1)]  # NaN, behind the camera, is not inside
    return float(np.linalg.norm(inside[-1] - inside[0])) if len(inside) > 1 else 0.0


def film_of(conditions: Mapping[str, Any]) -> str | None:
    """Which of FILMS a picture is, by its truth's exposure, rain and drops on the lens; None: unknown."""
    exposure = conditions.get("exposure")
    if not isinstance(exposure, Mapping):
        return None
    values = [exposure.get(name) for name in ("rain_mm_h", "lens_drops", "exposure_s")]
    numbers = [value for value in values if isinstance(value, int | float)]
    if len(numbers) < len(values):
        return None
    rain, drops, exposure_s = numbers
    return FILMS[(rain > 0 or drops > 0) + 2 * (exposure_s > 0)]
