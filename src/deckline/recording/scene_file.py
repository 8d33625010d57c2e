"""scene.json: what a simulator knows about a recording (cameras, deck height, true lines, atmosphere).

{"format": "deckline-scene", "version": 1, "camera": {...}, free keys such as "preset" and "seed",
 "frames": {"<image file>": {"camera": {...} when it differs, "time_s": exact time, "deck_z_m": ..., "sea_z_m": ...,
   "truth": {"left": {"p0_m": [...], "p1_m": [...]} or null, "right": ..., "visibility_m": metres or null,
             "centre_painted": whether a line is painted midway between them, absent when that is not known,
             "clear_air": true when the visibility is infinite, "airlight_rgb": [...], "clear_image": "clear/<file>",
             "world_from_body": {...} when the recorded pose is a measured one, "world_from_ship": {...},
             "conditions": {...} what air, light and camera were like}}}}
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from deckline.recording.camera_file import (
    HEIGHTS,
    MountedCamera,
    camera_from_mapping,
    transform_from_mapping,
    transform_to_mapping,
)
from deckline.recording.source import RecordingError, check_number, check_numbers, is_inside, parse_json, read_text
from deckline.types import Frame, Segment, Truth

SCENE_FILE = "scene.json"
FORMAT = "deckline-scene"
VERSION = 1
RESERVED = ("format", "version", "camera", "frames")
POSES = ("world_from_body", "world_from_ship")  # of a frame's truth


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A parsed scene.json. Entries of single frames are checked when they are asked for."""

    camera: MountedCamera | None = None
    frames: dict[str, Any] | None = None  # by image file name; None: the file speaks of no single frames
    extra: dict[str, Any] = field(default_factory=dict)  # the free keys


def read_scene(path: Path) -> SceneFile:
    """Read scene.json; a RecordingError for no JSON, another format or version, or a camera that is none."""
    values = parse_json(read_text(path), str(path))
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise RecordingError(f'{path}: not a deckline scene (it must hold "format": "{FORMAT}")')
    if values.get("version") != VERSION:
        raise RecordingError(f"{path}: scene version {values.get('version')!r}, this deckline reads {VERSION}")
    frames = values.get("frames")
    if frames is not None and not isinstance(frames, dict):
        raise RecordingError(f"{path}: frames must be an object by image file name, got {type(frames).__name__}")
    raw_camera = values.get("camera")
    camera = None if raw_camera is None else camera_from_mapping(raw_camera, f"{path}: camera")
    return SceneFile(camera, frames, {key: value for key, value in values.items() if key not in RESERVED})


def get_heights(frame: Frame) -> dict[str, float]:
    """World z of deck and sea, as far as the frame knows them, for its entry."""
    return {name: float(getattr(frame, name)) for name in HEIGHTS if getattr(frame, name) is not None}


def format_entry(entry: Mapping[str, Any], indent: int | None = None) -> str:
    """A frame's entry as JSON, by default in one line; NaN and infinity are a RecordingError."""
    try:
        return json.dumps(entry, indent=indent, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordingError(f"scene values must be plain finite JSON values: {error}") from None


def format_scene(camera: Mapping | None, entries: Mapping[str, str], extra: Mapping) -> str:
    """Text of scene.json, one frame a line; errors as `format_entry`.

    Args:
        entries: what `format_entry` made of each frame's entry, by image file name.
    """
    head = format_entry({"format": FORMAT, "version": VERSION, **extra, "camera": camera}, indent=1)
    lines = ",".join(f"\n  {json.dumps(name)}: {text}" for name, text in entries.items())
    return head[:-2] + ',\n "frames": {' + lines + "\n }\n}\n"


def truth_to_mapping(truth: Truth, clear_image: str | None) -> dict[str, Any]:
    """The JSON object that `truth_from_mapping` reads back."""
    clear_air = truth.visibility_m is not None and math.isinf(truth.visibility_m)
    known = {
        "centre_painted": truth.centre_painted,
        "visibility_m": None if truth.visibility_m is None or clear_air else float(truth.visibility_m),
        "clear_air": clear_air or None,
        "airlight_rgb": None if truth.airlight_rgb is None else [float(value) for value in truth.airlight_rgb],
        "clear_image": clear_image,
        **{name: transform_to_mapping(to) for name in POSES if (to := getattr(truth, name)) is not None},
        "conditions": dict(truth.conditions) or None,
    }
    given = {
        name: value for name, value in known.items() if value is not None or (clear_air and name == "visibility_m")
    }
    sides = {"left": truth.left, "right": truth.right}
    lines = {
        side: None if x is None else {key: value.tolist() for key, value in vars(x).items()}
        for side, x in sides.items()
    }
    return {**lines, **given}


def truth_from_mapping(values: Any, clear_rgb: np.ndarray | None = None) -> Truth:
    """Truth of one frame; a ValueError for values of the wrong kind or shape."""
    if not isinstance(values, dict):
        raise ValueError(f"truth must be an object, got {values!r}")
    conditions = values.get("conditions", {})
    if not isinstance(conditions, dict):
        raise ValueError(f"truth.conditions must be an object, got {conditions!r}")
    centre = values.get("centre_painted")
    if centre is not None and not isinstance(centre, bool):
        raise ValueError(f"truth.centre_painted must be true or false, got {centre!r}")
    visibility = values.get("visibility_m")
    if visibility is not None and (visibility := check_number(visibility, "truth.visibility_m")) <= 0:
        raise ValueError(f"truth.visibility_m must be metres > 0, got {visibility!r}")
    airlight = values.get("airlight_rgb")
    if airlight is not None:
        airlight = check_numbers(airlight, 3, "truth.airlight_rgb")
    return Truth(
        left=_segment_from_mapping(values.get("left"), "truth.left"),
        right=_segment_from_mapping(values.get("right"), "truth.right"),
        centre_painted=centre,
        visibility_m=math.inf if values.get("clear_air") is True else visibility,
        airlight_rgb=None if airlight is None else (airlight[0], airlight[1], airlight[2]),
        clear_rgb=clear_rgb,
        conditions=conditions,
        **{name: transform_from_mapping(values[name], f"truth.{name}") for name in POSES if name in values},
    )


def get_clear_image(values: Any) -> str | None:
    """Relative path of a frame's image without haze, or None; a ValueError for one that leaves the folder."""
    name = values.get("clear_image") if isinstance(values, dict) else None
    if name is not None and (not isinstance(name, str) or not is_inside(name)):
        raise ValueError(f"truth.clear_image must be a path inside the recording, got {name!r}")
    return name


def _segment_from_mapping(values: Any, where: str) -> Segment | None:
    if values is None:
        return None
    if not isinstance(values, dict) or not {"p0_m", "p1_m"} <= set(values):
        raise ValueError(f"{where} must hold p0_m and p1_m, got {values!r}")
    return Segment(*(np.array(check_numbers(values[key], 3, f"{where}.{key}")) for key in ("p0_m", "p1_m")))
