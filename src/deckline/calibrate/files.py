"""A calibration as text for people, as JSON, and as the configuration that `deckline run` reads."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deckline.calibrate.model import CAMERA_NAMES, DELAY, FOCAL, NAMES, PITCH, ROLL, camera_of, mount_of
from deckline.calibrate.observations import ApproachView
from deckline.calibrate.solve import INSEPARABLE, Calibration, Outcome
from deckline.config import RunConfig
from deckline.config_file import to_toml_text
from deckline.recording.camera_file import CAMERA_FILE, format_camera

CONFIG_FILE, JSON_FILE = "calibration.toml", "calibration.json"
DEG = 180.0 / np.pi
# Unit and factor from the state's own unit, in the order of NAMES.
UNITS = dict(
    zip(
        NAMES,
        [("deg", DEG)] * 3
        + [("%", 100.0), ("px", 1.0), ("px", 1.0), ("s", 1.0)]
        + [("m", 1.0), ("deg", DEG), ("m/s", 1.0), ("m", 1.0), ("deg", DEG), ("m", 1.0)],
        strict=True,
    )
)


def describe(calibration: Calibration, pose_offset_s: float | None) -> list[str]:
    """Lines of text: what is estimated, and what cannot be told apart.

    Args:
        pose_offset_s: the stated offset of poses by time; None: each picture has its own pose.
    """
    lines = [
        f"lines in {calibration.frames} frames, horizon in {calibration.horizons}; change of what is stated:",
        f"{'quantity':14}{'change':>10}{'1-sigma':>10}  {'unit':5}outcome",
    ]
    fit = calibration.fit
    for number, name in enumerate(CAMERA_NAMES):
        unit, factor = UNITS[name]
        outcome = calibration.outcomes[name]
        if outcome is Outcome.ESTIMATED:
            values = f"{factor * fit.state[number]:+10.3f}{factor * fit.sigma[number]:10.3f}"
        else:
            values = f"{'-':>10}{factor * calibration.free_sigma[number]:10.3f}"
        lines.append(f"{name:14}{values}  {unit:5}{outcome}")
    for name, pair in calibration.held_by.items():
        why = (
            f"it cannot be told from {pair.second} (correlation {pair.correlation:+.3f})"
            if abs(pair.correlation) >= INSEPARABLE
            else "the approach changes it too little"
        )
        lines.append(f"{name} stays as stated: {why}")
    named = {(pair.first, pair.second) for pair in calibration.held_by.values()}
    for pair in calibration.inseparable:
        if not {(pair.first, pair.second), (pair.second, pair.first)} & named:
            lines.append(f"{pair.first} and {pair.second} are hardly separable (correlation {pair.correlation:+.3f})")
    if calibration.outcomes["delay"] is Outcome.ESTIMATED and pose_offset_s is None:
        lines.append("the delay is not written: each picture has a pose of its own, which no offset moves")
    return lines


def write_calibration(
    folder: Path, view: ApproachView, calibration: Calibration, config: RunConfig, pose_offset_s: float | None
) -> list[Path]:
    """Write camera.toml, calibration.toml and calibration.json; returns their paths.

    Args:
        folder: is made where it is missing.
        config: as the approach was calibrated with.
        pose_offset_s: as in `describe`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    camera = camera_of(view, calibration.state)
    texts = {
        CAMERA_FILE: format_camera(camera, mount_of(view, calibration.state), view.heights),
        CONFIG_FILE: format_config(calibration, config, pose_offset_s),
        JSON_FILE: json.dumps(to_mapping(calibration), indent=1) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in texts]


def format_config(calibration: Calibration, config: RunConfig, pose_offset_s: float | None) -> str:
    """TOML of what differs from the default configuration: what was stated, changed by the calibration.

    That is the poses' offset, and accuracies that are stated better than the calibration reaches.
    """
    outcomes, sigma = calibration.outcomes, calibration.fit.sigma
    estimated = [number for number in range(len(CAMERA_NAMES)) if outcomes[NAMES[number]] is Outcome.ESTIMATED]
    is_placed = DELAY in estimated and pose_offset_s is not None
    reached = {
        "attitude_deg": DEG * max((float(sigma[number]) for number in estimated if number in (ROLL, PITCH)), default=0),
        "focal_fraction": float(sigma[FOCAL]) if FOCAL in estimated else 0.0,
        "delay_s": float(sigma[DELAY]) if is_placed else 0.0,
    }
    sensors: dict[str, Any] = {name: max(value, getattr(config.sensors, name)) for name, value in reached.items()}
    config = replace(config, sensors=replace(config.sensors, **sensors))
    if is_placed and pose_offset_s is not None:
        offset_s = round(pose_offset_s + float(calibration.state[DELAY]), 6)
        config = replace(config, navigation=replace(config.navigation, offset_s=offset_s))
    rows: list[str] = []
    table = ""
    for row, default in zip(to_toml_text(config).splitlines(), to_toml_text(RunConfig()).splitlines(), strict=True):
        if row.startswith("["):
            table = row
        elif row != default:
            rows += [row] if table in rows or not table else [table, row]
    return "\n".join(rows) + "\n"


def to_mapping(calibration: Calibration) -> dict[str, Any]:
    """Estimates, 1-sigmas and correlations of all quantities, in their units, as JSON holds them."""
    fit = calibration.fit
    quantities = {}
    for number, name in enumerate(NAMES):
        unit, factor = UNITS[name]
        quantities[name] = {
            "unit": unit,
            "change": factor * float(fit.state[number]),
            "sigma": factor * float(fit.sigma[number]),
            "sigma_nothing_held": factor * float(calibration.free_sigma[number]),
            "outcome": calibration.outcomes.get(name),
        }
    return {
        "quantities": quantities,
        "order": list(NAMES),
        "correlation": np.round(fit.correlation, 6).tolist(),
        "inseparable": [vars(pair) for pair in calibration.inseparable],
        "frames": calibration.frames,
        "horizons": calibration.horizons,
        "noise_scale": {"points": fit.point_scale, "horizon": fit.horizon_scale},
    }
