"""camera.toml: intrinsics and mounting of a camera, the same as a JSON object in scene.json, and YAML calibrations."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.files import MOST_CONFIG_BYTES, parse_toml
from deckline.geometry import (
    BODY_FROM_OPTICAL,
    UNKNOWN_FOCAL_SIGMA,
    UNKNOWN_FOV_DEG,
    Camera,
    camera_mount,
    pose,
)
from deckline.recording.calibration import YAML_SUFFIXES, read_calibration
from deckline.recording.source import RecordingError, check_number, check_numbers, read_text
from deckline.types import CAMERA_REMEDY, Frame

CAMERA_FILE = "camera.toml"
CAMERA_FILES = (CAMERA_FILE, *(f"camera{suffix}" for suffix in YAML_SUFFIXES))
INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
HEIGHTS = ("deck_z_m", "sea_z_m")
TRANSFORM = ("translation_m", "quaternion_wxyz")
FOV_TOLERANCE_DEG = 1.0  # between a camera file and a stated field of view, which people round
STATED, OF_OPTION = "stated by --fov-deg", "of --camera"  # where a camera comes from, in notes
FORWARD = BODY_FROM_OPTICAL.as_quat(scalar_first=True).tolist()
EXAMPLE = "width, height, fx, fy, cx, cy in px, one a line, such as fx = 1000.0"


@dataclass(frozen=True, eq=False)
class MountedCamera:
    """A camera, where it sits on the aircraft, and the heights of deck and sea that the same file states."""

    camera: Camera
    body_from_camera: RigidTransform
    deck_z_m: float | None = None  # world z (down) of the deck plane
    sea_z_m: float | None = None  # world z (down) of the water

    def at(self, deck_z_m: float | None, sea_z_m: float | None) -> "MountedCamera":
        """The same with other heights; None leaves what the file states."""
        deck_z_m = self.deck_z_m if deck_z_m is None else deck_z_m
        return replace(self, deck_z_m=deck_z_m, sea_z_m=self.sea_z_m if sea_z_m is None else sea_z_m)

    def fit(self, width: int, height: int) -> "MountedCamera":
        """The same for pictures of another size, px, and the same shape; a ValueError for another shape."""
        camera = self.camera
        if (camera.width, camera.height) == (width, height):
            return self
        if not _same_shape(camera, width, height):
            raise ValueError(
                f"the intrinsics are for {camera.width}x{camera.height} px but the image is {width}x{height} px, which "
                f"has another shape; give a camera file made for this size"
            )
        return replace(self, camera=camera.resized(width, height))

    def for_square_pixels(self, size: tuple[int, int], stored_size: tuple[int, int]) -> "MountedCamera":
        """The same for pictures whose pixels are made square, where the intrinsics are for pixels as stored.

        Args:
            size, stored_size: width and height with square pixels, and as stored, px.
        """
        if size == stored_size or _same_shape(self.camera, *size) or not _same_shape(self.camera, *stored_size):
            return self
        return replace(self, camera=self.camera.resized(*size))

    def frame(self, file: str, time_s: float, image_rgb: NDArray[np.uint8], **values: Any) -> Frame:
        """A frame of this camera, other fields in `values`; intrinsics for another image size are a ValueError."""
        camera, (height, width) = self.camera, image_rgb.shape[:2]
        if (camera.height, camera.width) != (height, width):
            raise ValueError(
                f"the intrinsics are for {camera.width}x{camera.height} px but the image is {width}x{height} px; "
                f"give a camera file made for this size"
            )
        return Frame(file=file, time_s=time_s, image_rgb=image_rgb, **{**vars(self), **values})


def _same_shape(camera: Camera, width: int, height: int) -> bool:
    """Whether a picture's shape is that of a camera's, to a pixel."""
    return abs(camera.height * width / camera.width - height) < 1.0


def make_pinhole(width: int, height: int, fov_deg: float) -> MountedCamera:
    """A pinhole of this horizontal field of view, degrees, along the body's forward axis."""
    return MountedCamera(Camera.from_fov(width, height, float(np.deg2rad(fov_deg))), camera_mount())


def note_camera(name: str, camera: Camera, origin: str, fov_deg: float | None = None) -> str:
    """The note on which camera a source takes; errors as `check_fov`.

    Args:
        origin: where the camera comes from, such as "of camera.toml".
        fov_deg: the stated field of view that it must not contradict; None: nobody stated one, or it is that one's.
    """
    check_fov(camera, fov_deg, name)
    sigma = "" if camera.focal_sigma is None else f", focal length to {camera.focal_sigma:.0%}"
    return f"{name}: camera {origin}: {camera.fov_deg:.1f} degrees across {camera.width}x{camera.height} px{sigma}"


def note_assumed(name: str, why: str, remedy: str) -> str:
    """The note on a source without a camera."""
    prior = f"{UNKNOWN_FOV_DEG:g} degrees across, focal length to {UNKNOWN_FOCAL_SIGMA:.0%}"
    return f"{name}: {why}: camera assumed: {prior}, nothing is ok; state --fov-deg, or {remedy}"


def check_fov(camera: Camera, fov_deg: float | None, where: str) -> None:
    """Raise RecordingError, which begins with `where`, for a camera that contradicts a stated field of view.

    Args:
        fov_deg: horizontal, degrees; None: nobody stated one.
    """
    if fov_deg is None:
        return
    found_deg = camera.fov_deg
    if not abs(found_deg - fov_deg) <= FOV_TOLERANCE_DEG:  # NaN: its edges have no rays
        raise RecordingError(
            f"{where}: its camera has a horizontal field of view of {found_deg:.1f} degrees, "
            f"which contradicts --fov-deg {fov_deg:g}; state one of both"
        )


def read_camera_file(path: Path) -> MountedCamera:
    """Read camera.toml, or a YAML calibration of OpenCV or ROS, whose camera points along the body's forward axis.

    Keys: width, height, fx, fy, cx, cy (px, the centre of the top-left pixel is 0, 0); optional distortion =
    [k1, k2, p1, p2, k3], or with fisheye = true [k1, k2, k3, k4]; focal_sigma, the 1-sigma of a focal length that is
    assumed, as a share; calibration = a YAML file beside it in place of all these; deck_z_m and sea_z_m (metres), and a
    table [body_from_camera] with translation_m (3, metres, forward-right-down) and quaternion_wxyz of body <- optical
    frame (x right, y down, z forward). Without the table, or without its quaternion, the camera points along the body's
    forward axis: quaternion_wxyz = [0.5, 0.5, 0.5, 0.5].

    Raises:
        RecordingError: missing or unreadable file, an unknown or missing key, or values that make no camera.
    """
    if path.suffix.lower() in YAML_SUFFIXES:
        return camera_from_mapping(read_calibration(path), str(path))
    try:
        values = parse_toml(read_text(path, MOST_CONFIG_BYTES))
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(f"{path}: not valid TOML: {error}") from None
    if "calibration" in values:
        values = {**read_calibration(path.parent / str(values.pop("calibration"))), **values}
    return camera_from_mapping(values, str(path), allow_heights=True)


def camera_from_mapping(values: Any, where: str, *, allow_heights: bool = False) -> MountedCamera:
    """Camera from parsed TOML or JSON; `where` begins the RecordingError for values that make no camera."""
    heights = HEIGHTS if allow_heights else ()
    try:
        _check_keys(values, INTRINSICS, ("distortion", "fisheye", "focal_sigma", "body_from_camera", *heights))
        width, height = values["width"], values["height"]
        for name, value in (("width", width), ("height", height)):
            if isinstance(value, bool) or not isinstance(value, int):
                raise ValueError(f"{name} must be a whole number of px, got {value!r}")
        fx, fy, cx, cy = (check_number(values[key], key) for key in INTRINSICS[2:])
        if not isinstance(fisheye := values.get("fisheye", False), bool):
            raise ValueError(f"fisheye must be true or false, got {fisheye!r}")
        distortion = values.get("distortion", [0.0] * (4 if fisheye else 5))
        distortion = check_numbers(distortion, len(distortion) if isinstance(distortion, list) else 5, "distortion")
        sigma = check_number(values["focal_sigma"], "focal_sigma") if "focal_sigma" in values else None
        camera = Camera(width, height, fx, fy, cx, cy, distortion, fisheye=fisheye, focal_sigma=sigma)
        mount = values.get("body_from_camera", {})
        if isinstance(mount, Mapping):
            mount = {"translation_m": [0.0] * 3, "quaternion_wxyz": FORWARD, **mount}
        mount = transform_from_mapping(mount, "body_from_camera")
        return MountedCamera(camera, mount, **{key: check_number(values[key], key) for key in heights if key in values})
    except ValueError as error:
        raise RecordingError(f"{where}: {error}") from None


def camera_to_mapping(camera: Camera, body_from_camera: RigidTransform) -> dict[str, Any]:
    """The JSON object that `camera_from_mapping` reads back; a ValueError for a camera that is not known."""
    if not camera.known:
        raise ValueError(f"camera not known: {CAMERA_REMEDY}")
    return {
        **{key: getattr(camera, key) for key in INTRINSICS[:2]},
        **{key: float(getattr(camera, key)) for key in INTRINSICS[2:]},
        "distortion": [float(value) for value in camera.distortion],
        **({"fisheye": True} if camera.fisheye else {}),
        **({} if camera.focal_sigma is None else {"focal_sigma": float(camera.focal_sigma)}),
        "body_from_camera": transform_to_mapping(body_from_camera),
    }


def format_camera(camera: Camera, body_from_camera: RigidTransform, heights: Mapping[str, float] | None = None) -> str:
    """Text of a camera.toml that `read_camera_file` reads back; `heights`: world z, m, by name of HEIGHTS."""
    values = camera_to_mapping(camera, body_from_camera)
    mount = values.pop("body_from_camera")
    rows = [f"{key} = {str(value).lower()}" for key, value in (values | dict(heights or {})).items()]
    rows += ["", "[body_from_camera]", *(f"{key} = {value}" for key, value in mount.items())]
    return "\n".join(rows) + "\n"


def transform_to_mapping(transform: RigidTransform) -> dict[str, list[float]]:
    """The JSON object that `transform_from_mapping` reads back."""
    translation, rotation = transform.as_components()
    quaternion = rotation.as_quat(scalar_first=True)
    return {"translation_m": np.asarray(translation).tolist(), "quaternion_wxyz": quaternion.tolist()}


def transform_from_mapping(values: Any, name: str) -> RigidTransform:
    """Rigid transform from parsed TOML or JSON; `name` begins the ValueError for values that make none."""
    try:
        _check_keys(values, TRANSFORM)
        return pose(*(check_numbers(values[key], count, key) for key, count in zip(TRANSFORM, (3, 4), strict=True)))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _check_keys(values: Any, required: Collection[str], optional: Collection[str] = ()) -> None:
    if not isinstance(values, Mapping):
        raise ValueError(f"must be a table with {', '.join(required)}, got {values!r}")
    unknown = [str(key) for key in values if key not in (*required, *optional)]
    if unknown:
        raise ValueError(f"unknown key {', '.join(unknown)}; known are {', '.join((*required, *optional))}")
    missing = [key for key in required if key not in values]
    if missing:
        raise ValueError(f"{', '.join(missing)} missing from {', '.join(required)}")
