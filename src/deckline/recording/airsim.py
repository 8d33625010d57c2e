"""Recordings in AirSim's layout: airsim_rec.txt, images/, and our optional scene.json.

airsim_rec.txt is tab-separated and read by its header: time in milliseconds with a fraction, position in metres
(North-East-Down), quaternion w, x, y, z. The pose is the vehicle's (world_from_body), not the camera's. ImageFile joins
with `;` the names img_<vehicle>_<camera>_<type>_<ns>.<ext> of images/, of one or more cameras and types.
Source: AirSim, "Recording" in its documentation; image types in its "Image APIs".
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deckline.files import is_there
from deckline.geometry import pose
from deckline.recording.camera_file import (
    CAMERA_FILE,
    HEIGHTS,
    OF_OPTION,
    STATED,
    MountedCamera,
    camera_from_mapping,
    make_pinhole,
    note_camera,
)
from deckline.recording.images import DEPTH_PERSPECTIVE, DEPTH_PLANAR, read_depth, read_image
from deckline.recording.poses import read_numbers
from deckline.recording.read_options import ReadOptions
from deckline.recording.scene_file import SCENE_FILE, SceneFile, get_clear_image, read_scene, truth_from_mapping
from deckline.recording.source import FrameError, Recording, check_index, check_number, is_inside
from deckline.recording.text_table import Cells, TextTable, read_table
from deckline.types import Frame

RECORD_FILE = "airsim_rec.txt"
IMAGE_FOLDER = "images"
POSE_COLUMNS = ("TimeStamp", "POS_X", "POS_Y", "POS_Z", "Q_W", "Q_X", "Q_Y", "Q_Z")
REQUIRED = (*POSE_COLUMNS, "ImageFile")
HEADER = ("VehicleName", *REQUIRED)
CAR_COLUMNS = ("Throttle", "Steering", "Brake", "Gear", "Handbrake", "RPM", "Speed")  # between pose and ImageFile
SCENE = 0  # AirSim's image type of the picture itself
MS_PER_S = 1000.0
AIRSIM_FOV_DEG = 90.0  # AirSim's default
_IMAGE_NAME = re.compile(r"(?P<camera>img_.*)_(?P<type>\d+)_(?P<ns>\d+)\.(?P<suffix>\w+)")


class AirSimRecording(Recording):
    """A recording folder. `load` changes no state, so threads and processes may share it.

    Raises:
        RecordingError: airsim_rec.txt is missing, empty, or lacks a column.
    """

    def __init__(self, folder: Path, options: ReadOptions, fallback: MountedCamera | None = None) -> None:
        self.folder = folder
        self.name = str(folder)
        self._scene = read_scene(folder / SCENE_FILE) if is_there(folder / SCENE_FILE) else SceneFile()
        self._options = options
        self._known = options.camera or self._scene.camera or fallback
        rows, notes = read_rows(folder / RECORD_FILE)
        vehicles = rows.texts("VehicleName")
        vehicle = next(vehicles)
        self._rows = rows.take(np.array([True, *(name == vehicle for name in vehicles)]))
        if len(self._rows) < len(rows):
            notes.append(f"{len(rows) - len(self._rows)} rows of vehicles other than {vehicle!r} are left out")
        self.notes = (*notes, self._note_camera())

    def _note_camera(self) -> str:
        """Which camera it takes; a RecordingError for one that contradicts the stated field of view."""
        fov_deg = self._options.fov_deg
        if self._known is None:
            origin = "AirSim's default, without --fov-deg" if fov_deg is None else STATED
            return f"{self.name}: camera {origin}: {fov_deg or AIRSIM_FOV_DEG:g} degrees across"
        given = self._options.camera is not None
        origin = OF_OPTION if given else f"of {CAMERA_FILE if self._scene.camera is None else SCENE_FILE}"
        return note_camera(self.name, self._known.camera, origin, fov_deg)

    def __len__(self) -> int:
        return len(self._rows)

    def times(self) -> NDArray[np.float64]:
        return self._rows.numbers(["TimeStamp"])[:, 0] / MS_PER_S

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        line, cells = self._rows[index]
        place = f"{RECORD_FILE} line {line}"
        try:
            name, depth_name, depth_type = choose_images(list_row_images(cells))
        except ValueError as error:
            raise FrameError(place, str(error)) from None
        try:
            return self._frame(cells, name, depth_name, depth_type)
        except ValueError as error:
            raise FrameError(name, f"{error} ({place})") from None

    def _frame(self, cells: Cells, name: str, depth_name: str | None, depth_type: int) -> Frame:
        time_ms, *numbers = read_numbers(cells, POSE_COLUMNS)
        time_s, world_from_body = check_number(time_ms, POSE_COLUMNS[0]) / MS_PER_S, pose(numbers[:3], numbers[3:])
        images, options, entry = self.folder / IMAGE_FOLDER, self._options, self._entry(name)
        image = read_image(images / name)
        mounted = self._camera(entry, image.shape[:2])
        heights = [check_number(entry[name], name) if name in entry else None for name in HEIGHTS]
        mounted = mounted.at(*heights).at(options.deck_z_m, options.sea_z_m)  # the caller's go before the files'
        depth = None
        if depth_name is not None:
            depth_file = images / depth_name
            depth = read_depth(depth_file, depth_name, mounted.camera, depth_type, options.pfm_rows, options.far_m)
        truth = None
        if "truth" in entry:
            clear = get_clear_image(entry["truth"])
            truth = truth_from_mapping(entry["truth"], None if clear is None else self._read_clear(clear))
        time_s = check_number(entry.get("time_s", time_s), "time_s")
        return mounted.frame(name, time_s, image, depth_m=depth, world_from_body=world_from_body, truth=truth)

    def _read_clear(self, name: str) -> NDArray[np.uint8]:
        try:
            return read_image(self.folder / name)
        except ValueError as error:
            raise ValueError(f"its clear picture {name}: {error}") from None

    def _entry(self, name: str) -> dict[str, Any]:
        if self._scene.frames is None:
            return {}
        entry = self._scene.frames.get(name)
        if not isinstance(entry, dict):
            raise ValueError("scene.json has no entry for it; was the recording interrupted? Write it to its end")
        return entry

    def _camera(self, entry: dict[str, Any], shape: tuple[int, ...]) -> MountedCamera:
        if self._options.camera is not None:
            return self._options.camera
        if "camera" in entry:
            return camera_from_mapping(entry["camera"], "scene.json: camera")
        fov_deg = AIRSIM_FOV_DEG if self._options.fov_deg is None else self._options.fov_deg
        return self._known or make_pinhole(shape[1], shape[0], fov_deg)


def read_rows(path: Path) -> tuple[TextTable, list[str]]:
    """Rows of airsim_rec.txt, by header, and notes about odd columns; errors as `read_table`."""
    return read_table(path, "\t", REQUIRED, ("VehicleName", *CAR_COLUMNS))


def list_row_images(cells: Cells) -> tuple[str, ...]:
    """Names of the images of a row."""
    return tuple(name for name in cells.get("ImageFile", "").split(";") if name)


def choose_images(names: tuple[str, ...]) -> tuple[str, str | None, int]:
    """The first camera's Scene image, and its depth file and depth type when there is one.

    Planar depth is preferred to perspective depth. Other image types are left alone. A ValueError without a Scene
    image, for depth that is no PFM, and for a name that leaves the folder.
    """
    parsed = [(name, match) for name in names if (match := _IMAGE_NAME.fullmatch(name)) and is_inside(name)]
    scenes = [(name, match) for name, match in parsed if int(match["type"]) == SCENE]
    if not scenes:
        found = "; ".join(names) or "nothing"
        raise ValueError(f"no Scene image (img_<vehicle>_<camera>_0_<ns>.png or .ppm) in ImageFile, got {found}")
    scene_name, scene = scenes[0]
    for wanted in (DEPTH_PLANAR, DEPTH_PERSPECTIVE):
        for name, match in parsed:
            if int(match["type"]) != wanted or match["camera"] != scene["camera"]:
                continue
            if match["suffix"].lower() != "pfm":
                raise ValueError(
                    f"depth {name} is no float PFM file, its grey levels are no metres: record it with PixelsAsFloat "
                    f"true, or take its name out of ImageFile"
                )
            return scene_name, name, wanted
    return scene_name, None, DEPTH_PLANAR
