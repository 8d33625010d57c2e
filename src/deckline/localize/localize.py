"""One frame's detected points -> runway lines in the world, or why not."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from deckline.config import FrameNoise, RunConfig
from deckline.localize.depth import DeckPoints, choose_mode, deck_points
from deckline.localize.joint_fit import fit_jointly
from deckline.localize.model import CENTRE_SIGMA_M
from deckline.localize.ransac import fit_pixel_line
from deckline.localize.runway import (
    LineFit,
    centre_line,
    check_near_ends,
    check_pixel_order,
    drop_unsure,
    near_ends,
    ramp,
    runway_line,
    shift_line,
)
from deckline.types import (
    SIDES,
    DepthMode,
    Detection,
    Frame,
    LinePoints,
    Notice,
    Notices,
    PixelLine,
    Reason,
    RunwayEstimate,
    Status,
)

NO_LINE = Notice(Reason.NO_LINE, "no line in the image")
USUAL_WIDTH_M = (10.0, 35.0)  # of a runway that a deck height of the right sign shows


@dataclass(frozen=True, eq=False)
class PlacedLines:
    """The lines that could be placed in the world."""

    fits: dict[str, LineFit]  # of left and right, and of a painted centre line
    located: dict[str, DeckPoints]  # the inliers of left and right
    notices: Notices


Placement = Callable[[Frame, Detection, dict[str, PixelLine], DepthMode, RunConfig, np.random.Generator], PlacedLines]

Localizer = Callable[[Frame, Detection, RunConfig, np.random.Generator], RunwayEstimate]


def place_jointly(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: RunConfig,
    rng: np.random.Generator,
) -> PlacedLines:
    """All lines, the deck and the errors of pose and camera in one fit."""
    points = {"left": detection.left, "right": detection.right, "centre": detection.centre}
    painted = fit_pixel_line(detection.centre, frame.camera, rng)
    lines = pixel_lines if painted is None else {**pixel_lines, "centre": painted}
    fits, notices = fit_jointly(frame, points, lines, mode, config)
    kept, unsure = drop_unsure(fits)
    # The ramp lies on the deck plane of the fit.
    located = {}
    for side in SIDES:
        if side in kept:
            height, sigma = float(kept[side].point_m[2]), float(np.sqrt(kept[side].relative_covariance[2, 2]))
            noise = replace(config.noise, deck_z_m=sigma)
            on_deck = replace(frame, deck_z_m=height)
            located[side] = locate_inliers(on_deck, points[side], pixel_lines[side], DepthMode.COARSE, noise)
    return PlacedLines(kept, located, notices + unsure)


def localize(
    frame: Frame,
    detection: Detection,
    config: RunConfig,
    rng: np.random.Generator,
    place: Placement = place_jointly,
) -> RunwayEstimate:
    """Where the runway lines are.

    Status OK means both lines were found and agree with each other: in order, spacing, direction and in where they
    begin, if that is in view. Lines that contradict each other are dropped: "not seen" is better than wrong. Without
    pose, depth or deck height the image lines are given alone, in mode NONE, with the reason. Mode FINE means that at
    least half of each line's points have a depth, COARSE that fewer have; the joint fit uses both sources unless one
    was asked for by name.

    Args:
        frame: camera, pose, and depth or deck height.
        detection: points of the lines in the frame's image.
        config: sensors, deck and depth mode.
        rng: RANSAC's draws.
        place: how image lines become lines in the world.

    Source: Li et al. 2024, section 3.2.
    """
    points = {"left": detection.left, "right": detection.right}
    fitted = {side: fit_pixel_line(points[side], frame.camera, rng) for side in SIDES}
    pixel_lines = {side: line for side, line in fitted.items() if line is not None}
    crossed = check_pixel_order(pixel_lines)
    if crossed is not None:
        return _not_seen((crossed,))
    if not pixel_lines:
        return _not_seen((NO_LINE,))
    inliers = [points[side].points_px[line.inliers] for side, line in pixel_lines.items()]
    mode, missing = choose_mode(frame, inliers, config.localization.mode)
    if missing is not None:
        return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, {}, notices=(missing,))
    placed = place(frame, detection, pixel_lines, mode, config, rng)
    pixel_lines = {side: line for side, line in pixel_lines.items() if side in placed.fits}
    if not pixel_lines:
        return _not_seen(placed.notices)
    return _estimate(frame, detection, pixel_lines, placed, mode, config)


def locate_inliers(frame: Frame, points: LinePoints, line: PixelLine, mode: DepthMode, noise: FrameNoise) -> DeckPoints:
    """A line's inliers on the deck."""
    index = np.flatnonzero(line.inliers)
    return deck_points(frame, points.points_px[index], points.sigma_px[index], index, mode, noise)


def _estimate(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    placed: PlacedLines,
    mode: DepthMode,
    config: RunConfig,
) -> RunwayEstimate:
    fits, notices = dict(placed.fits), placed.notices
    flags: Notices = ()
    ramp_m = ramp_sigma_m = None
    if set(SIDES) <= set(fits):
        fits["centre"] = centre_line(fits["left"], fits["right"])
        points = {"left": detection.left, "right": detection.right}
        ends = near_ends(frame, points, placed.located, fits["centre"], detection.region_px)
        if isinstance(ends, Notice):
            notices += (ends,)
        elif apart := check_near_ends(ends, fits["left"], fits["right"]):
            return _not_seen((*notices, apart))
        else:
            ramp_m, ramp_sigma_m = ramp(ends, fits["centre"])
        flags = _check_deck_sign(frame, fits, config)
    elif "centre" in fits:
        fits["centre"] = shift_line(fits["centre"], 0.0, CENTRE_SIGMA_M)  # painted, not the middle itself
    else:
        side = next(iter(fits))
        width = config.frame_deck.width_m
        if width is None:
            notices += (Notice(Reason.NO_CENTRE_LINE, f"no centre line: only the {side} line and no runway width"),)
        else:
            half = width / 2 if side == "left" else -width / 2
            fits["centre"] = shift_line(fits[side], half, config.deck.width_sigma_m / 2)
    lines = {side: runway_line(fit) for side, fit in fits.items()}
    return RunwayEstimate(_status(pixel_lines), mode, pixel_lines, lines, ramp_m, ramp_sigma_m, notices, flags)


def _check_deck_sign(frame: Frame, fits: dict[str, LineFit], config: RunConfig) -> Notices:
    """A flag where the reported deck height has the wrong sign: the lines come out too wide, and usual with the other.

    The spacing of the lines is proportional to the camera's height over the deck.
    """
    pose, deck_z_m = frame.world_from_camera, frame.deck_z_m
    if pose is None or deck_z_m is None or config.deck.width_m is not None:
        return ()
    height, other = deck_z_m - float(pose.translation[2]), -deck_z_m - float(pose.translation[2])
    spacing = abs(float((fits["right"].point_m - fits["left"].point_m)[:2] @ fits["centre"].right))
    expected = spacing * other / height if height > 0 else 0.0
    if spacing <= USUAL_WIDTH_M[1] or not USUAL_WIDTH_M[0] <= expected <= USUAL_WIDTH_M[1]:
        return ()
    message = (
        f"the deck height of {deck_z_m:g} m seems to have the wrong sign (z is down): the lines come out "
        f"{spacing:.0f} m apart, and {expected:.0f} m with {-deck_z_m:g} m; if it is right, state the runway's width"
    )
    return (Notice(Reason.DECK_SIGN, message),)


def _not_seen(notices: Notices) -> RunwayEstimate:
    return RunwayEstimate(Status.NOT_SEEN, DepthMode.NONE, {}, {}, notices=notices)


def _status(pixel_lines: dict[str, PixelLine]) -> Status:
    return Status.OK if len(pixel_lines) == len(SIDES) else Status.ONE_LINE
