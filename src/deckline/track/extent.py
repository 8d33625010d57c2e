"""Where the runway begins and ends along its lines."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane
from deckline.track.state import HEIGHT, RISE, SIZE, TILT, State
from deckline.types import SIDES, Frame, RunwayEstimate, RunwayLine, RunwayPrior

Array = NDArray[np.float64]
SHIP_M_S = 15.0  # 1-sigma of a ship's unknown speed; 29 knots
PUSH_M_S15 = 0.1  # how fast it changes
SAME_ERROR_S = 1.0  # a wrong attitude and the same row of points move all ramps of so many seconds alike
MIN_HEIGHT_M = 0.5  # of the camera above the deck, below which nothing is placed on it anew
LEAST_OWN = 0.1  # of a ramp's 1-sigma, what does not come from the deck's height
LONGEST_M = 400.0  # a far end beyond this is a grazing ray, not a runway; decks are 333 m long, SPEC section 7
LENGTH_M = 220.0  # of a runway whose far end was never seen; SPEC section 7: 218 to 239 m


@dataclass(frozen=True, eq=False)
class Extent:
    """The near end of the centre line, in the world, and how far the lines go on from there."""

    near_m: Array  # (3,)
    speed_m_s: float  # along the line
    covariance: Array  # (2, 2) of place and speed along the line
    is_ramp: bool  # the end itself was seen; else the nearest part of the lines
    length_m: float

    @property
    def sigma_m(self) -> float:
        return float(np.sqrt(self.covariance[0, 0]))


def seen_extent(frame: Frame, estimate: RunwayEstimate, state: State) -> tuple[float, float] | None:
    """Nearest and farthest seen part of the lines, m from the state's point; None without a pose or lines."""
    pose = frame.world_from_camera
    if pose is None or not estimate.pixel_lines:
        return None
    ends = np.concatenate([line.ends_px for line in estimate.pixel_lines.values()])
    on_deck = intersect_plane(pose.translation, pose.rotation.apply(frame.camera.rays(ends)), state.deck_z_m)
    x = (on_deck - state.point_m) @ state.along
    x = x[np.isfinite(x)]
    return (float(x.min()), float(x.max())) if len(x) > 1 else None


def seen_ramp(frame: Frame, estimate: RunwayEstimate, state: State) -> tuple[Array, float] | None:
    """The near end (3,) of the lines where the camera saw it, on the deck as the track has it, and its 1-sigma along.

    One frame alone may know the deck's height by its mean only, and on a higher deck a ramp far ahead is nearer.
    """
    pose, ramp, sigma_m = frame.world_from_camera, estimate.ramp_m, estimate.ramp_sigma_m
    if pose is None or ramp is None or sigma_m is None or not estimate.lines:
        return None
    way = ramp - pose.translation
    row = np.zeros(SIZE)
    row[[HEIGHT, RISE, TILT]] = 1.0, 1.0, float(state.local(ramp)[0])
    down = float(state.point_m[2] + row @ state.mean - pose.translation[2])
    if min(way[2], down) < MIN_HEIGHT_M:
        return ramp, sigma_m
    line = next(iter(estimate.lines.values()))
    alone = line.covariance if line.relative_covariance is None else line.relative_covariance
    per_metre = float(np.hypot(way[0], way[1])) / way[2]
    own = max(sigma_m**2 - per_metre**2 * float(alone[2, 2]), (LEAST_OWN * sigma_m) ** 2)
    spread = own + per_metre**2 * float(row @ state.covariance @ row)
    return pose.translation + down / way[2] * way, float(np.sqrt(spread))


def extended(
    before: Extent | None,
    state: State,
    seen: tuple[float, float] | None,
    ramp: tuple[Array, float] | None,
    frame_s: float,
    ship_m_s: float | None,
) -> Extent | None:
    """What is known of the ends after one more frame; None while nothing is.

    Args:
        before: from the frame before, `frame_s` earlier.
        state: of this frame.
        seen: as `seen_extent` gives it.
        ramp: place (3,) and 1-sigma along the deck, where it was seen.
        ship_m_s: speed of the ship along the line, where it is known.
    """
    moved = None if before is None else sailed(before, state, frame_s)
    if ramp is not None:
        place, sigma_m = float(state.local(ramp[0])[0]), max(ramp[1], 0.1)
        if moved is None or not moved.is_ramp:
            speed_sigma = SHIP_M_S if ship_m_s is None else 0.5
            covariance = np.diag([sigma_m**2, speed_sigma**2])
            moved = Extent(_at(state, place), ship_m_s or 0.0, covariance, True, _length(moved))
        else:
            moved = _measured(moved, state, place, sigma_m**2 * max(1.0, 2 * SAME_ERROR_S / max(frame_s, 1e-3)))
    elif moved is None and seen is not None:
        covariance = np.diag([(seen[1] - seen[0]) ** 2, SHIP_M_S**2])
        moved = Extent(_at(state, seen[0]), ship_m_s or 0.0, covariance, False, seen[1] - seen[0])
    if moved is None or seen is None:
        return moved
    near = float(state.local(moved.near_m)[0])
    if not moved.is_ramp and seen[0] < near:
        moved, near = replace(moved, near_m=_at(state, seen[0]), length_m=moved.length_m + near - seen[0]), seen[0]
    reach = seen[1] - near
    return replace(moved, length_m=max(moved.length_m, reach)) if reach <= LONGEST_M else moved


def _length(before: Extent | None) -> float:
    return 0.0 if before is None else before.length_m


def _at(state: State, x_m: float) -> Array:
    return state.point_m + x_m * state.along


def sailed(before: Extent, state: State, frame_s: float) -> Extent:
    """The ends `frame_s` later, on the line as it is then believed."""
    move = np.array([[1.0, frame_s], [0.0, 1.0]])
    push = PUSH_M_S15**2 * np.array([[frame_s**3 / 3, frame_s**2 / 2], [frame_s**2 / 2, frame_s]])
    x = float(state.local(before.near_m)[0]) + frame_s * before.speed_m_s
    return replace(before, near_m=_at(state, x), covariance=move @ before.covariance @ move.T + push)


def _measured(before: Extent, state: State, place_m: float, variance: float) -> Extent:
    x = float(state.local(before.near_m)[0])
    gain = before.covariance[:, 0] / (before.covariance[0, 0] + variance)
    rest = np.eye(2) - np.outer(gain, [1.0, 0.0])
    return replace(
        before,
        near_m=_at(state, x + gain[0] * (place_m - x)),
        speed_m_s=before.speed_m_s + gain[1] * (place_m - x),
        covariance=rest @ before.covariance @ rest.T + variance * np.outer(gain, gain),
    )


def runway_prior(state: State, extent: Extent, lines: dict[str, RunwayLine], unseen_s: float) -> RunwayPrior:
    """Ends of both edge lines where they should be now, and how wrong that may be, as seen from the aircraft.

    Args:
        state: predicted to now.
        extent: as it was `unseen_s` ago.
        lines: of `state`.
    """
    now = sailed(extent, state, unseen_s)
    near = float(state.local(now.near_m)[0])
    reach = near + (now.length_m or LENGTH_M)
    ends = {}
    for side in SIDES:
        from_point = np.array([near, reach]) - float(state.local(lines[side].point_m)[0])
        ends[side] = lines[side].point_m + from_point[:, None] * lines[side].direction
    centre = lines["centre"]
    known = centre.covariance if centre.relative_covariance is None else centre.relative_covariance
    return RunwayPrior(
        ends["left"], ends["right"], float(np.sqrt(known[0, 0] + known[2, 2])), float(np.sqrt(known[1, 1]))
    )
