"""Recordings in AirSim's layout: airsim_rec.txt, images/, and our optional scene.json.

airsim_rec.txt is tab-separated and read by its header: time in milliseconds, position in metres (North-East-Down),
quaternion w, x, y, z. The pose is the vehicle's (world_from_body), not the camera's. ImageFile joins with `;` the names
img_<vehicle>_<camera>_<type>_<ns>.<ext> of images/, of one or more cameras and types.
Source: SPEC section 5.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deckline.geometry import Camera, camera_mount, pose
from deckline.recording.camera_file import MountedCamera, camera_from_mapping
from deckline.recording.depth import DEPTH_PERSPECTIVE, DEPTH_PLANAR, along_axis, check_depth_size, check_size
from deckline.recording.images import read_depth_pfm, read_image
from deckline.recording.netpbm import FAR_DEPTH_M, PfmRows
from deckline.recording.scene import Scene, clear_image_path, truth_from_mapping
from deckline.recording.source import FrameError, RecordingError, Source, check_index, is_inside, number, read_text
from deckline.types import Frame, Truth

RECORD_FILE = "airsim_rec.txt"
IMAGE_FOLDER = "images"
REQUIRED = ("TimeStamp", "POS_X", "POS_Y", "POS_Z", "Q_W", "Q_X", "Q_Y", "Q_Z", "ImageFile")
HEADER = ("VehicleName", *REQUIRED)
CAR_COLUMNS = ("Throttle", "Steering", "Brake", "Gear", "Handbrake", "RPM", "Speed")  # between pose and ImageFile
SCENE = 0  # AirSim's image type of the picture itself
_IMAGE_NAME = re.compile(r"(?P<camera>img_.*)_(?P<type>\d+)_(?P<ns>\d+)\.(?P<suffix>\w+)")


@dataclass(frozen=True)
class Row:
    """One line of airsim_rec.txt."""

    line: int  # counted from 1
    vehicle: str
    numbers: tuple[str, ...]  # TimeStamp, position, quaternion, as written
    images: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class AirSimOptions:
    """How to read what a recording does not say itself."""

    fov_deg: float = 90.0  # horizontal, of a recording without camera; 90 is AirSim's default
    camera: MountedCamera | None = None  # given by the user: goes before scene.json's
    fallback_camera: MountedCamera | None = None  # camera.toml in the folder: used when scene.json has none
    deck_z_m: float | None = None  # world z of the deck plane; None: as the recording says
    pfm_rows: PfmRows = "top-to-bottom"  # AirSim's order
    far_m: float = FAR_DEPTH_M  # stored depths from here on mean "nothing seen"
    sea_z_m: float | None = None  # world z of the water; None: as the recording says


class AirSimRecording(Source):
    """A recording folder. `load` keeps no state, so threads and processes may share it.

    Raises:
        RecordingError: airsim_rec.txt is missing, empty, or lacks a column.
    """

    def __init__(self, folder: Path, scene: Scene | None, options: AirSimOptions) -> None:
        self.folder = folder
        self.name = str(folder)
        self._scene = scene
        self._options = options
        rows, notes = read_rows(folder / RECORD_FILE)
        vehicle = rows[0].vehicle
        self._rows = [row for row in rows if row.vehicle == vehicle]
        if len(self._rows) < len(rows):
            notes.append(f"{len(rows) - len(self._rows)} rows of vehicles other than {vehicle!r} are left out")
        self.notes = tuple(notes)

    def __len__(self) -> int:
        return len(self._rows)

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        row = self._rows[index]
        place = f"{RECORD_FILE} line {row.line}"
        try:
            name, depth_name, depth_type = choose_images(row.images)
        except ValueError as error:
            raise FrameError(place, str(error)) from None
        try:
            return self._frame(row, name, depth_name, depth_type)
        except ValueError as error:
            raise FrameError(name, f"{error} ({place})") from None

    def _frame(self, row: Row, name: str, depth_name: str | None, depth_type: int) -> Frame:
        time_s, world_from_body = parse_pose(row.numbers)
        entry = self._entry(name)
        image = read_image(self.folder / IMAGE_FOLDER / name)
        mounted = self._camera(entry, image.shape[:2])
        check_size(mounted.camera, image.shape[:2])
        depth = None
        if depth_name is not None:
            stored = read_depth_pfm(self.folder / IMAGE_FOLDER / depth_name, self._options.pfm_rows)
            check_depth_size(stored.shape, mounted.camera, depth_name)
            depth = along_axis(stored, mounted.camera, depth_type, self._options.far_m)
        return Frame(
            file=name,
            time_s=number(entry.get("time_s", time_s), "time_s"),
            image_rgb=image,
            camera=mounted.camera,
            body_from_camera=mounted.body_from_camera,
            depth_m=depth,
            world_from_body=world_from_body,
            deck_z_m=self._height("deck_z_m", entry, mounted),
            sea_z_m=self._height("sea_z_m", entry, mounted),
            truth=self._truth(entry),
        )

    def _entry(self, name: str) -> dict[str, Any]:
        """What scene.json says of this image."""
        if self._scene is None or self._scene.frames is None:
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
        if self._scene is not None and self._scene.camera is not None:
            return self._scene.camera
        if self._options.fallback_camera is not None:
            return self._options.fallback_camera
        return MountedCamera(Camera.from_fov(shape[1], shape[0], math.radians(self._options.fov_deg)), camera_mount())

    def _height(self, name: str, entry: dict[str, Any], mounted: MountedCamera) -> float | None:
        """World z of deck or sea: the caller's, else scene.json's, else the camera file's."""
        given: float | None = getattr(self._options, name)
        if given is not None:
            return given
        value = entry.get(name, getattr(mounted, name))
        return None if value is None else number(value, name)

    def _truth(self, entry: dict[str, Any]) -> Truth | None:
        if "truth" not in entry:
            return None
        name = clear_image_path(entry["truth"])
        return truth_from_mapping(entry["truth"], None if name is None else read_image(self.folder / name))


def read_rows(path: Path) -> tuple[list[Row], list[str]]:
    """Rows of airsim_rec.txt, by header, and notes about odd columns.

    Raises:
        RecordingError: missing or empty file, a missing or repeated column, no rows.
    """
    lines = read_text(path).splitlines()
    if not any(line.strip() for line in lines):
        raise RecordingError(f"{path}: the file is empty; was anything recorded?")
    header = [column.strip() for column in lines[0].split("\t")]
    while header and not header[-1]:
        header.pop()
    missing = [column for column in REQUIRED if column not in header]
    if missing:
        raise RecordingError(
            f"{path} line 1: column {', '.join(missing)} missing; expected tab-separated {' '.join(HEADER)}"
        )
    repeated = sorted({column for column in header if header.count(column) > 1})
    if repeated:
        raise RecordingError(f"{path} line 1: column {', '.join(repeated)} stands there more than once")
    unknown = [column for column in header if column not in (*HEADER, *CAR_COLUMNS)]
    notes = [f"{path} line 1: unknown column {', '.join(unknown)} ignored"] if unknown else []
    rows = [_row(number, line, header) for number, line in enumerate(lines[1:], 2) if line.strip()]
    if not rows:
        raise RecordingError(f"{path}: zero frames: there is a header but no row below it")
    return rows, notes


def _row(line_number: int, line: str, header: list[str]) -> Row:
    cells = [cell.strip() for cell in line.split("\t")]
    named = dict(zip(header, cells, strict=False))
    images = tuple(name for name in named.get("ImageFile", "").split(";") if name)
    numbers = tuple(named.get(column, "") for column in REQUIRED[:-1])
    return Row(line_number, named.get("VehicleName", ""), numbers, images)


def parse_pose(numbers: tuple[str, ...]) -> tuple[float, Any]:
    """(TimeStamp in ms, x, y, z, w, x, y, z) as text -> time in s and world_from_body.

    Raises:
        ValueError: a cell that is no number, a NaN, or a quaternion of zero length.
    """
    values = []
    for column, text in zip(REQUIRED, numbers, strict=False):
        try:
            values.append(float(text))
        except ValueError:
            raise ValueError(f"column {column} is no number: {text!r}") from None
    return number(values[0], "TimeStamp") / 1000.0, pose(values[1:4], values[4:8])


def choose_images(names: tuple[str, ...]) -> tuple[str, str | None, int]:
    """The first camera's Scene image, and its depth file and depth type when there is one.

    Planar depth is preferred to perspective depth. Other image types are left alone.

    Raises:
        ValueError: no Scene image, depth that is no PFM, or a name that leaves the folder.
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
