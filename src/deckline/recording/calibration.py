"""Camera calibrations as YAML: OpenCV's FileStorage and ROS camera_info files.

Source: OpenCV, "Camera calibration with OpenCV" (camera_matrix, distortion_coefficients, image_width, image_height,
fisheye_model); ROS, sensor_msgs/CameraInfo (distortion_model plumb_bob, rational_polynomial, equidistant).
"""

from pathlib import Path
from typing import Any

import yaml

from deckline.files import MOST_CONFIG_BYTES, parse_plain
from deckline.recording.source import RecordingError, check_number, read_text

YAML_SUFFIXES = (".yaml", ".yml")
OPENCV_TAG = "!!opencv-matrix"
BROWN_CONRADY, EQUIDISTANT = ("plumb_bob", "rational_polynomial"), ("equidistant", "fisheye")
COEFFICIENTS = 8  # of OpenCV's 14 that a camera here has; those of thin prisms and tilted sensors must be 0


def read_calibration(path: Path) -> dict[str, Any]:
    """Intrinsics under the keys of camera.toml, px, (0, 0) the centre of the top-left pixel.

    Raises:
        RecordingError: missing or unreadable file, no YAML, or no calibration; names the key.
    """
    text = "\n".join(line for line in read_text(path, MOST_CONFIG_BYTES).splitlines() if not line.startswith("%YAML"))
    try:
        values = parse_plain(yaml.safe_load, text.replace(OPENCV_TAG, ""))
    except (yaml.YAMLError, ValueError) as error:
        raise RecordingError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None
    try:
        return to_camera_keys(values)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None


def to_camera_keys(values: Any) -> dict[str, Any]:
    """Keys of camera.toml from those of a YAML calibration; a ValueError for values that make no camera."""
    required = ("image_width", "image_height", "camera_matrix")
    if not isinstance(values, dict) or (missing := [key for key in required if key not in values]):
        what = ", ".join(missing) if isinstance(values, dict) else "everything"
        raise ValueError(f"{what} missing; a calibration has {', '.join(required)}, distortion_coefficients")
    matrix = _numbers(values, "camera_matrix")
    if len(matrix) != 9 or [*matrix[3:4], *matrix[6:]] != [0.0, 0.0, 0.0, 1.0] or matrix[1] != 0.0:
        raise ValueError(f"camera_matrix must be fx 0 cx, 0 fy cy, 0 0 1; got {matrix}")
    distortion = _numbers(values, "distortion_coefficients") if "distortion_coefficients" in values else []
    model = values.get("distortion_model", "equidistant" if values.get("fisheye_model") else "plumb_bob")
    if model not in (*BROWN_CONRADY, *EQUIDISTANT):
        known = ", ".join((*BROWN_CONRADY, *EQUIDISTANT))
        raise ValueError(f"distortion_model must be one of {known}; got {model!r}")
    camera = {"width": values["image_width"], "height": values["image_height"]}
    camera |= {"fx": matrix[0], "cx": matrix[2], "fy": matrix[4], "cy": matrix[5]}
    if model in EQUIDISTANT:
        return camera | {"fisheye": True, "distortion": distortion or [0.0] * 4}
    if any(distortion[COEFFICIENTS:]):
        raise ValueError(f"distortion_coefficients beyond k6 (thin prism, tilt) must be 0; got {distortion}")
    if len(distortion) in (0, 4):  # k3 is 0
        distortion = (distortion or [0.0] * 4) + [0.0]
    return camera | {"distortion": distortion[:COEFFICIENTS]}


def _numbers(values: dict[str, Any], key: str) -> list[float]:
    """Numbers of a matrix: a table with `data`, or a plain list of numbers or rows."""
    data = values[key].get("data") if isinstance(values[key], dict) else values[key]
    if not isinstance(data, list):
        raise ValueError(f"{key} must have numbers as data, got {data!r}")
    flat = [number for row in data for number in (row if isinstance(row, list) else [row])]
    try:
        flat = [float(number) if isinstance(number, str) else number for number in flat]  # YAML 1.1 reads 1e-5 as text
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from None
    return [check_number(number, key) for number in flat]
