"""`deckline eval flicker`: how steady each dehazer's pictures are along a recording.

Each picture is moved onto the next one by true depth and poses, and compared with it. What differs is the warping
error. Resampling and moving waves are in it too, most of all where a far deck's details are smaller than a pixel.
Flicker is therefore taken from the difference's mean over patches, which they hardly move, and is what a dehazer has
beyond the truth without haze.
Source: Lai et al., "Learning blind video temporal consistency", 2018, section 4.3; truth in place of optical flow.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import RigidTransform

from deckline.dehaze import NOT_DEHAZED, Dehazer, restore
from deckline.files import print_line
from deckline.geometry import Camera
from deckline.recording import FrameError, open_recording
from deckline.types import Frame
from deckline_lab.evaluation.dehazers import build_dehazer, by_name
from deckline_lab.evaluation.metrics import PEAK
from deckline_lab.evaluation.tables import TO_TERMINAL, Output, Table, number, publish
from deckline_lab.rivals.catalog import ALL_DEHAZERS
from deckline_sim.progress import progress

CLEAR = "clear"  # the truth without haze; every table has it, and NOT_DEHAZED, the input
MEASURED = tuple(name for name in ALL_DEHAZERS if name != NOT_DEHAZED)
COLUMNS = {
    "error, levels": "rmse",
    "temporal PSNR, dB": "psnr_db",
    "flicker, levels": "flicker",
    "jump, levels": "jump",
    "pump, levels": "pump",
}
DECK, WATER, SKY = "deck", "water", "sky"
REGIONS = (DECK, WATER, SKY)
HULL_M = 5.0  # of the hull under the deck's height that count as deck; below lies what the water moves in front of
DEPTH_TOLERANCE = 0.01  # of the depth: more is another surface, or one seen too flat to be sampled
MIN_REGION_PX = 100  # a smaller part of a picture is left out
PATCHES = 40  # across a picture's width

Image = NDArray[np.uint8] | NDArray[np.float32]
PairErrors = dict[str, dict[str, "PairError"]]  # by the pictures' name, then by region


def flicker(
    source: tyro.conf.Positional[Path],
    dehazer: tuple[str, ...] = MEASURED,
    every: int = 1,
    limit: int | None = None,
    camera_depth_m: float = 200.0,
    output: Output = TO_TERMINAL,
) -> int:
    """Measure how steady dehazed pictures are along a recording with poses, depth and clear truth.

    Each picture is moved onto the next one by the true depth and poses, and what differs is printed: for the deck and
    what is as high, for the water below, and for the sky. flicker is how far patches a fortieth of the picture
    wide differ beyond the clear truth's own; jump how much more than the truth's the mean colour changes from frame to
    frame; pump the part of the jump that is no steady drift.

    Record with deckline sim --trajectory approach --depth.range-m inf.

    Args:
        source: recording folder.
        dehazer: names or .onnx files; the hazy input ("none") and the clear truth are always measured.
        every: take every so many-th frame.
        limit: stop after so many frames.
        camera_depth_m: the dehazers see the recorded depth up to here, as a depth camera would; 0 hides it.
        output: files of the results.
    """
    for name, value, least in (("every", every, 1), ("limit", limit, 2), ("camera-depth-m", camera_depth_m, 0)):
        if value is not None and not value >= least:
            raise ValueError(f"--{name} must be at least {least}, got {value}")
    named = by_name(name for name in dehazer if name != NOT_DEHAZED)
    if CLEAR in named:
        raise ValueError(f"{named[CLEAR]} would be called {CLEAR}, as the truth is: rename the file or its folder")
    dehazers = {name: build_dehazer(given) for name, given in named.items()}
    steps = _restore_all(source, every, limit, dehazers, camera_depth_m)
    figures = flicker_figures(list(sequence_errors(steps)), truth=CLEAR)
    title = f"{source}: pairs of frames: {figures['pairs']:.0f}, every {every}, depth up to {camera_depth_m:g} m"
    tables = [_table(region, [CLEAR, NOT_DEHAZED, *dehazers], figures) for region in REGIONS]
    publish(title, tables, figures, output)
    return 0


def _restore_all(
    source: Path, every: int, limit: int | None, dehazers: Mapping[str, Dehazer], camera_depth_m: float
) -> Iterator[tuple[Frame, dict[str, NDArray[np.uint8]]] | None]:
    """Every so many-th frame of a recording, `limit` at most, with its pictures; None for one that cannot be read."""
    recording = open_recording(source)
    indices = range(0, len(recording), every)[:limit]
    notes = set()
    with progress("evaluating", len(indices)) as advance:
        for index in indices:
            advance()
            try:
                frame = recording.load(index)
            except FrameError as error:
                print_line(f"skipped {error}")
                yield None
                continue
            pictures = {CLEAR: clear_picture(frame), NOT_DEHAZED: frame.image_rgb}
            for name, dehazer in dehazers.items():
                restored = restore(dehazer, without_truth(frame, camera_depth_m))
                pictures[name] = restored.image_rgb
                if restored.note and (name, restored.note) not in notes:
                    notes.add((name, restored.note))
                    print_line(f"{frame.file}: {name}: {restored.note}")
            yield frame, pictures


def without_truth(frame: Frame, camera_depth_m: float) -> Frame:
    """What a dehazer may see of a frame: no truth, and depth only as far as a depth camera reaches; 0: none."""
    depth = None
    if frame.depth_m is not None and camera_depth_m > 0:
        with np.errstate(invalid="ignore"):
            depth = np.where(frame.depth_m <= camera_depth_m, frame.depth_m, np.float32(np.nan))
    return replace(frame, depth_m=depth, truth=None)


def clear_picture(frame: Frame) -> NDArray[np.uint8]:
    """The frame without its haze (H, W, 3); a ValueError where there is none."""
    if frame.truth is not None and frame.truth.clear_rgb is not None:
        return frame.truth.clear_rgb
    if frame.truth is not None and frame.truth.visibility_m == np.inf:
        return frame.image_rgb
    raise ValueError(
        f"{frame.file}: no picture without haze to compare with; record with deckline sim, which records it"
    )


def _table(region: str, names: list[str], figures: Mapping[str, float]) -> Table:
    rows = [
        (name, *(number(figures.get(f"{name}.{region}.{key}"), ".2f") for key in COLUMNS.values())) for name in names
    ]
    return Table(region, ("dehazer", *COLUMNS), rows)


@dataclass(frozen=True, eq=False)
class Warp:
    """Where the pixels of a frame lie in the frame before it."""

    before_px: NDArray[np.float32]  # (H, W, 2) u, v there; -1 where there is nothing to compare
    regions: dict[str, NDArray[np.bool_]]  # (H, W) by region: in view of both frames


@dataclass(frozen=True, eq=False)
class PairError:
    """How a picture differs from the one before it, moved onto it."""

    mse: float  # squared levels
    patch_mse: float  # squared levels, of the difference's mean over the patch about each pixel
    jump: NDArray[np.float64]  # (3,) mean of red, green and blue, levels: after minus before


def compute_warp(before: Frame, after: Frame) -> Warp:
    """Where each pixel of `after` lies in `before`, by true poses and depth.

    What is as high as the deck moves with the ship, the rest stays; a ship whose pose is not known in both counts as
    still. Above the horizon, unknown depth is the sky, which is endlessly far; depth must therefore reach as far as the
    ship. Inverse depth is sampled: along a plane it is linear in the image.

    Raises:
        ValueError: a frame without pose, depth or deck height; pictures of different size.
    """
    if before.image_rgb.shape != after.image_rgb.shape:
        raise ValueError(f"{after.file}: {after.image_rgb.shape} px follow {before.image_rgb.shape} of {before.file}")
    inverse_before, _, _ = inverse_depth(before)
    inverse, rays, height_z = inverse_depth(after)
    pose_before, pose, deck_z_m = before.true_world_from_camera, after.true_world_from_camera, after.deck_z_m
    if pose_before is None or pose is None or deck_z_m is None:  # as inverse_depth has checked
        raise ValueError(f"{after.file}: no pose or deck height")
    is_deck = height_z < deck_z_m + HULL_M
    px = np.full((*inverse.shape, 2), -1, np.float32)
    expected = np.full(inverse.shape, np.nan)
    for part, motion in ((is_deck, ship_motion(before, after)), (~is_deck, RigidTransform.identity())):
        before_from_after = pose_before.inv() * motion * pose
        px[part], expected[part] = _project(before.camera, before_from_after, rays[part], inverse[part])
    with np.errstate(invalid="ignore"):
        visible = np.abs(sample(inverse_before.astype(np.float32), px) - expected) <= DEPTH_TOLERANCE * expected
    camera = before.camera
    visible &= (px >= 0).all(axis=2) & (px[..., 0] <= camera.width - 1) & (px[..., 1] <= camera.height - 1)
    px[~visible] = -1
    is_water = (inverse > 0) & ~is_deck
    return Warp(px, {DECK: visible & is_deck, WATER: visible & is_water, SKY: visible & (inverse == 0)})


def inverse_depth(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Of each pixel 1 / depth (H, W), 1/m; its ray with z = 1 (H, W, 3), optical; the world z (H, W) of what it shows.

    1 / depth is 0 in the sky and NaN where the depth is unknown; world z is infinite in both.
    """
    pose, depth_m, camera = frame.true_world_from_camera, frame.depth_m, frame.camera
    if pose is None or depth_m is None or frame.deck_z_m is None:
        values = {"pose": pose, "depth": depth_m, "deck height": frame.deck_z_m}
        missing = " and no ".join(name for name, value in values.items() if value is None)
        raise ValueError(
            f"{frame.file}: no {missing}; record with deckline sim --trajectory approach --depth.range-m inf"
        )
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    down = pose.rotation.apply(np.nan_to_num(rays))[:, 2]
    depth = depth_m.astype(np.float64).ravel()
    measured = np.isfinite(depth) & (depth > 0)
    inverse = np.where(measured, 1 / np.where(measured, depth, 1), np.where(down < 0, 0, np.nan))
    inverse[np.isnan(rays).any(axis=1)] = np.nan
    height_z = np.full(len(rays), np.inf)
    known = inverse > 0
    height_z[known] = down[known] / inverse[known] + pose.translation[2]
    shape = (camera.height, camera.width)
    return inverse.reshape(shape), np.nan_to_num(rays).reshape(*shape, 3), height_z.reshape(shape)


def ship_motion(before: Frame, after: Frame) -> RigidTransform:
    """Where a point of the ship was in the world at `before`, from where it is at `after`."""
    was, now = (None if frame.truth is None else frame.truth.world_from_ship for frame in (before, after))
    return RigidTransform.identity() if was is None or now is None else was * now.inv()


def _project(
    camera: Camera, before_from_after: RigidTransform, rays: NDArray[np.float64], inverse: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) and inverse depths (N,) before of rays (N, 3) and inverse depths (N,) after."""
    points = (
        rays @ before_from_after.rotation.as_matrix().T
        + np.nan_to_num(inverse)[:, None] * before_from_after.translation
    )
    pixels = camera.project(points)
    ahead = np.isfinite(pixels).all(axis=1) & np.isfinite(inverse)
    expected = np.where(ahead, inverse / np.where(ahead, points[:, 2], 1), np.nan)
    return np.where(ahead[:, None], pixels, -1), expected


def sample(picture: Image, before_px: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture (H, W) or (H, W, 3) at pixels (H, W, 2), between four neighbours; NaN beside NaN."""
    source = np.asarray(picture, dtype=np.float32)
    where = np.moveaxis(before_px, 2, 0)[::-1]
    if source.ndim == 2:
        return np.asarray(map_coordinates(source, where, order=1, mode="nearest"))
    return np.stack([sample(source[..., k], before_px) for k in range(source.shape[2])], axis=2)


def pair_errors(before: Image, after: Image, warp: Warp) -> dict[str, PairError]:
    """By region, how the picture `after` (H, W, 3), levels, differs from `before` (H, W, 3) moved onto it."""
    difference = np.asarray(after, dtype=np.float32) - sample(before, warp.before_px)
    errors = {}
    for name, region in warp.regions.items():
        if np.count_nonzero(region) >= MIN_REGION_PX:
            inside = difference[region].astype(np.float64)
            patches = patch_means(difference, region)[region].astype(np.float64)
            errors[name] = PairError(float(np.mean(inside**2)), float(np.mean(patches**2)), inside.mean(axis=0))
    return errors


def patch_means(values: NDArray[np.float32], region: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Mean (H, W, 3) of values (H, W, 3) over that part of the square patch about each pixel that is in the region."""
    side = max(1, round(values.shape[1] / PATCHES)) // 2 * 2 + 1
    inside = region.astype(np.float32)
    sums = cv2.blur(values * inside[..., None], (side, side), borderType=cv2.BORDER_CONSTANT)
    counts = cv2.blur(inside, (side, side), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums / np.maximum(counts, np.float32(1e-6))[..., None], dtype=np.float32)


def sequence_errors(steps: Iterable[tuple[Frame, Mapping[str, Image]] | None]) -> Iterator[PairErrors]:
    """Errors of each two frames that follow each other, of the pictures (H, W, 3) by name that come with each frame.

    None marks a missing frame: its neighbours are not compared.
    """
    last: tuple[Frame, Mapping[str, Image]] | None = None
    for step in steps:
        if last is not None and step is not None:
            warp = compute_warp(last[0], step[0])
            yield {name: pair_errors(last[1][name], picture, warp) for name, picture in step[1].items()}
        last = step


def flicker_figures(pairs: list[PairErrors], truth: str) -> dict[str, float]:
    """Figures of a sequence, levels, under the dotted names picture.region.figure.

    rmse: warping error; psnr_db: the same as temporal PSNR; flicker: the warping error of patches beyond the truth's
    own, by squares, 0 when it has less; jump: how much more than the truth's the mean colour changes from frame to
    frame, rms; pump: the part of that which does not go on in the same way in the next frame, for a slow drift is no
    flicker. `truth` names the pictures that the others are measured against; its own jump and pump are absolute.

    Raises:
        ValueError: no pairs.
    """
    if not pairs:
        raise ValueError("no two frames follow each other: nothing to compare")
    figures = {"pairs": float(len(pairs))}
    for name in pairs[0]:
        for region in REGIONS:
            own = [(pair[name][region], pair[truth][region]) for pair in pairs if region in pair[name]]
            if own:
                values = _region_figures(own, is_truth=name == truth)
                figures |= {f"{name}.{region}.{key}": value for key, value in values.items()}
    return figures


def _region_figures(own: list[tuple[PairError, PairError]], is_truth: bool) -> dict[str, float]:
    mse = float(np.mean([error.mse for error, _ in own]))
    patches, floor = (float(np.mean([errors[k].patch_mse for errors in own])) for k in (0, 1))
    jumps = np.array([error.jump - (0 if is_truth else true.jump) for error, true in own])
    figures = {
        "rmse": float(np.sqrt(mse)),
        "psnr_db": float(10 * np.log10(PEAK**2 / mse)) if mse > 0 else float("inf"),
        "flicker": float(np.sqrt(max(patches - floor, 0.0))),
        "jump": float(np.sqrt(np.mean(jumps**2))),
    }
    if len(jumps) > 1:
        figures["pump"] = float(np.sqrt(np.mean((np.diff(jumps, axis=0) / 2) ** 2)))
    return figures
