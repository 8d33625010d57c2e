"""Poses in tables: which columns hold them, poses.csv that names its images, and times.csv.

poses.csv has a header; its columns are in any order. time_s: the poses' clock. x_m, y_m, z_m: position in a world that
is North-East-Down or any right-handed forward-right-down frame; or lat_deg, lon_deg, alt_m (lat, lon, alt; latitude,
longitude, altitude): degrees, and metres up. qw, qx, qy, qz: world_from_body as a quaternion; or roll_deg, pitch_deg,
yaw_deg (or roll_rad, pitch_rad, yaw_rad): yaw about down, then pitch (nose up is positive), then roll (right wing down
is positive), from North-East-Down to the body's forward-right-down. Without any position the table gives roll and pitch
alone, for a pose that the picture gives. With a column `file` in a folder of images a row
belongs to the image of this name, and its pose may be empty; otherwise rows go by time (`pose_track`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import pose
from deckline.recording.geodesy import ned_from_geodetic
from deckline.recording.source import check_number
from deckline.recording.text_table import Cells, TextTable, parse_number, read_table
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.recording.pose_track import PoseTrack

Array = NDArray[np.float64]
POSES_FILE = "poses.csv"
TIMES_FILE = "times.csv"  # file, time_s: when each image of a folder was taken
POSITION, GEODETIC = ("x_m", "y_m", "z_m"), ("lat_deg", "lon_deg", "alt_m")
QUATERNION = ("qw", "qx", "qy", "qz")
ANGLES_DEG, ANGLES_RAD = ("roll_deg", "pitch_deg", "yaw_deg"), ("roll_rad", "pitch_rad", "yaw_rad")
NUMBERS = ("time_s", *POSITION, *QUATERNION)
COLUMNS = ("file", *NUMBERS)
CHOICES = "; lat,lon,alt may replace x_m,y_m,z_m, and roll_deg,pitch_deg,yaw_deg or roll_rad,pitch_rad,yaw_rad qw to qz"


@dataclass(frozen=True)
class PoseColumns:
    """The columns of a table that hold poses."""

    position: tuple[str, ...]
    """POSITION or GEODETIC; empty: attitudes alone."""
    attitude: tuple[str, ...]
    """QUATERNION, ANGLES_DEG or ANGLES_RAD."""

    @property
    def names(self) -> tuple[str, ...]:
        """Time, position, attitude."""
        return ("time_s", *self.position, *self.attitude)

    @property
    def is_geodetic(self) -> bool:
        """Whether positions are latitude, longitude and altitude."""
        return self.position == GEODETIC

    def quaternions(self, attitudes: Array) -> Array:
        """Attitudes (N, 3 or 4) as the columns hold them -> quaternions (N, 4), scalar first; NaN where one is."""
        if self.attitude == QUATERNION:
            return attitudes
        return quaternions_from_angles(np.deg2rad(attitudes) if self.attitude == ANGLES_DEG else attitudes)


def choose_columns(table: TextTable, *others: str) -> tuple[PoseColumns, list[str]]:
    """The pose columns of a table, and notes on those that are ignored; errors as `TextTable.require`.

    Args:
        others: further columns that must be there.
    """
    header = set(table.header)
    position: tuple[str, ...] = GEODETIC if header.issuperset(GEODETIC) else POSITION
    attitude = next((names for names in (ANGLES_DEG, ANGLES_RAD) if header.issuperset(names)), QUATERNION)
    if not header & {*GEODETIC, *POSITION} and (attitude != QUATERNION or header.issuperset(QUATERNION)):
        position = ()
    columns = PoseColumns(position, QUATERNION if header.issuperset(QUATERNION) else attitude)
    return columns, table.require((*others, *columns.names), ("file",), CHOICES)


def quaternions_from_angles(angles_rad: Array) -> Array:
    """Roll, pitch, yaw (N, 3), rad, as `geometry.attitude` -> quaternions (N, 4), scalar first; NaN where one is."""
    quaternions = np.full((len(angles_rad), 4), np.nan)
    known = np.isfinite(angles_rad).all(axis=1)
    if known.any():
        quaternions[known] = Rotation.from_euler("ZYX", angles_rad[known, ::-1]).as_quat(scalar_first=True)
    return quaternions


@dataclass(frozen=True, eq=False)
class Poses:
    """poses.csv whose rows name images. The numbers of a row are checked when it is asked for."""

    table: TextTable
    """Rows of the file."""
    columns: PoseColumns
    """Which of its columns hold poses."""
    rows: Mapping[str, int]
    """Row of the table by the image's name."""
    origin: tuple[float, float, float] | None
    """Latitude, longitude, degrees, and altitude, m, of the world's origin; None: positions are metres."""
    notes: tuple[str, ...] = ()
    """What is odd about the file, one line each."""

    def at(self, file: str) -> tuple[float, RigidTransform | None]:
        """Time in s and world_from_body of an image, None where its row gives a time only.

        Raises:
            ValueError: there is no row for it, or one that is no pose.
        """
        if file not in self.rows:
            raise ValueError(f"{self.table.path} has no row for it; add one, or take the image away")
        line, cells = self.table[self.rows[file]]
        try:
            if not any(cells.get(name) for name in self.columns.names[1:]):
                return check_number(parse_number(cells.get("time_s", "")), "time_s"), None
            return self._read(cells)
        except ValueError as error:
            raise ValueError(f"{self.table.path} line {line}: {error}") from None

    @property
    def has_positions(self) -> bool:
        """Whether its poses are more than attitudes."""
        return bool(self.columns.position)

    def times(self, files: Sequence[str]) -> Array:
        """Times of images (N,), s; NaN without one."""
        times = self.table.numbers(["time_s"])[:, 0]
        return np.array([times[self.rows[file]] if file in self.rows else np.nan for file in files])

    def _read(self, cells: Cells) -> tuple[float, RigidTransform]:
        time_s, *values = read_numbers(cells, self.columns.names)
        size = len(self.columns.position)
        place, attitude = values[:size] or [0.0, 0.0, 0.0], values[size:]
        if self.columns.attitude != QUATERNION:
            attitude = [check_number(angle, name) for angle, name in zip(attitude, self.columns.attitude, strict=True)]
        placed = pose(place, self.columns.quaternions(np.array([attitude]))[0])
        if self.origin is not None:
            positions, rotations = ned_from_geodetic(placed.translation[None], placed.rotation, self.origin)
            placed = RigidTransform.from_components(positions[0], rotations[0])
        return check_number(time_s, "time_s"), placed


def read_poses(table: TextTable, origin: tuple[float, float, float] | None) -> Poses:
    """The poses of a poses.csv whose rows name images.

    Args:
        origin: of the world, where positions are latitude, longitude and altitude; None: the first of them.

    Raises:
        RecordingError: a missing column, or one image in two rows.
    """
    columns, notes = choose_columns(table, "file")
    if columns.is_geodetic and origin is None:
        places = table.numbers(GEODETIC)
        known = places[np.isfinite(places).all(axis=1)]
        if len(known):
            origin = (float(known[0, 0]), float(known[0, 1]), float(known[0, 2]))
            notes.append(note_origin(str(table.path), origin))
    return Poses(table, columns, table.index_files(), origin if columns.is_geodetic else None, tuple(notes))


def drop_unknown_place(frame: Frame, poses: "Poses | PoseTrack | None") -> Frame:
    """The frame, its pose an attitude without a place where its poses have no positions."""
    if poses is None or poses.has_positions:
        return frame
    pose = frame.world_from_body
    return replace(frame, world_from_body=None, level_from_body=None if pose is None else pose.rotation)


def note_origin(name: str, origin: Sequence[float]) -> str:
    """The note on an origin, latitude, longitude, degrees, and altitude, m, that nobody stated."""
    stated = "{:.7f} {:.7f} {:.2f}".format(*origin)
    return f"{name}: the world's origin is the first position; to state it: --origin {stated}"


def read_image_times(path: Path) -> dict[str, float]:
    """Time in s of each image of times.csv; NaN for what is no number. Errors as `read_table`."""
    table, _ = read_table(path, ",", ("file", "time_s"))
    times = table.numbers(["time_s"])[:, 0].tolist()
    return {file: times[row] for file, row in table.index_files().items()}


def read_numbers(cells: Cells, columns: Sequence[str]) -> list[float]:
    """Numbers of cells; a ValueError that names the column and the text of one that is none."""
    values = []
    for column in columns:
        text = cells.get(column, "")
        try:
            values.append(float(text))
        except ValueError:
            raise ValueError(f"column {column} is no number: {text!r}") from None
    return values
