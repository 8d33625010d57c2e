"""The joint method: image lines in, line fits with what every noise source moves them by out."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import wrap_angle
from deckline.localize.config import LocalizeConfig, NoiseConfig
from deckline.localize.joint import Solution, solve
from deckline.localize.line_fit import LineFit
from deckline.localize.model import MIN_SIGMA_M, NUISANCES, State, rights
from deckline.localize.runway import drop_contradictions
from deckline.localize.sight import Sight, first_height, first_line, sight
from deckline.types import SIDES, DepthMode, Frame, LineErrors, LinePoints, PixelLine

Array = NDArray[np.float64]
CONTRADICTION = 4.0  # 1-sigma between the reported deck height and the depth camera
CENTRE_CONTRADICTION = 4.0  # 1-sigma between a painted centre line and the middle of the edge lines
LEAST_SHARE, LEAST_RAD = 1e-7, 1e-7  # 1-sigma at least of a nuisance, so that its effect is known
SOURCES = 11  # attitude about x, y, z, position along x, y, z, deck height, focal length, depth scale, deck slopes


@dataclass(frozen=True, eq=False)
class Together:
    """What came of it: fits of `left`, `right` and, where it was painted and seen, `centre`."""

    fits: dict[str, LineFit]
    reason: str


def fit_together(
    frame: Frame,
    points: dict[str, LinePoints],
    pixel_lines: dict[str, PixelLine],
    mode: DepthMode,
    config: LocalizeConfig,
) -> Together:
    """Fit what was seen of `left`, `right` and `centre`, first without what is known of how they lie, then with it.

    The first fit shows whether they contradict each other and whether depth camera and reported deck height do. Of
    the latter two the one that gives the frame its mode is then believed.

    Args:
        frame: camera and pose, depth image and deck height as far as there are.
        points: the detected points of each line.
        pixel_lines: the lines in the image.
        mode: FINE when most points have a depth.
        config: everything that is assumed.
    """
    config = _never_exact(config)
    view, missing = sight(frame, points, pixel_lines, config)
    deck_z_m = None if config.mode == "fine" else frame.deck_z_m
    view, start, lost = _start(frame, view, pixel_lines, deck_z_m, config)
    reasons = [*missing, *lost]
    if start is None:
        return Together({}, "; ".join(reasons))
    alone = solve(view, start, config, deck_z_m)
    if abs(alone.height_score) > CONTRADICTION and np.isfinite(view.log_depth).any():
        believed = "depth camera" if mode is DepthMode.FINE else "deck height"
        reasons.append(f"depth camera and reported deck height contradict each other: the {believed} is believed")
        if mode is DepthMode.FINE:
            deck_z_m = None
        else:
            view = replace(view, log_depth=np.full(len(view.line), np.nan))
        alone = solve(view, start, config, deck_z_m)
    names, contradiction = _believed(line_fits(alone, view, config.noise), config)
    reasons += [contradiction] if contradiction else []
    if not set(SIDES) & set(names):
        return Together({}, "; ".join(reasons))
    numbers = [view.names.index(name) for name in names]
    state = replace(alone.state, points_m=alone.state.points_m[numbers], azimuths_rad=alone.state.azimuths_rad[numbers])
    solution = solve(view.take(names), state, config, deck_z_m, alone.spreads)
    return Together(line_fits(solution, view, config.noise), "; ".join(reasons))


def _believed(fits: dict[str, LineFit], config: LocalizeConfig) -> tuple[tuple[str, ...], str]:
    """Names of the lines that agree with each other, and why others do not.

    A centre line near one of two edge lines says that another marking was taken for an edge: none is then believed.
    """
    kept, contradiction = drop_contradictions(fits, config.agreement)
    edges = tuple(name for name in kept if name in SIDES)
    if "centre" not in kept or not edges:
        return edges, contradiction
    if _is_between(kept, config):
        return tuple(kept), contradiction
    if len(edges) == len(SIDES):
        left_m, right_m = (_beside(kept["centre"], kept[side])[0] for side in edges)
        off_m, spacing_m = abs(left_m + right_m) / 2, abs(right_m - left_m)
        contradiction = (
            f"the centre line is not midway: {off_m:.1f} m off where the lines are {spacing_m:.1f} m apart, turned by "
            f"{abs(np.rad2deg(_turned(kept['centre'], [kept[side] for side in edges]))):.1f} degrees"
        )
        if off_m > config.agreement.max_centre_share * spacing_m:
            return (), contradiction
    return edges, contradiction


def line_fits(solution: Solution, view: Sight, noise: NoiseConfig) -> dict[str, LineFit]:
    """Each line of a solution with its sensitivities, in the world and as the aircraft sees it."""
    state, deck, fits = solution.state, solution.deck, {}
    slopes = state.nuisances[4:] * deck.slopes
    for k, name in enumerate(solution.names):
        way = deck.axes @ (state.points_m[k] - deck.hub_m)
        chosen = np.zeros((3, len(solution.points)))
        chosen[0, 2 * k] = chosen[1, 2 * k + 1] = chosen[2, -NUISANCES - 1] = 1.0
        chosen[2, -2:] = way * deck.slopes
        relative = _relative(chosen @ solution.height, chosen @ solution.nuisances, noise)
        point = np.array([*state.points_m[k], state.z_m + float(way @ slopes)])
        carried = _carried(point - view.body_m, float(state.azimuths_rad[k]), noise)
        azimuth = float(wrap_angle(state.azimuths_rad[k]))
        own = chosen @ solution.points
        fits[name] = LineFit(point, azimuth, own, relative + carried, relative, _errors(solution, chosen, noise))
    return fits


def _never_exact(config: LocalizeConfig) -> LocalizeConfig:
    """The same with every nuisance a little unsure: what it would do can then be read off the fit."""
    noise, deck = config.noise, config.deck
    noise = replace(
        noise,
        attitude_rad=max(noise.attitude_rad, LEAST_RAD),
        focal_fraction=max(noise.focal_fraction, LEAST_SHARE),
        depth_scale=max(noise.depth_scale, LEAST_SHARE),
    )
    return replace(config, noise=noise, deck=replace(deck, tilt_rad=max(deck.tilt_rad, LEAST_RAD)))


def _errors(solution: Solution, chosen: Array, noise: NoiseConfig) -> LineErrors:
    """What errors add to a line and to the slopes, and what of them is new in every frame.

    A nuisance whose prior is wrong by so much moves the fit by its column. What is unknown of attitude and focal length
    turns what was measured into what is true: their error is the opposite. Depth scale and slopes are true ones.

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


def _relative(height: Array, nuisances: Array, noise: NoiseConfig) -> Array:
    """Columns of SOURCES as the aircraft sees them; an own height that is wrong acts through the reported one alone."""
    columns = np.zeros((3, SOURCES))
    columns[:, :2] = nuisances[:, :2]
    both = max(float(np.hypot(noise.deck_z_m, noise.position_m)), 1e-12)
    columns[:, 5] = -height * noise.position_m / both
    columns[:, 6] = height * noise.deck_z_m / both
    columns[:, 7:] = nuisances[:, 2:]
    return columns


def _carried(way_m: Array, azimuth_rad: float, noise: NoiseConfig) -> Array:
    """Columns of SOURCES by which the aircraft's wrong heading and position carry along a line `way_m` from it."""
    columns = np.zeros((3, SOURCES))
    right = rights(np.array([azimuth_rad]))[0]
    columns[:2, 2] = np.array([right @ [-way_m[1], way_m[0]], 1.0]) * noise.attitude_rad
    columns[0, 3:5] = right * noise.position_m
    columns[2, 5] = noise.position_m
    return columns


def _start(
    frame: Frame, view: Sight, pixel_lines: dict[str, PixelLine], deck_z_m: float | None, config: LocalizeConfig
) -> tuple[Sight, State | None, list[str]]:
    """Where to begin, the sight of the lines that have a place there, and what has none."""
    if not view.names:
        return view, None, []
    z_m = first_height(view, deck_z_m, config.mode == "fine")
    if z_m is None:
        return view, None, ["the deck is not below the camera"]
    found = {}
    for number, name in enumerate(view.names):
        # The plane through the camera and an image line l has the normal K^T l in the optical frame.
        normal = view.turn @ (frame.camera.matrix.T @ pixel_lines[name].coefficients)
        first = first_line(view, number, normal, z_m)
        if first is not None:
            found[name] = first
    lost = [f"the {name} line lies along the horizon" for name in view.names if name not in found]
    if not found:
        return view, None, lost
    points = np.stack([point[:2] for point, _ in found.values()])
    azimuths = np.array([azimuth for _, azimuth in found.values()])
    return view.take(tuple(found)), State(points, azimuths, z_m, np.zeros(NUISANCES)), lost


def _is_between(fits: dict[str, LineFit], config: LocalizeConfig) -> bool:
    """Whether a painted centre line lies midway between both edge lines, or along the only one."""
    centre = fits["centre"]
    edges = [fits[side] for side in SIDES if side in fits]
    parallel = config.agreement.parallel_rad
    sigma = np.hypot(np.linalg.norm(centre.own[1] - sum(edge.own[1] for edge in edges) / len(edges)), parallel / 2)
    if abs(_turned(centre, edges)) > CENTRE_CONTRADICTION * np.hypot(sigma, config.deck.centre_sigma_rad):
        return False
    if len(edges) < len(SIDES):
        return True
    gaps, levers = zip(*(_beside(centre, edge) for edge in edges), strict=True)
    moved = [edge.own[0] + lever * edge.own[1] for edge, lever in zip(edges, levers, strict=True)]
    spread = np.hypot(np.linalg.norm(centre.own[0] - (moved[0] + moved[1]) / 2), config.deck.centre_sigma_m)
    return abs(sum(gaps)) / 2 <= CENTRE_CONTRADICTION * spread


def _turned(centre: LineFit, edges: list[LineFit]) -> float:
    """Mean azimuth of edge lines less a centre line's, rad."""
    return sum(float(wrap_angle(edge.azimuth_rad - centre.azimuth_rad)) for edge in edges) / len(edges)


def _beside(centre: LineFit, edge: LineFit) -> tuple[float, float]:
    """How far right of a centre line's point an edge line passes, and how far along the edge from its own point, m."""
    lever = (centre.point_m[:2] - edge.point_m[:2]) @ edge.direction
    foot = edge.point_m[:2] + lever * edge.direction
    return float((foot - centre.point_m[:2]) @ centre.right), float(lever)
