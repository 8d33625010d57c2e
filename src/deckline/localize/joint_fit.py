"""The joint fit of one frame: initial state, solution, consistency tests, sensitivities of each line."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import Deck, FrameNoise, Mode, RunConfig
from deckline.geometry import wrap_angle
from deckline.localize.line_fit import LineFit, drop_contradictions
from deckline.localize.model import (
    CENTRE_SIGMA_M,
    CENTRE_SIGMA_RAD,
    MIN_SIGMA_M,
    NUISANCES,
    PARALLEL_FACTOR,
    FitState,
    right_vectors,
)
from deckline.localize.observations import Observations, initial_height, initial_line, observe
from deckline.localize.solver import Solution, solve
from deckline.types import SIDES, DepthMode, Diagnostic, Diagnostics, Frame, LineErrors, LinePoints, PixelLine, Reason

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
) -> tuple[dict[str, LineFit], Diagnostics]:
    """Fits of `left`, `right` and a painted `centre`, first without the prior of the lines' geometry, then with it.

    The first fit tests the lines against each other, and the depth camera against the reported deck height. When these
    two contradict each other, the one that gives the frame its mode is used.

    Returns:
        The fits that agree with each other, and why others are missing.
    """
    noise = _apply_floor(config.noise)
    deck_z_m = None if config.localization.mode == "fine" else frame.deck_z_m
    observations, start, diagnostics = _initialize(frame, points, pixel_lines, deck_z_m, config.localization.mode)
    if start is None:
        return {}, diagnostics
    free = solve(observations, start, noise, config.frame_deck, deck_z_m)
    if abs(free.height_score) > HEIGHT_GATE_SIGMA and np.isfinite(observations.log_depth).any():
        if mode is DepthMode.FINE:
            believed, deck_z_m = "depth camera", None
        else:
            believed = "deck height"
            observations = replace(observations, log_depth=np.full(len(observations.line), np.nan))
        message = f"depth camera and reported deck height contradict each other: the {believed} is believed"
        diagnostics += (Diagnostic(Reason.DEPTH_HEIGHT, message),)
        free = solve(observations, start, noise, config.frame_deck, deck_z_m)
    names, contradictions = _select_consistent(line_fits(free, observations, noise), config.frame_deck)
    diagnostics += contradictions
    if not set(SIDES) & set(names):
        return {}, diagnostics
    start = free.state.select([observations.names.index(name) for name in names])
    solution = solve(observations.select(names), start, noise, config.frame_deck, deck_z_m, free.inflation)
    return line_fits(solution, observations, noise), diagnostics


def _select_consistent(fits: dict[str, LineFit], deck: Deck) -> tuple[tuple[str, ...], Diagnostics]:
    """Names of the lines that agree with each other, and why others do not.

    A painted centre line far from midway between two edge lines shows that one of them is another marking. Then
    neither edge line is accepted.
    """
    accepted, contradictions = drop_contradictions(fits)
    edges = tuple(name for name in accepted if name in SIDES)
    if "centre" not in accepted or not edges:
        return edges, contradictions
    if _is_between(accepted, deck):
        return tuple(accepted), contradictions
    if len(edges) == len(SIDES):
        left_m, right_m = (_lateral_offset(accepted["centre"], accepted[side])[0] for side in edges)
        off_m, spacing_m = abs(left_m + right_m) / 2, abs(right_m - left_m)
        turn = abs(np.rad2deg(_mean_angle(accepted["centre"], [accepted[side] for side in edges])))
        message = (
            f"the centre line is not midway: {off_m:.1f} m off where the lines are {spacing_m:.1f} m apart, turned by "
            f"{turn:.1f} degrees"
        )
        contradictions = (Diagnostic(Reason.CENTRE_LINE, message),)
        if off_m > MAX_CENTRE_SHARE * spacing_m:
            return (), contradictions
    return edges, contradictions


def line_fits(solution: Solution, observations: Observations, noise: FrameNoise) -> dict[str, LineFit]:
    """Each line of a solution with its sensitivities, in the world and as the aircraft sees it."""
    state, plane = solution.state, solution.plane
    slopes = state.nuisances[4:] * plane.slopes
    offsets = (state.points_m - plane.origin_m) @ plane.axes.T  # (L, 2) along and across
    points = np.column_stack([state.points_m, state.z_m + offsets @ slopes])
    rows = _line_rows(offsets, plane.slopes, len(solution.points))
    own, height, nuisances = rows @ solution.points, rows @ solution.height, rows @ solution.nuisances
    effects = _error_effects(height, nuisances, plane.slopes, noise)
    right, from_body = right_vectors(state.azimuths_rad), points - observations.body_m
    relative, rigid = _source_columns(height[:, :3], nuisances[:, :3], from_body, right, noise)
    common, azimuths = relative + rigid, wrap_angle(state.azimuths_rad).tolist()
    return {
        name: LineFit(
            points[k], azimuths[k], own[k, :3], common[k], relative[k], LineErrors(slopes, own[k], effects[k])
        )
        for k, name in enumerate(solution.names)
    }


def _line_rows(offsets_m: Array, slopes_rad: Array, unknowns: int) -> Array:
    """Rows (L, 5, P) that give each line's offset, azimuth and z and the deck's slopes, of a solution's unknowns.

    Args:
        offsets_m: (L, 2) of the lines from the origin of the deck's plane, along and across.
        slopes_rad: (2,) 1-sigma of the deck's slopes.
    """
    rows = np.zeros((len(offsets_m), 5, unknowns))
    lines = np.arange(len(offsets_m))
    rows[lines, 0, 2 * lines] = rows[lines, 1, 2 * lines + 1] = rows[:, 2, -NUISANCES - 1] = 1.0
    rows[:, 2, -2:] = offsets_m * slopes_rad
    rows[:, 3, -2], rows[:, 4, -1] = slopes_rad
    return rows


def _apply_floor(noise: FrameNoise) -> FrameNoise:
    """The same noise with no nuisance known exactly: the fit then has a sensitivity to each."""
    return replace(
        noise,
        attitude_rad=max(noise.attitude_rad, MIN_RAD),
        focal_fraction=max(noise.focal_fraction, MIN_SHARE),
        depth_scale=max(noise.depth_scale, MIN_SHARE),
        slope_rad=max(noise.slope_rad, MIN_RAD),
    )


def _error_effects(height: Array, nuisances: Array, slopes_rad: Array, noise: FrameNoise) -> Array:
    """What a unit of each common error adds to the lines and the slopes, (L, 5, 7), as in `LineErrors`.

    Each column is the change of the fit by an error of one prior. The nuisances of attitude and focal length correct
    the measurement, so their errors have the opposite sign; depth scale and slopes are the true values themselves.

    Args:
        height, nuisances: (L, 5) and (L, 5, 6) sensitivities of the lines.
        slopes_rad: (2,) 1-sigma of the deck's slopes.
    """
    sigma_m = max(math.hypot(noise.deck_z_m, noise.position_m), MIN_SIGMA_M)
    turn, stretch, scale = noise.attitude_rad, noise.focal_fraction, noise.depth_scale
    effects = np.concatenate([nuisances[..., :2], height[..., None], nuisances[..., 2:]], axis=-1)
    return effects / np.array([turn, turn, sigma_m, stretch, -scale, *-slopes_rad])


def _source_columns(
    height: Array, nuisances: Array, offset_m: Array, right: Array, noise: FrameNoise
) -> tuple[Array, Array]:
    """Columns (L, 3, 11) of SOURCES: as seen from the aircraft, and what its own heading and position errors add.

    An error of the aircraft's own height is seen from it through the reported deck height alone.

    Args:
        height, nuisances: (L, 3) and (L, 3, 6) sensitivities of the lines.
        offset_m: (L, 3) from the aircraft to each line's point.
        right: (L, 2) unit vectors to the right of the lines.
    """
    relative, rigid = np.zeros((2, len(height), 3, SOURCES))
    sigma_m = max(math.hypot(noise.deck_z_m, noise.position_m), 1e-12)
    relative[..., :2], relative[..., 7:] = nuisances[..., :2], nuisances[..., 2:]
    relative[..., 5] = -height * (noise.position_m / sigma_m)
    relative[..., 6] = height * (noise.deck_z_m / sigma_m)
    rigid[:, 0, 2] = (right[:, 1] * offset_m[:, 0] - right[:, 0] * offset_m[:, 1]) * noise.attitude_rad
    rigid[:, 1, 2] = noise.attitude_rad
    rigid[:, 0, 3:5] = right * noise.position_m
    rigid[:, 2, 5] = noise.position_m
    return relative, rigid


def _initialize(
    frame: Frame,
    points: dict[str, LinePoints],
    pixel_lines: dict[str, PixelLine],
    deck_z_m: float | None,
    mode: Mode,
) -> tuple[Observations, FitState | None, Diagnostics]:
    """Observations of the lines whose image meets the deck, the initial state, and why others have none."""
    observations, diagnostics = observe(frame, points, pixel_lines, mode)
    if not observations.names:
        return observations, None, diagnostics
    z_m = initial_height(observations, deck_z_m, mode == "fine")
    if z_m is None:
        return observations, None, (*diagnostics, Diagnostic(Reason.ABOVE_CAMERA, "the deck is not below the camera"))
    found = {}
    for number, name in enumerate(observations.names):
        # The plane through the camera and an image line l has the normal K^T l in the optical frame.
        normal = observations.rotation @ (frame.camera.matrix.T @ pixel_lines[name].coefficients)
        line = initial_line(observations, number, normal, z_m)
        if line is not None:
            found[name] = line
    others = [name for name in observations.names if name not in found]
    diagnostics += tuple(Diagnostic(Reason.HORIZON, f"the {name} line lies along the horizon") for name in others)
    if not found:
        return observations, None, diagnostics
    points_m = np.stack([point[:2] for point, _ in found.values()])
    azimuths = np.array([azimuth for _, azimuth in found.values()])
    return observations.select(tuple(found)), FitState(points_m, azimuths, z_m, np.zeros(NUISANCES)), diagnostics


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
    passing = edge.point_m[:2] + lever * edge.direction
    return float((passing - centre.point_m[:2]) @ centre.right), float(lever)
