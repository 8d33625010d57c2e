"""The command-line options of a `RunConfig`, the same for every command that flies."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import tyro

from deckline.config import GRADES, Device, Grade, Mode, Picture, Precision, RunConfig, Sensors, with_grade
from deckline.config_file import config_from_table, read_toml


def _flag(metavar: str) -> Any:
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


Number = Annotated[float | None, _flag("N")]
Point = Annotated[tuple[float, float, float] | None, _flag("X Y Z")]
Velocity = Annotated[tuple[float, float] | None, _flag("NORTH EAST")]
Model = Annotated[str | None, _flag("MODEL")]

TARGETS = {  # option -> section and field of the RunConfig
    "position_sigma_m": ("sensors", "position_m"),
    "attitude_sigma_deg": ("sensors", "attitude_deg"),
    "deck_z_sigma_m": ("sensors", "deck_z_m"),
    "focal_sigma": ("sensors", "focal_fraction"),
    "depth_sigma": ("sensors", "depth_fraction"),
    "delay_sigma_s": ("sensors", "delay_s"),
    "sea_state": ("deck", "sea_state"),
    "runway_width_m": ("deck", "width_m"),
    "ship_velocity_m_s": ("deck", "ship_velocity_m_s"),
    "glideslope_deg": ("approach", "glideslope_deg"),
    "touchdown_m": ("approach", "touchdown_m"),
    "point_m": ("approach", "point_m"),
    "ramp_m": ("survey", "ramp_m"),
    "heading_deg": ("survey", "heading_deg"),
    "dehazer": ("models", "dehazer"),
    "strength": ("models", "strength"),
    "camera_height_m": ("models", "camera_height_m"),
    "detector": ("models", "detector"),
    "detect_in": ("models", "detect_in"),
    "measure_visibility": ("models", "visibility"),
    "device": ("engine", "device"),
    "threads": ("engine", "threads"),
    "precision": ("engine", "precision"),
    "mode": ("localization", "mode"),
}


@dataclass(frozen=True)
class RunOptions:
    """What differs from the configuration file, or without one from the defaults.

    Args:
        config: TOML file with any part of the configuration; options below override it.
        grade: accuracy of the navigation: standard (0.1 m, 0.1 degrees; the default), good, tactical, exact.
        position_sigma_m: 1-sigma of the pose's position.
        attitude_sigma_deg: 1-sigma of the pose's attitude, camera mounting included.
        deck_z_sigma_m: 1-sigma of the reported deck height.
        focal_sigma: 1-sigma of the focal length, as a share.
        depth_sigma: 1-sigma of a depth sample, as a share.
        delay_sigma_s: 1-sigma of the pose's time against the picture's.
        sea_state: 0 to 6: how much the deck moves (default 4); 0 for a runway on land.
        runway_width_m: between the middles of both lines; learned when not given.
        ship_velocity_m_s: of the ship in the world; 0 0 on land. Slow flights need it for ok.
        glideslope_deg: of the wanted approach (3.5).
        touchdown_m: aim point beyond the ramp (70).
        point_m: point of the aircraft that deviations refer to: forward, right, down of the body origin.
        ramp_m: where the runway begins in the world, if that is known; with --heading-deg it guides the search.
        heading_deg: direction of landing of that runway.
        dehazer: name (see `deckline info`) or .onnx file; none: no dehazing.
        strength: of the dehazing, 0 to 1 (default 1).
        camera_height_m: above the water, for the visibility of pictures without a pose or a height.
        detector: name (see `deckline info`) or .onnx file.
        detect_in: the picture that the detector sees: hazy, or dehazed as published.
        device: what computes the networks: cpu (ONNX Runtime; the default), openvino, cuda or tensorrt.
        threads: of the processor, for the networks; all when not given.
        precision: of the networks' arithmetic: f32 (the default), or with openvino bf16 where the processor has it.
        mode: of distances: depth camera (fine), deck plane (coarse), or both (auto).
        measure_visibility: of every frame, for its record; each is dehazed for it.
        thorough: search every picture whole at once, half a second each.
        no_track: treat every frame alone, without the filter over frames.
    """

    config: Annotated[Path | None, _flag("FILE")] = None
    grade: Annotated[Grade | None, _flag("{standard,good,tactical,exact}")] = None
    position_sigma_m: Number = None
    attitude_sigma_deg: Number = None
    deck_z_sigma_m: Number = None
    focal_sigma: Number = None
    depth_sigma: Number = None
    delay_sigma_s: Number = None
    sea_state: Number = None
    runway_width_m: Number = None
    ship_velocity_m_s: Velocity = None
    glideslope_deg: Number = None
    touchdown_m: Number = None
    point_m: Point = None
    ramp_m: Point = None
    heading_deg: Number = None
    dehazer: Model = None
    strength: Number = None
    camera_height_m: Number = None
    detector: Model = None
    detect_in: Annotated[Picture | None, _flag("{hazy,dehazed}")] = None
    device: Annotated[Device | None, _flag("{cpu,openvino,cuda,tensorrt}")] = None
    threads: Annotated[int | None, _flag("N")] = None
    precision: Annotated[Precision | None, _flag("{f32,bf16}")] = None
    mode: Annotated[Mode | None, _flag("{auto,fine,coarse}")] = None
    measure_visibility: tyro.conf.FlagCreatePairsOff[bool] = False
    thorough: tyro.conf.FlagCreatePairsOff[bool] = False
    no_track: tyro.conf.FlagCreatePairsOff[bool] = False

    @cached_property
    def _table(self) -> dict[str, Any]:
        """Of the file, which is read once, however many configurations are made."""
        return {} if self.config is None else read_toml(self.config)

    def run_config(self, base: RunConfig | None = None) -> RunConfig:
        """The configuration: `base`, overridden by the file, overridden by the options.

        Raises:
            OSError: the file cannot be read.
            ValueError: an unknown key in the file, or a number out of range.
        """
        config = base or RunConfig()
        if self.config is not None:
            config = _override(config, self._table, self.config)
        if self.grade is not None:
            config = replace(config, sensors=with_grade(config.sensors, self.grade))
        flags = {"enabled": False} if self.no_track else {}
        sections: dict[str, dict[str, Any]] = {"tracking": flags | ({"search_s": 0.0} if self.thorough else {})}
        for option, (section, name) in TARGETS.items():
            value = getattr(self, option)
            if value is not None and value is not False:  # a flag that is not set leaves the file's value
                sections.setdefault(section, {})[name] = value
        for section, values in sections.items():
            part = getattr(config, section)
            if section == "sensors":
                values = _white_parts(part, values) | values
            config = replace(config, **{section: replace(part, **values)})
        return config


FlightOptions = Annotated[RunOptions, tyro.conf.arg(name="")]  # as a command's parameter: options without a prefix
DEFAULTS = RunOptions()


def read_run_config(path: Path, base: RunConfig | None = None) -> RunConfig:
    """A configuration from a TOML file; `sensors.grade` names the numbers that the rest of that table overrides.

    Raises:
        OSError: the file cannot be read.
        ValueError: an unknown key or grade, or a value of a wrong type or out of range.
    """
    return _override(base or RunConfig(), read_toml(path), path)


def _override(config: RunConfig, table: dict[str, Any], path: Path) -> RunConfig:
    """A configuration overridden by the table of a file."""
    sensors = table.get("sensors")
    if isinstance(sensors, dict) and "grade" in sensors:
        grade, rest = sensors["grade"], {key: value for key, value in sensors.items() if key != "grade"}
        if grade not in GRADES:
            raise ValueError(f"{path}: sensors.grade must be one of {', '.join(GRADES)}, got {grade!r}")
        config, table = replace(config, sensors=with_grade(config.sensors, grade)), table | {"sensors": rest}
    return config_from_table(RunConfig, table, config, str(path))


def _white_parts(sensors: Sensors, values: dict[str, Any]) -> dict[str, Any]:
    """White noise that has the same share of a newly stated total error."""
    pairs = {"position_m": "position_white_m", "attitude_deg": "attitude_white_deg"}
    stated = [(total, getattr(sensors, total)) for total in pairs if total in values]
    return {pairs[name]: values[name] / total * getattr(sensors, pairs[name]) for name, total in stated if total > 0}
