"""One frame's detected points -> runway lines in the world, or why not."""

from dataclasses import dataclass, replace

import numpy as np

from deckline.localize.config import LocalizeConfig
from deckline.localize.depth import DeckPoints, choose_mode, deck_points
from deckline.localize.line_fit import LineFit, fit_alone
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.runway import (
    begin_apart,
    centre_line,
    drop_contradictions,
    drop_unsure,
    near_ends,
    pixel_contradiction,
    ramp,
    runway_line,
    shifted_line,
)
from deckline.localize.together import fit_together
from deckline.types import SIDES, DepthMode, Detection, Frame, LinePoints, PixelLine, RunwayEstimate, Status


@dataclass(frozen=True, eq=False)
class _World:
    """What could be placed in the world."""

    fits: dict[str, LineFit]  # of left and right, and of a painted centre line
    located: dict[str, DeckPoints]  # the inliers of left and right
    reason: str


def localize(frame: Frame, detection: Detection, config: LocalizeConfig, rng: np.random.Generator) -> RunwayEstimate:
    """Where the runway lines are.

    Status OK means both lines were found and agree with each other: in order, spacing, direction and in where they
    begin, if that is in view. Lines that contradict each other are dropped: "not seen" is better than wrong. Without
    pose, depth or deck height the image lines are given alone, in mode NONE, with the reason. Mode FINE means that at
    least `min_depth_share` of each line's points have a depth, COARSE that fewer have; the joint method uses all that
    there is in both, unless one was asked for by name.

    Args:
        frame: camera, pose, and depth or deck height.
        detection: points of the lines in the frame's image.
        config: method, thresholds and assumed noise.
        rng: RANSAC's draws, and the paper's order of points.

    Source: SPEC section 4.
    """
    points = {"left": detection.left, "right": detection.right}
    fitted = {side: fit_pixel_line(points[side], frame.camera, config.ransac, rng) for side in SIDES}
    pixel_lines = {side: line for side, line in fitted.items() if line is not None}
    contradiction = pixel_contradiction(pixel_lines)
    if contradiction:
        return _nothing(contradiction)
    if not pixel_lines:
        return _nothing("no line in the image")
    mode, reason = choose_mode(
        frame, [points[side].points_px[line.inliers] for side, line in pixel_lines.items()], config
    )
    if mode is DepthMode.NONE:
        return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, {}, reason=reason)
    place = _place_alone if config.method == "paper" else _place_together
    world = place(frame, detection, pixel_lines, mode, config, rng)
    pixel_lines = {side: line for side, line in pixel_lines.items() if side in world.fits}
    if not pixel_lines:
        return _nothing(world.reason)
    return _estimate(frame, detection, pixel_lines, world, mode, config)


def _place_alone(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: LocalizeConfig,
    rng: np.random.Generator,
) -> _World:
    """The paper's way: each inlier into the world, each line alone through them."""
    located = {side: _located(frame, getattr(detection, side), pixel_lines[side], mode, config) for side in pixel_lines}
    pose = frame.world_from_camera
    fits = {} if pose is None else fit_alone(located, pose.translation, config.min_points, config.noise, rng)
    missing = [f"the {side} line has too few points on the deck" for side in pixel_lines if side not in fits]
    sure, unsure = drop_unsure(fits, config.agreement)
    kept, contradiction = drop_contradictions(sure, config.agreement)
    return _World(kept, located, "; ".join(filter(None, [*missing, unsure, contradiction])))


def _place_together(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: LocalizeConfig,
    rng: np.random.Generator,
) -> _World:
    points = {"left": detection.left, "right": detection.right, "centre": detection.centre}
    painted = fit_pixel_line(detection.centre, frame.camera, config.ransac, rng)
    lines = pixel_lines if painted is None else {**pixel_lines, "centre": painted}
    found = fit_together(frame, points, lines, mode, config)
    kept, unsure = drop_unsure(found.fits, config.agreement)
    # The ramp is looked for on the deck that was found.
    located = {}
    for side in SIDES:
        if side in kept:
            height, sigma = float(kept[side].point_m[2]), float(np.sqrt(kept[side].relative_covariance[2, 2]))
            noise = replace(config.noise, deck_z_m=sigma)
            on_deck = replace(frame, deck_z_m=height)
            settings = replace(config, noise=noise)
            located[side] = _located(on_deck, points[side], pixel_lines[side], DepthMode.COARSE, settings)
    return _World(kept, located, "; ".join(filter(None, [found.reason, unsure])))


def _located(frame: Frame, points: LinePoints, line: PixelLine, mode: DepthMode, config: LocalizeConfig) -> DeckPoints:
    index = np.flatnonzero(line.inliers)
    return deck_points(frame, points.points_px[index], points.sigma_px[index], index, mode, config.noise)


def _estimate(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    world: _World,
    mode: DepthMode,
    config: LocalizeConfig,
) -> RunwayEstimate:
    fits, reasons = dict(world.fits), [world.reason] if world.reason else []
    ramp_m = ramp_sigma_m = None
    if set(SIDES) <= set(fits):
        fits["centre"] = centre_line(fits["left"], fits["right"])
        points = {"left": detection.left, "right": detection.right}
        ends = near_ends(frame, points, world.located, fits["centre"], detection.region_px)
        if isinstance(ends, str):
            reasons.append(f"no ramp: {ends}")
        elif contradiction := begin_apart(ends, fits["left"], fits["right"], config.agreement):
            return _nothing("; ".join([*reasons, contradiction]))
        else:
            ramp_m, ramp_sigma_m = ramp(ends, fits["centre"])
    elif "centre" in fits:
        fits["centre"] = shifted_line(fits["centre"], 0.0, config.deck.centre_sigma_m)  # painted, not the middle itself
    else:
        side = next(iter(fits))
        if config.runway_width_m is None:
            reasons.append(f"no centre line: only the {side} line and no runway_width_m")
        else:
            half = config.runway_width_m / 2
            fits["centre"] = shifted_line(fits[side], half if side == "left" else -half, config.deck.width_sigma_m / 2)
    lines = {side: runway_line(fit) for side, fit in fits.items()}
    return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, lines, ramp_m, ramp_sigma_m, "; ".join(reasons))


def _nothing(reason: str) -> RunwayEstimate:
    return RunwayEstimate(Status.NOT_SEEN, DepthMode.NONE, {}, {}, reason=reason)


def _status(pixel_lines: dict[str, PixelLine]) -> Status:
    return Status.OK if len(pixel_lines) == len(SIDES) else Status.ONE_LINE
