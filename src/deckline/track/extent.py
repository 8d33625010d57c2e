"""Where the runway begins and ends along its lines."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane, rotation_matrix
from deckline.track.states import FAULTS, FilterState, States
from deckline.trackers import RAMP_CORRELATION_S
from deckline.types import SIDES, Frame, RunwayEstimate, RunwayLine, RunwayPrior, Value

Array = NDArray[np.float64]
SHIP_SPEED_SIGMA_M_S = 15.0  # of an unknown ship; 29 knots
KNOWN_SPEED_SIGMA_M_S = 0.5  # of a ship whose velocity is stated
SPEED_M_S15 = 0.1  # noise density of it
MIN_HEIGHT_M = 0.5  # of the camera above the deck, below which a ramp is not moved onto the deck's present height
MIN_RAMP_OWN_SHARE = 0.1  # of a ramp's 1-sigma that does not come from the deck's height
MIN_RAMP_SIGMA_M = 0.1
MAX_LENGTH_M = 400.0  # a far end beyond this is a grazing ray, not a runway; decks are 333 m long
DEFAULT_LENGTH_M = 220.0  # of a runway whose far end was never in view; those of large carriers are 218 to 239 m


@dataclass(frozen=True, eq=False)
class Extent:
    """The near end of the centre line, in the world, and how far the lines go on from there."""

    near_m: Array  # (3,)
    speed_m_s: float  # along the line
    covariance: Array  # (2, 2) of position and speed along the line
    response: Array  # (2, 9) of both to one unit of each possible fault (`fault_gains`)
    is_ramp: bool  # the end itself was in view; else the nearest part of the lines
    length_m: float

    @property
    def sigma_m(self) -> float:
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def speed(self) -> Value:
        return Value(self.speed_m_s, float(np.sqrt(self.covariance[1, 1])))


def visible_extent(frame: Frame, estimate: RunwayEstimate, state: FilterState) -> tuple[float, float] | None:
    """Nearest and farthest visible part of the lines, m from the state's point; None without a pose or lines."""
    pose = frame.world_from_camera
    if pose is None or not estimate.pixel_lines:
        return None
    ends = np.concatenate([line.ends_px for line in estimate.pixel_lines.values()])
    on_deck = intersect_plane(pose.translation, frame.camera.rays(ends) @ rotation_matrix(pose).T, state.deck_z_m)
    x = (on_deck - state.point_m) @ state.along
    x = x[np.isfinite(x)]
    return (float(x.min()), float(x.max())) if len(x) > 1 else None


@dataclass(frozen=True, eq=False)
class Ramp:
    """The near end of the lines as one frame shows it."""

    place_m: Array  # (3,)
    sigma_m: float  # along the deck
    response: Array  # (9,) of the place along the deck to one unit of each possible fault, as large as it may be


def move_ramp_to_deck(frame: Frame, estimate: RunwayEstimate, state: FilterState, gains: Array) -> Ramp | None:
    """The frame's ramp, moved along its ray onto the track's present deck.

    One frame alone may know the deck's mean height only, and on a higher deck a ramp far ahead is nearer.

    Args:
        estimate: of the frame; None is returned for one without a ramp.
        gains: (20, 9) by `fault_gains`.
    """
    pose, ramp, sigma_m = frame.world_from_camera, estimate.ramp_m, estimate.ramp_sigma_m
    if pose is None or ramp is None or sigma_m is None or not estimate.lines:
        return None
    ray = ramp - pose.translation
    row = np.zeros(States.SIZE)
    row[[States.HEIGHT, States.HEAVE, States.PITCH]] = 1.0, 1.0, float(state.local(ramp)[0])
    down = float(state.point_m[2] + row @ state.mean - pose.translation[2])
    if min(ray[2], down) < MIN_HEIGHT_M:
        return Ramp(ramp, sigma_m, np.zeros(FAULTS))
    line = next(iter(estimate.lines.values()))
    per_metre = float(np.hypot(ray[0], ray[1])) / ray[2]
    own = max(sigma_m**2 - per_metre**2 * float(line.aircraft_covariance[2, 2]), (MIN_RAMP_OWN_SHARE * sigma_m) ** 2)
    variance = own + per_metre**2 * float(row @ state.covariance @ row)
    response = per_metre * np.abs(row @ gains)
    range_m, direct = per_metre * down, np.zeros(States.SIZE)
    direct[[States.ATTITUDE_Y, States.FOCAL]] = (range_m**2 + down**2) / down, range_m
    place_m = pose.translation + down / ray[2] * ray
    response[:-1] += direct[States.SHARED_ERRORS]
    return Ramp(place_m, float(np.sqrt(variance)), response)


def update_extent(
    before: Extent | None,
    state: FilterState,
    visible: tuple[float, float] | None,
    ramp: Ramp | None,
    step_s: float,
    ship_m_s: float | None,
    gate_sigma: float,
) -> Extent | None:
    """The ends after one more frame; None while nothing is known of them.

    Where the ramp left the picture, or its rows are not found, the nearest visible part passes for it. A ramp farther
    ahead than the known one is therefore left out. A nearer one is used: more of the runway was found.

    Args:
        before: from the frame before, `step_s` earlier.
        visible: by `visible_extent`.
        ramp: of this frame; None: not in view.
        step_s: since `before`.
        ship_m_s: speed of the ship along the line, where it is known.
        gate_sigma: standard deviations beyond which a ramp is too far ahead.
    """
    extent = None if before is None else advance_extent(before, state, step_s)
    if ramp is not None:
        place, sigma_m = float(state.local(ramp.place_m)[0]), max(ramp.sigma_m, MIN_RAMP_SIGMA_M)
        if extent is None or not extent.is_ramp:
            speed_sigma = SHIP_SPEED_SIGMA_M_S if ship_m_s is None else KNOWN_SPEED_SIGMA_M_S
            covariance = np.diag([sigma_m**2, speed_sigma**2])
            length = 0.0 if extent is None else extent.length_m
            response = np.stack([ramp.response, np.zeros_like(ramp.response)])
            extent = Extent(_point_at(state, place), ship_m_s or 0.0, covariance, response, True, length)
        elif not _is_beyond(extent, state, place, sigma_m, gate_sigma):
            inflation = max(1.0, 2 * RAMP_CORRELATION_S / max(step_s, 1e-3))
            extent = _measure_ramp(extent, state, place, sigma_m**2 * inflation, ramp.response)
    elif extent is None and visible is not None:
        length = visible[1] - visible[0]
        covariance = np.diag([length**2, SHIP_SPEED_SIGMA_M_S**2])
        response = np.zeros((2, FAULTS))
        extent = Extent(_point_at(state, visible[0]), ship_m_s or 0.0, covariance, response, False, length)
    if extent is None or visible is None:
        return extent
    near = float(state.local(extent.near_m)[0])
    if not extent.is_ramp and visible[0] < near:
        length = extent.length_m + near - visible[0]
        extent, near = replace(extent, near_m=_point_at(state, visible[0]), length_m=length), visible[0]
    reach = visible[1] - near
    return replace(extent, length_m=max(extent.length_m, reach)) if reach <= MAX_LENGTH_M else extent


def _point_at(state: FilterState, x_m: float) -> Array:
    return state.point_m + x_m * state.along


def advance_extent(before: Extent, state: FilterState, step_s: float) -> Extent:
    """The ends `step_s` later, on the line of the present state."""
    transition = np.array([[1.0, step_s], [0.0, 1.0]])
    process = SPEED_M_S15**2 * np.array([[step_s**3 / 3, step_s**2 / 2], [step_s**2 / 2, step_s]])
    x = float(state.local(before.near_m)[0]) + step_s * before.speed_m_s
    covariance = transition @ before.covariance @ transition.T + process
    response = transition @ before.response
    return replace(before, near_m=_point_at(state, x), covariance=covariance, response=response)


def _is_beyond(extent: Extent, state: FilterState, place_m: float, sigma_m: float, gate_sigma: float) -> bool:
    """Whether a ramp seems farther ahead than the known one by more than both may err."""
    ahead_m = place_m - float(state.local(extent.near_m)[0])
    return bool(ahead_m > gate_sigma * np.hypot(extent.sigma_m, sigma_m))


def _measure_ramp(before: Extent, state: FilterState, place_m: float, variance: float, response: Array) -> Extent:
    x = float(state.local(before.near_m)[0])
    gain = before.covariance[:, 0] / (before.covariance[0, 0] + variance)
    rest = np.eye(2) - np.outer(gain, [1.0, 0.0])
    return replace(
        before,
        near_m=_point_at(state, x + gain[0] * (place_m - x)),
        speed_m_s=before.speed_m_s + gain[1] * (place_m - x),
        covariance=rest @ before.covariance @ rest.T + variance * np.outer(gain, gain),
        response=rest @ before.response + np.outer(gain, response),
    )


def runway_prior(state: FilterState, extent: Extent, lines: dict[str, RunwayLine], step_s: float) -> RunwayPrior:
    """Ends of both edge lines where they should be now, with their 1-sigma as seen from the aircraft.

    Args:
        state: predicted to now.
        extent: as it was `step_s` ago.
        lines: of `state`.
    """
    now = advance_extent(extent, state, step_s)
    near = float(state.local(now.near_m)[0])
    reach = near + (now.length_m or DEFAULT_LENGTH_M)
    ends = {}
    for side in SIDES:
        from_point = np.array([near, reach]) - float(state.local(lines[side].point_m)[0])
        ends[side] = lines[side].point_m + from_point[:, None] * lines[side].direction
    known = lines["centre"].aircraft_covariance
    return RunwayPrior(
        ends["left"], ends["right"], float(np.sqrt(known[0, 0] + known[2, 2])), float(np.sqrt(known[1, 1]))
    )
