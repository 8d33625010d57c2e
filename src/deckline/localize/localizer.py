"""One frame's detected points -> runway lines in the world, or the reason why there are none."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from deckline.config import FrameNoise, RunConfig
from deckline.localize.depth import MIN_LINE_POINTS, DeckPoints, choose_mode, count_depths, locate_points
from deckline.localize.joint_fit import fit_jointly
from deckline.localize.line_fit import (
    LineFit,
    average_lines,
    check_near_ends,
    check_pixel_order,
    drop_unsure,
    find_near_ends,
    ramp_from_ends,
    shift_line,
)
from deckline.localize.model import CENTRE_SIGMA_M
from deckline.localize.ransac import fit_pixel_line
from deckline.types import (
    SIDES,
    DepthMode,
    Detection,
    Diagnostic,
    Diagnostics,
    Frame,
    LinePoints,
    LineVisibility,
    PixelLine,
    Reason,
    RunwayEstimate,
)

NO_LINE = Diagnostic(Reason.NO_LINE, "no line in the image")
LOWEST_DECK_M = 0.5  # above the water
PLAUSIBLE_WIDTHS_M = (10.0, 35.0)  # of landing runways of ships; beyond, the sign of the deck height is checked


@dataclass(frozen=True, eq=False)
class PlacedLines:
    """The lines that an estimator placed in the world."""

    fits: dict[str, LineFit]
    """Of `left` and `right`, and of a painted `centre` line."""
    deck_points: dict[str, DeckPoints]
    """The inliers of `left` and `right`."""
    diagnostics: Diagnostics
    """Why other lines are missing."""
    depth_confirms_height: bool = False
    """As in `RunwayEstimate`."""


# Frame, points, image lines of `left` and `right`, depth mode, configuration and RANSAC's draws -> lines in the world.
Placement = Callable[[Frame, Detection, dict[str, PixelLine], DepthMode, RunConfig, np.random.Generator], PlacedLines]


class Localizer(Protocol):
    """What every estimator of the lines in the world is: a function."""

    __name__: str  # in reports

    def __call__(
        self, frame: Frame, detection: Detection, config: RunConfig, rng: np.random.Generator
    ) -> RunwayEstimate:
        """The runway of one frame alone.

        Args:
            frame: camera, pose, and depth or deck height, as far as they are known.
            detection: points of the lines in the frame's image, px.
            config: sensors, deck and depth mode.
            rng: RANSAC's draws.

        Returns:
            Lines in the image and in the world, or why there are none.
        """
        ...


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
    fits, diagnostics = fit_jointly(frame, points, lines, mode, config)
    accepted, unsure = drop_unsure(fits)
    # The ramp lies on the deck plane of the fit.
    inliers = {}
    for side in SIDES:
        if side in accepted:
            height, sigma = float(accepted[side].point_m[2]), float(np.sqrt(accepted[side].relative_covariance[2, 2]))
            noise = replace(config.noise, deck_z_m=sigma)
            inliers[side] = locate_inliers(frame, points[side], pixel_lines[side], DepthMode.COARSE, noise, height)
            if not len(inliers[side]):
                del accepted[side]
                unsure += (Diagnostic(Reason.NO_POINTS, f"no point of the {side} line lies on the plane of its fit"),)
    agrees = False
    if frame.depth_m is not None and mode is DepthMode.COARSE and config.localization.mode == "auto":
        counts = count_depths(frame.depth_m, [points[side].points_px[pixel_lines[side].inliers] for side in inliers])
        is_believed = all(diagnostic.reason is not Reason.DEPTH_HEIGHT for diagnostic in diagnostics)
        agrees = is_believed and min(counts, default=0) >= MIN_LINE_POINTS
    return PlacedLines(accepted, inliers, diagnostics + unsure, agrees)


def localize(
    frame: Frame,
    detection: Detection,
    config: RunConfig,
    rng: np.random.Generator,
    place: Placement = place_jointly,
) -> RunwayEstimate:
    """Runway lines in the world from the points of one frame.

    Both lines count as seen when they agree in order, spacing, direction and near ends. Lines that contradict each
    other are dropped: no line is better than a wrong one. Without pose, depth or deck height the estimate has only the
    image lines, in mode NONE, and the reason. In mode FINE at least half of each line's points have a depth, in COARSE
    fewer; in mode `auto` the fit uses both depth and deck height. `place` is the estimator of the lines in the world,
    the rest as of a `Localizer`.

    Source: Li et al. 2024, section 3.2.
    """
    points = {"left": detection.left, "right": detection.right}
    fitted = {side: fit_pixel_line(points[side], frame.camera, rng) for side in SIDES}
    pixel_lines = {side: line for side, line in fitted.items() if line is not None}
    if crossed := check_pixel_order(pixel_lines):
        return _not_seen((crossed,))
    if not pixel_lines:
        return _not_seen((NO_LINE,))
    inliers = [points[side].points_px[line.inliers] for side, line in pixel_lines.items()]
    mode, missing = choose_mode(frame, inliers, config.localization.mode)
    if missing is not None:
        return RunwayEstimate(_seen(pixel_lines), mode, pixel_lines, {}, diagnostics=(missing,))
    placed = place(frame, detection, pixel_lines, mode, config, rng)
    pixel_lines = {side: line for side, line in pixel_lines.items() if side in placed.fits}
    if not pixel_lines:
        return _not_seen(placed.diagnostics)
    return _estimate(frame, detection, pixel_lines, placed, mode, config)


def locate_inliers(
    frame: Frame,
    points: LinePoints,
    line: PixelLine,
    mode: DepthMode,
    noise: FrameNoise,
    deck_z_m: float | None = None,
) -> DeckPoints:
    """A line's inliers on the deck, of this height or, without one, of the frame's."""
    index = np.flatnonzero(line.inliers)
    return locate_points(frame, points.points_px[index], points.sigma_px[index], index, mode, noise, deck_z_m)


def _estimate(
    frame: Frame,
    detection: Detection,
    pixel_lines: dict[str, PixelLine],
    placed: PlacedLines,
    mode: DepthMode,
    config: RunConfig,
) -> RunwayEstimate:
    fits, diagnostics = dict(placed.fits), placed.diagnostics
    flags: Diagnostics = ()
    ramp_m = ramp_sigma_m = None
    if set(SIDES) <= set(fits):
        fits["centre"] = average_lines(fits["left"], fits["right"])
        points = {"left": detection.left, "right": detection.right}
        ends = find_near_ends(frame, points, placed.deck_points, fits["centre"], detection.region_px)
        if isinstance(ends, Diagnostic):
            diagnostics += (ends,)
        elif contradiction := check_near_ends(ends, fits["left"], fits["right"]):
            return _not_seen((*diagnostics, contradiction))
        else:
            ramp_m, ramp_sigma_m = ramp_from_ends(ends, fits["centre"])
        flags = _check_deck_sign(frame, fits, config)
    elif "centre" in fits:
        fits["centre"] = shift_line(fits["centre"], 0.0, CENTRE_SIGMA_M)  # a painted line is not exactly midway
    else:
        (side,) = fits
        centre = _centre_beside(side, fits[side], config)
        if centre is None:
            missing = Diagnostic(Reason.NO_CENTRE_LINE, f"no centre line: only the {side} line and no runway width")
            diagnostics += (missing,)
        else:
            fits["centre"] = centre
    lines = {side: fit.runway_line for side, fit in fits.items()}
    return RunwayEstimate(
        _seen(pixel_lines),
        mode,
        pixel_lines,
        lines,
        ramp_m,
        ramp_sigma_m,
        diagnostics,
        flags,
        placed.depth_confirms_height,
    )


def _centre_beside(side: str, edge: LineFit, config: RunConfig) -> LineFit | None:
    """The centre line beside the only edge line; None without the runway's width."""
    width = config.frame_deck.width_m
    if width is None:
        return None
    return shift_line(edge, width / 2 if side == "left" else -width / 2, config.deck.width_sigma_m / 2)


def _check_deck_sign(frame: Frame, fits: dict[str, LineFit], config: RunConfig) -> Diagnostics:
    """Flag a deck height of the wrong sign: it is below the water, or the spacing of the lines is plausible only with
    the other sign.

    The spacing is proportional to the camera's height above the deck.
    """
    pose, deck_z_m = frame.world_from_camera, frame.deck_z_m
    if deck_z_m is not None and frame.sea_z_m is not None and deck_z_m > frame.sea_z_m - LOWEST_DECK_M:
        message = f"the deck height of {deck_z_m:g} m is that of the water ({frame.sea_z_m:g} m) or below it"
        return (Diagnostic(Reason.DECK_SIGN, message),)
    if pose is None or deck_z_m is None or config.deck.width_m is not None:
        return ()
    height, other = deck_z_m - float(pose.translation[2]), -deck_z_m - float(pose.translation[2])
    spacing = abs(float((fits["right"].point_m - fits["left"].point_m)[:2] @ fits["centre"].right))
    expected = spacing * other / height if height > 0 else 0.0
    if spacing <= PLAUSIBLE_WIDTHS_M[1] or not PLAUSIBLE_WIDTHS_M[0] <= expected <= PLAUSIBLE_WIDTHS_M[1]:
        return ()
    message = (
        f"the deck height of {deck_z_m:g} m seems to have the wrong sign (z is down): the lines come out "
        f"{spacing:.0f} m apart, and {expected:.0f} m with {-deck_z_m:g} m; if it is right, state the runway's width"
    )
    return (Diagnostic(Reason.DECK_SIGN, message),)


def _not_seen(diagnostics: Diagnostics) -> RunwayEstimate:
    return RunwayEstimate(LineVisibility.NONE, DepthMode.NONE, {}, {}, diagnostics=diagnostics)


def _seen(pixel_lines: dict[str, PixelLine]) -> LineVisibility:
    return LineVisibility.BOTH if len(pixel_lines) == len(SIDES) else LineVisibility.ONE
