"""Errors of a centre line as seen from the aircraft, and how they compare with the stated covariance."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import wrap_angle
from deckline.truth import passing_distance_m, state_error, touchdown, true_centre
from deckline.types import Frame, RunwayLine, Segment
from deckline_lab.evaluation.tables import Figures

STATES = ("offset", "azimuth", "height")  # of a line; m, rad, m
MOST_CONDITION = 1e12  # of a correlation matrix; beyond it the covariance is unusable

Array = NDArray[np.float64]


def pilot_figures(frame: Frame, line: RunwayLine, touchdown_m: float) -> Figures:
    """Errors of a centre line as seen from the aircraft: what its own position and heading are wrong by is taken out.

    `lateral_m` and `height_m` are at the touchdown point: how far right and how far below the true one the estimate
    lies; `deviation_m` is the same sideways beside the aircraft, `heading_deg` of the direction. `*_sigma*` is the
    estimate's own 1-sigma there, `ratio.*` an error of the line's own state over its 1-sigma.

    Raises:
        ValueError: the frame has no pose, no true pose or no true lines.
    """
    centre = true_centre(frame.truth)
    measured, true = frame.world_from_body, frame.true_world_from_body
    if centre is None or measured is None or true is None:
        raise ValueError(f"{frame.file}: a pilot's errors need the pose and the true lines")
    seen = move_with_pose(line, measured, true)
    covariance = line.aircraft_covariance
    place = touchdown(centre, touchdown_m)
    lateral, height = passing_distance_m(seen, centre, place)
    error = state_error(seen, centre)
    return {
        "lateral_m": lateral,
        "deviation_m": passing_distance_m(seen, centre, abreast(centre, true.translation))[0],
        "height_m": height,
        "heading_deg": float(np.rad2deg(error[1])),
        "lateral_sigma_m": offset_sigma_m(seen, covariance, place),
        "deviation_sigma_m": offset_sigma_m(seen, covariance, true.translation),
        "height_sigma_m": float(np.sqrt(covariance[2, 2])),
        "heading_sigma_deg": float(np.rad2deg(np.sqrt(covariance[1, 1]))),
        **normalise_error(error, covariance),
    }


def normalise_error(error: Array, covariance: Array) -> Figures:
    """Squared error over covariance, and each state's error over its 1-sigma; nothing for a covariance of no use."""
    variance = np.diag(covariance)
    if not np.all(variance > 0) or np.linalg.cond(covariance / np.sqrt(np.outer(variance, variance))) > MOST_CONDITION:
        return {}
    ratios = {f"ratio.{name}": float(e / s) for name, e, s in zip(STATES, error, np.sqrt(variance), strict=True)}
    return {"normalised": float(error @ np.linalg.solve(covariance, error)), **ratios}


def move_with_pose(line: RunwayLine, measured: RigidTransform, true: RigidTransform) -> RunwayLine:
    """The line where an aircraft at its true pose would draw it: moved by the error of position and heading alone.

    `measured` and `true` are world_from_body.
    """
    turn = (true.rotation * measured.rotation.inv()).as_rotvec()[2]
    point = Rotation.from_rotvec([0.0, 0.0, turn]).apply(line.point_m - measured.translation) + true.translation
    azimuth = float(wrap_angle(line.azimuth_rad + turn))
    return RunwayLine(point, azimuth, line.covariance, line.relative_covariance)


def abreast(line: Segment, place_m: Array) -> Array:
    """The point (3,) of a true line, continued, that is abreast of a place (3,)."""
    along = line.p1_m - line.p0_m
    return line.p0_m + float((place_m - line.p0_m)[:2] @ along[:2]) / float(along[:2] @ along[:2]) * along


def offset_sigma_m(line: RunwayLine, covariance: Array, place_m: Array) -> float:
    """1-sigma, m, of a line's offset abreast of a place (3,): an azimuth error counts with the distance to it."""
    lever = np.array([1.0, float((place_m - line.point_m) @ line.direction), 0.0])
    return float(np.sqrt(lever @ covariance @ lever))
