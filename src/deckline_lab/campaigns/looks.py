"""Looks along approaches in closed form: the moments that a way to see is fitted to and checked with."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config_file import config_from_table, settings_from_json, settings_to_json
from deckline.types import SIDES, Detection, Guidance, LinePoints, Protection, Value
from deckline_sim.config import FlightConfig, MotionConfig, SimConfig
from deckline_sim.flight.approach import STEP_S, ApproachPath, flight_path, pose_at
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.deviations import deviations
from deckline_sim.landing.sight import Moment, Sight
from deckline_sim.landing.surroundings import MOUNT_DOWN_DEG, Surroundings, surroundings

AIRSPEED_M_S = 65.0
END_M = 12.0  # distance to the ramp where the described path ends; it goes on to `PAST_RAMP_M`
PAST_RAMP_M = 20.0  # the last look, beyond the ramp: 3 m above the deck
LOOK_STATE = 71  # random stream
QUANTITIES = {  # name: fields of Deviations, of Guidance and of Protection
    "lateral": ("lateral_m", "lateral_deviation_m", "lateral_m"),
    "height": ("height_m", "height_above_deck_m", "vertical_m"),
    "heading": ("heading_rad", "heading_error_rad", "heading_rad"),
    "distance": ("distance_m", "distance_to_ramp_m", "distance_m"),
    "lateral rate": ("lateral_rate_m_s", "lateral_rate_m_s", None),
    "height rate": ("height_rate_m_s", "height_rate_m_s", None),
    "closing": ("closing_m_s", "closing_m_s", None),
    "deck": ("deck_acceleration_m_s2", "deck_acceleration_m_s2", None),
}


def approach_moments(scene: Surroundings) -> list[Moment]:
    """Moments along an approach at the camera's rate, with offsets and turbulence that follow from the seed."""
    path = approach_path(scene)
    last_s = (path.start_m + PAST_RAMP_M) / path.closing_m_s
    return [moment_at(path, float(t)) for t in np.arange(0.0, last_s, 1.0 / scene.config.camera.rate_hz)]


def approach_path(scene: Surroundings) -> ApproachPath:
    """A final approach to the landing's ship in the landing's wind."""
    config, rng = scene.config, np.random.default_rng([scene.seed, LOOK_STATE])
    wind_from = np.deg2rad(config.wind_from_deg)
    flight = FlightConfig(
        speed_m_s=AIRSPEED_M_S,
        headwind_m_s=float(config.wind_m_s * np.cos(wind_from)),
        crosswind_m_s=float(config.wind_m_s * np.sin(wind_from)),
        lateral_offset_m=float(rng.normal(0.0, 10.0)),
        vertical_offset_m=float(rng.normal(0.0, 3.0)),
        turbulence_m_s=float(config.turbulence * rng.uniform(0.3, 1.5)),
    )
    motion = MotionConfig(config.sea_state, config.ship_speed_m_s)
    described = SimConfig(
        config.ship, seed=scene.seed, start_m=config.start_m, end_m=END_M, motion=motion, flight=flight
    )
    return flight_path(described, scene.deck.layout, scene.deck.motion)


def moment_at(path: ApproachPath, time_s: float) -> Moment:
    """The true state at a time; the body's nose is above the line of sight to the deck by the camera's down-tilt."""
    nose_up = Rotation.from_euler("y", MOUNT_DOWN_DEG, degrees=True)
    now, before, after = (pose_at(path, time_s + step)[0] for step in (0.0, -STEP_S, STEP_S))
    body = RigidTransform.from_components(now.translation, now.rotation * nose_up)
    turned = (before.rotation * nose_up).inv() * (after.rotation * nose_up)
    return Moment(
        time_s,
        body,
        (after.translation - before.translation) / (2 * STEP_S),
        turned.as_rotvec() / (2 * STEP_S),
    )


def fly_looks(scene: Surroundings, sight: Sight) -> list[dict[str, Any]]:
    """The looks of a way to see along an approach; the points of those that have them are left out."""
    seen = ((moment, sight.see(moment)) for moment in approach_moments(scene))
    return [look_record(scene, moment, found, None) for moment, found in seen if found is not None]


def look_record(scene: Surroundings, moment: Moment, found: Guidance, detection: Detection | None) -> dict[str, Any]:
    """One look in plain values: status, errors against truth with 1-sigma and level, and the points of its lines."""
    exact = deviations(scene, moment.time_s, moment.world_from_body, moment.velocity_m_s)
    ramp, _ = scene.deck.centre_line(moment.time_s)
    record: dict[str, Any] = {
        "time_s": moment.time_s,
        "range_m": float(np.linalg.norm((ramp - moment.world_from_body.translation)[:2])),
        "status": str(found.status),
        "flags": [str(flag.reason) for flag in found.flags],
        "errors": {
            name: _error(getattr(exact, true), getattr(found, field), found.protection, level)
            for name, (true, field, level) in QUANTITIES.items()
        },
    }
    if detection is not None:
        record["frames"] = detection.frames
        record |= {side: _points(getattr(detection, side)) for side in SIDES}
    return record


def _error(
    exact: float, found: Value | None, levels: Protection | None, level: str | None
) -> list[float | None] | None:
    """Error, 1-sigma and protection level; None: nothing was given."""
    if found is None:
        return None
    return [found.value - exact, found.sigma, None if levels is None or level is None else getattr(levels, level)]


def _points(points: LinePoints) -> list[list[float]]:
    return np.column_stack([points.points_px, points.confidence, points.sigma_px]).round(4).tolist()


def points_of(rows: list[list[float]]) -> LinePoints:
    """The points of a recorded line."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return LinePoints(values[:, :2], values[:, 2], values[:, 3])


def looks_json(scene: Surroundings, looks: list[dict[str, Any]]) -> bytes:
    """The file of the looks of one flight, with its configuration and seed."""
    data = {"config": settings_to_json(asdict(scene.config)), "seed": scene.seed, "looks": looks}
    return json.dumps(data, separators=(",", ":")).encode()


def read_looks(path: Path) -> tuple[Surroundings, list[dict[str, Any]]]:
    """The surroundings and the looks of a flight that `looks_json` describes."""
    data: Mapping[str, Any] = json.loads(path.read_text())
    config = config_from_table(LandingConfig, settings_from_json(data["config"]))
    return surroundings(config, data["seed"]), data["looks"]
