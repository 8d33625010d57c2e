"""camera.toml: intrinsics and mounting of a camera, and the same as a JSON object in scene.json."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import BODY_FROM_OPTICAL, Camera, camera_mount, pose
from deckline.recording.source import RecordingError, read_text

CAMERA_FILE = "camera.toml"
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
HEIGHTS = ("deck_z_m", "sea_z_m")
EXAMPLE = "width, height, fx, fy, cx, cy in px, one a line, such as fx = 1000.0"


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """A camera, where it sits on the aircraft, and the heights of deck and sea when the same file says them."""

    camera: Camera
    body_from_camera: RigidTransform
    deck_z_m: float | None = None  # world z (down) of the deck plane
    sea_z_m: float | None = None  # world z (down) of the water

    def at(self, deck_z_m: float | None, sea_z_m: float | None) -> "MountedCamera":
        """The same with other heights; None keeps what the file says."""
        given = {"deck_z_m": deck_z_m, "sea_z_m": sea_z_m}
        heights = {name: getattr(self, name) if value is None else value for name, value in given.items()}
        return MountedCamera(self.camera, self.body_from_camera, **heights)


def read_camera_file(path: Path) -> MountedCamera:
    """Read camera.toml.

    Keys: width, height, fx, fy, cx, cy (px, the centre of the top-left pixel is 0, 0); optional distortion =
    [k1, k2, p1, p2, k3], deck_z_m and sea_z_m (metres), and a table [body_from_camera] with translation_m (3, metres,
    forward-right-down) and quaternion_wxyz of body <- optical frame (x right, y down, z forward). Without the table, or
    without its quaternion, the camera looks along the body's forward axis: quaternion_wxyz = [0.5, 0.5, 0.5, 0.5].

    Raises:
        RecordingError: missing or unreadable file, an unknown or missing key, or values that make no camera.
    """
    try:
        values = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise RecordingError(f"{path}: not valid TOML: {error}") from None
    return camera_from_mapping(values, str(path), allow_heights=True)


def camera_from_mapping(values: Any, where: str, *, allow_heights: bool = False) -> MountedCamera:
    """Camera from parsed TOML or JSON; `where` begins every error line.

    Raises:
        RecordingError: an unknown or missing key, or values that make no camera.
    """
    if not isinstance(values, Mapping):
        raise RecordingError(f"{where}: a camera must be a table with {', '.join(INTRINSICS)}, got {values!r}")
    known = (*INTRINSICS, "distortion", "body_from_camera", *(HEIGHTS if allow_heights else ()))
    _check_keys(values, known, where)
    missing = [key for key in INTRINSICS if key not in values]
    if missing:
        raise RecordingError(f"{where}: {', '.join(missing)} missing; a camera file holds {EXAMPLE}")
    width, height = (_size(values[key], f"{where}: {key}") for key in INTRINSICS[:2])
    fx, fy, cx, cy = (_number(values[key], f"{where}: {key}") for key in INTRINSICS[2:])
    k1, k2, p1, p2, k3 = _numbers(values.get("distortion", [0.0] * 5), 5, f"{where}: distortion (k1, k2, p1, p2, k3)")
    heights = {key: _number(values[key], f"{where}: {key}") for key in HEIGHTS if key in values}
    try:
        camera = Camera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
    except ValueError as error:
        raise RecordingError(f"{where}: {error}") from None
    mount = _mount(values.get("body_from_camera", {}), f"{where}: body_from_camera")
    return MountedCamera(camera, mount, **heights)


def camera_to_mapping(camera: Camera, body_from_camera: RigidTransform) -> dict[str, Any]:
    """The JSON object that `camera_from_mapping` reads back."""
    return {
        **{key: getattr(camera, key) for key in INTRINSICS[:2]},
        **{key: float(getattr(camera, key)) for key in INTRINSICS[2:]},
        "distortion": [float(value) for value in camera.distortion],
        "body_from_camera": transform_to_mapping(body_from_camera),
    }


def camera_text(camera: Camera, body_from_camera: RigidTransform) -> str:
    """Text of a camera.toml that `read_camera_file` reads back."""
    values = camera_to_mapping(camera, body_from_camera)
    mount = values.pop("body_from_camera")
    rows = [f"{key} = {value}" for key, value in values.items()]
    rows += ["", "[body_from_camera]", *(f"{key} = {value}" for key, value in mount.items())]
    return "\n".join(rows) + "\n"


def transform_to_mapping(transform: RigidTransform) -> dict[str, list[float]]:
    """The JSON object that `transform_from_mapping` reads back."""
    translation, rotation = transform.as_components()
    return {
        "translation_m": np.asarray(translation).tolist(),
        "quaternion_wxyz": rotation.as_quat(scalar_first=True).tolist(),
    }


def transform_from_mapping(values: Any, where: str) -> RigidTransform:
    """Rigid transform from parsed TOML or JSON with translation_m and quaternion_wxyz.

    Raises:
        RecordingError: an unknown or missing key, or numbers that make no pose.
    """
    if not isinstance(values, Mapping) or not {"translation_m", "quaternion_wxyz"} <= set(values):
        raise RecordingError(f"{where}: must be a table with translation_m and quaternion_wxyz, got {values!r}")
    _check_keys(values, ("translation_m", "quaternion_wxyz"), where)
    translation = _numbers(values["translation_m"], 3, f"{where}.translation_m")
    quaternion = _numbers(values["quaternion_wxyz"], 4, f"{where}.quaternion_wxyz")
    try:
        return pose(translation, quaternion)
    except ValueError as error:
        raise RecordingError(f"{where}: {error}") from None


def _mount(values: Any, where: str) -> RigidTransform:
    if not isinstance(values, Mapping):
        raise RecordingError(f"{where}: must be a table with translation_m and quaternion_wxyz, got {values!r}")
    _check_keys(values, ("translation_m", "quaternion_wxyz"), where)
    if "quaternion_wxyz" not in values:
        return camera_mount(_numbers(values.get("translation_m", [0.0] * 3), 3, f"{where}.translation_m"))
    try:
        return transform_from_mapping({"translation_m": [0.0] * 3, **values}, where)
    except RecordingError as error:
        straight = BODY_FROM_OPTICAL.as_quat(scalar_first=True).tolist()
        raise RecordingError(f"{error}; a camera that looks forward has {straight}") from None


def _check_keys(values: Mapping, known: tuple[str, ...], where: str) -> None:
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        raise RecordingError(f"{where}: unknown key {', '.join(unknown)}; known are {', '.join(known)}")


def _size(value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise RecordingError(f"{where} must be a whole number of px, got {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RecordingError(f"{where} must be a finite number, got {value!r}")
    return float(value)


def _numbers(values: Any, count: int, where: str) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise RecordingError(f"{where} must be {count} numbers, got {values!r}")
    return [_number(value, where) for value in values]
