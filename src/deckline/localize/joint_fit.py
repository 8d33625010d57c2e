"""Image lines in, line fits with their noise sensitivities out: start, joint fit, consistency tests."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import Deck, FrameNoise, RunConfig
from deckline.geometry import wrap_angle
from deckline.localize.model import (
    CENTRE_SIGMA_M,
    CENTRE_SIGMA_RAD,
    MIN_SIGMA_M,
    NUISANCES,
    PARALLEL_FACTOR,
    State,
    rights,
)
from deckline.localize.observations import Observations, initial_height, initial_line, observe
from deckline.localize.runway import LineFit, drop_contradictions
from deckline.localize.solver import Solution, solve
from deckline.types import SIDES, DepthMode, Frame, LineErrors, LinePoints, Notice, Notices, PixelLine, Reason

Array = NDArray[np.float64]
HEIGHT_GATE_SIGMA = 4.0  # between the reported deck height and the depth camera
CENTRE_GATE_SIGMA = 4.0  # between a painted centre line and the middle of the edge lines
MAX_CENTRE_SHARE = 0.15  # of the spacing, that a centre line may lie off the middle of a runway's edge lines
MIN_SHARE, MIN_RAD = 1e-7, 1e-7  # floor of a nuisance's 1-sigma, so that its sensitivity exists
SOURCES = 11  # attitude about x, y, z, position along x, y, z, deck height, focal length, depth scale, deck slopes


def fit_jointly(
    frame: Frame,
    points: dict[str, LinePoints],
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: RunConfig,
) -> tuple[dict[str, LineFit], Notices]:
    """Fits of `left`, `right` and a painted `centre`, first without the prior of the lines' geometry, then with it.

    The first fit tests the lines against each other, and the depth camera against the reported deck height. Of these
    two the one that gives the frame its mode is believed when they contradict each other.

    Args:
        frame: camera and pose, depth image and deck height as far as there are.
        points: the detected points of each line.
        pixel_lines: the lines in the image.
        mode: FINE when most points have a depth.
        config: sensors and deck.

    Returns:
        The fits that agree with each other, and why others are missing.
    """
    noise, asked = _with_floor(config.noise), config.localization.mode
    view, notices = observe(frame, points, pixel_lines, asked)
    deck_z_m = None if asked == "fine" else frame.deck_z_m
    view, start, lost = _start(frame, view, pixel_lines, deck_z_m, asked == "fine")
    notices += lost
    if start is None:
        return {}, notices
    alone = solve(view, start, noise, config.frame_deck, deck_z_m)
    if abs(alone.height_score) > HEIGHT_GATE_SIGMA and np.isfinite(view.log_depth).any():
        believed = "depth camera" if mode is DepthMode.FINE else "deck height"
        message = f"depth camera and reported deck height contradict each other: the {believed} is believed"
        notices += (Notice(Reason.DEPTH_HEIGHT, message),)
        if mode is DepthMode.FINE:
            deck_z_m = None
        else:
            view = replace(view, log_depth=np.full(len(view.line), np.nan))
        alone = solve(view, start, noise, config.frame_deck, deck_z_m)
    names, contradictions = _select_consistent(line_fits(alone, view, noise), config.frame_deck)
    notices += contradictions
    if not set(SIDES) & set(names):
        return {}, notices
    numbers = [view.names.index(name) for name in names]
    state = replace(alone.state, points_m=alone.state.points_m[numbers], azimuths_rad=alone.state.azimuths_rad[numbers])
    solution = solve(view.select(names), state, noise, config.frame_deck, deck_z_m, alone.inflation)
    return line_fits(solution, view, noise), notices


def _select_consistent(fits: dict[str, LineFit], deck: Deck) -> tuple[tuple[str, ...], Notices]:
    """Names of the lines that agree with each other, and why others do not.

    A centre line near one of two edge lines shows that another marking was taken for an edge: neither is then believed.
    """
    kept, contradictions = drop_contradictions(fits)
    edges = tuple(name for name in kept if name in SIDES)
    if "centre" not in kept or not edges:
        return edges, contradictions
    if _is_between(kept, deck):
        return tuple(kept), contradictions
    if len(edges) == len(SIDES):
        left_m, right_m = (_lateral_offset(kept["centre"], kept[side])[0] for side in edges)
        off_m, spacing_m = abs(left_m + right_m) / 2, abs(right_m - left_m)
        turn = abs(np.rad2deg(_mean_angle(kept["centre"], [kept[side] for side in edges])))
        message = (
            f"the centre line is not midway: {off_m:.1f} m off where the lines are {spacing_m:.1f} m apart, turned by "
            f"{turn:.1f} degrees"
        )
        contradictions = (Notice(Reason.CENTRE_LINE, message),)
        if off_m > MAX_CENTRE_SHARE * spacing_m:
            return (), contradictions
    return edges, contradictions


def line_fits(solution: Solution, view: Observations, noise: FrameNoise) -> dict[str, LineFit]:
    """Each line of a solution with its sensitivities, in the world and as the aircraft sees it."""
    state, deck, fits = solution.state, solution.deck, {}
    slopes = state.nuisances[4:] * deck.slopes
    for k, name in enumerate(solution.names):
        offset = deck.axes @ (state.points_m[k] - deck.hub_m)
        chosen = np.zeros((3, len(solution.points)))
        chosen[0, 2 * k] = chosen[1, 2 * k + 1] = chosen[2, -NUISANCES - 1] = 1.0
        chosen[2, -2:] = offset * deck.slopes
        relative = _relative(chosen @ solution.height, chosen @ solution.nuisances, noise)
        point = np.array([*state.points_m[k], state.z_m + float(offset @ slopes)])
        rigid = _rigid_motion(point - view.body_m, float(state.azimuths_rad[k]), noise)
        azimuth = float(wrap_angle(state.azimuths_rad[k]))
        own = chosen @ solution.points
        fits[name] = LineFit(point, azimuth, own, relative + rigid, relative, _errors(solution, chosen, noise))
    return fits


def _with_floor(noise: FrameNoise) -> FrameNoise:
    """The same noise with every nuisance a little uncertain: the fit then shows its sensitivity to each."""
    return replace(
        noise,
        attitude_rad=max(noise.attitude_rad, MIN_RAD),
        focal_fraction=max(noise.focal_fraction, MIN_SHARE),
        depth_scale=max(noise.depth_scale, MIN_SHARE),
        slope_rad=max(noise.slope_rad, MIN_RAD),
    )


def _errors(solution: Solution, chosen: Array, noise: FrameNoise) -> LineErrors:
    """Sensitivity of a line and of the slopes to errors, and the part of their noise that is new in every frame.

    A prior that is wrong by so much moves the fit by its column. The nuisances of attitude and focal length correct
    the measurement, so their errors have the opposite sign; depth scale and slopes are the true values themselves.

    Args:
        chosen: (3, P) the line's offset, azimuth and z, of the solution's unknowns.
    """
    slopes = solution.deck.slopes
    both = max(float(np.hypot(noise.deck_z_m, noise.position_m)), MIN_SIGMA_M)
    chosen = np.vstack([chosen, np.zeros((2, chosen.shape[1]))])
    chosen[3:, -2:] = np.diag(slopes)
    turn, stretch, scale = noise.attitude_rad, noise.focal_fraction, noise.depth_scale
    nuisances = chosen @ solution.nuisances / [turn, turn, stretch, -scale, -slopes[0], -slopes[1]]
    effects = np.column_stack([nuisances[:, :2], chosen @ solution.height / both, nuisances[:, 2:]])
    return LineErrors(solution.state.nuisances[4:] * slopes, chosen @ solution.points, effects)


def _relative(height: Array, nuisances: Array, noise: FrameNoise) -> Array:
    """Columns of SOURCES as seen from the aircraft; an error of its own height acts through the reported one alone."""
    columns = np.zeros((3, SOURCES))
    columns[:, :2] = nuisances[:, :2]
    both = max(float(np.hypot(noise.deck_z_m, noise.position_m)), 1e-12)
    columns[:, 5] = -height * noise.position_m / both
    columns[:, 6] = height * noise.deck_z_m / both
    columns[:, 7:] = nuisances[:, 2:]
    return columns


def _rigid_motion(offset_m: Array, azimuth_rad: float, noise: FrameNoise) -> Array:
    """Columns of SOURCES by which errors of the aircraft's heading and position move a line `offset_m` from it."""
    columns = np.zeros((3, SOURCES))
    right = rights(np.array([azimuth_rad]))[0]
    columns[:2, 2] = np.array([right @ [-offset_m[1], offset_m[0]], 1.0]) * noise.attitude_rad
    columns[0, 3:5] = right * noise.position_m
    columns[2, 5] = noise.position_m
    return columns


def _start(
    frame: Frame, view: Observations, pixel_lines: dict[str, PixelLine], deck_z_m: float | None, fine: bool
) -> tuple[Observations, State | None, Notices]:
    """Observations of the lines that start somewhere on the deck, the state there, and why others have no start."""
    if not view.names:
        return view, None, ()
    z_m = initial_height(view, deck_z_m, fine)
    if z_m is None:
        return view, None, (Notice(Reason.ABOVE_CAMERA, "the deck is not below the camera"),)
    found = {}
    for number, name in enumerate(view.names):
        # The plane through the camera and an image line l has the normal K^T l in the optical frame.
        normal = view.turn @ (frame.camera.matrix.T @ pixel_lines[name].coefficients)
        line = initial_line(view, number, normal, z_m)
        if line is not None:
            found[name] = line
    lost = tuple(
        Notice(Reason.HORIZON, f"the {name} line lies along the horizon") for name in view.names if name not in found
    )
    if not found:
        return view, None, lost
    points = np.stack([point[:2] for point, _ in found.values()])
    azimuths = np.array([azimuth for _, azimuth in found.values()])
    return view.select(tuple(found)), State(points, azimuths, z_m, np.zeros(NUISANCES)), lost


def _is_between(fits: dict[str, LineFit], deck: Deck) -> bool:
    """Whether a painted centre line lies midway between both edge lines, or along the only one."""
    centre = fits["centre"]
    edges = [fits[side] for side in SIDES if side in fits]
    parallel = PARALLEL_FACTOR * deck.angle_sigma_rad
    sigma = np.hypot(np.linalg.norm(centre.own[1] - sum(edge.own[1] for edge in edges) / len(edges)), parallel / 2)
    if abs(_mean_angle(centre, edges)) > CENTRE_GATE_SIGMA * np.hypot(sigma, CENTRE_SIGMA_RAD):
        return False
    if len(edges) < len(SIDES):
        return True
    offsets, levers = zip(*(_lateral_offset(centre, edge) for edge in edges), strict=True)
    own = [edge.own[0] + lever * edge.own[1] for edge, lever in zip(edges, levers, strict=True)]
    sigma_m = np.hypot(np.linalg.norm(centre.own[0] - (own[0] + own[1]) / 2), CENTRE_SIGMA_M)
    return bool(abs(sum(offsets)) / 2 <= CENTRE_GATE_SIGMA * sigma_m)


def _mean_angle(centre: LineFit, edges: list[LineFit]) -> float:
    """Mean azimuth of edge lines less a centre line's, rad."""
    return sum(float(wrap_angle(edge.azimuth_rad - centre.azimuth_rad)) for edge in edges) / len(edges)


def _lateral_offset(centre: LineFit, edge: LineFit) -> tuple[float, float]:
    """How far right of a centre line's point an edge line passes, and how far along the edge from its own point, m."""
    lever = (centre.point_m[:2] - edge.point_m[:2]) @ edge.direction
    foot = edge.point_m[:2] + lever * edge.direction
    return float((foot - centre.point_m[:2]) @ centre.right), float(lever)
