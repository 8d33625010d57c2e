"""Poses by time: a track of the aircraft's body that pictures of another clock and rate are placed on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from deckline.config import Navigation
from deckline.geometry import FARTHEST_M, QUATERNION_TOLERANCE
from deckline.recording.geodesy import ned_from_geodetic
from deckline.recording.poses import choose_columns, note_origin
from deckline.recording.source import RecordingError
from deckline.recording.text_table import TextTable

Array = NDArray[np.float64]
MOST_DIGITS = 16  # of a frame's number
ROUNDING_S = 1e-3  # of presentation times, which many containers store in milliseconds


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """world_from_body over time, interpolated between poses and never beyond the first and the last."""

    name: str  # of the file
    times_s: Array  # (N,) ascending, the poses' clock
    positions_m: Array  # (N, 3) world
    rotations: Rotation  # (N) world_from_body
    max_gap_s: float  # between two poses, beyond which pictures in between have none
    offset_s: float  # the poses' clock minus the pictures' clock
    notes: tuple[str, ...] = ()
    has_positions: bool = True  # else its poses are attitudes alone

    def at(self, time_s: float) -> RigidTransform | None:
        """The pose at a time of the pictures' clock: linear in position, the shortest rotation in attitude.

        None before the first pose, after the last, and in a gap longer than `max_gap_s`.
        Source: Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985 (slerp).
        """
        (known,), (first,), (share,) = self._bracket([time_s])
        if not known:
            return None
        pair = slice(first, first + 2)
        rotation = Slerp([0.0, 1.0], self.rotations[pair])(share)
        return RigidTransform.from_components([1 - share, share] @ self.positions_m[pair], rotation)

    def covers(self, times_s: ArrayLike) -> NDArray[np.bool_]:
        """Whether there is a pose at times (T,) of the pictures' clock."""
        return self._bracket(times_s)[0]

    def sample(self, times_s: Array) -> tuple[Array, Rotation]:
        """Positions (T, 3) and attitudes (T) at times (T,) of the poses' clock; beyond the ends the first and last."""
        times = np.clip(times_s, self.times_s[0], self.times_s[-1])
        positions = [np.interp(times, self.times_s, column) for column in self.positions_m.T]
        return np.column_stack(positions), Slerp(self.times_s, self.rotations)(times)

    def notes_on(self, times_s: Array) -> tuple[str, ...]:
        """Notes on the poses and on the pictures, at these times of their clock, that have none.

        Raises:
            RecordingError: no picture has a pose.
        """
        times_s = times_s[np.isfinite(times_s)]
        without = int((~self.covers(times_s)).sum())
        if len(times_s) and without == len(times_s):
            raise RecordingError(
                f"{self.name}: no pose belongs to a picture: poses are from {self.times_s[0]:.3f} to "
                f"{self.times_s[-1]:.3f} s, pictures from {times_s.min() + self.offset_s:.3f} to "
                f"{times_s.max() + self.offset_s:.3f} s on that clock, gaps up to {self.max_gap_s:g} s count; "
                f"state --pose-offset-s or a larger --max-pose-gap-s"
            )
        note = (
            f"{self.name}: {without} of {len(times_s)} pictures have no pose: before the first pose, after the last, "
            f"or in a gap longer than {self.max_gap_s:g} s"
        )
        return (*self.notes, note) if without else self.notes

    def _bracket(self, times_s: ArrayLike) -> tuple[NDArray[np.bool_], NDArray[np.intp], Array]:
        """Of times (T,): whether there is a pose, the pose before (T,), and the share of the way to the next (T,)."""
        times = np.asarray(times_s, dtype=np.float64) + self.offset_s
        before = np.clip(np.searchsorted(self.times_s, times, side="right") - 1, 0, len(self.times_s) - 2)
        since, gap = times - self.times_s[before], self.times_s[before + 1] - self.times_s[before]
        between = (since >= 0) & (since <= gap) & (gap <= self.max_gap_s)
        nearest = np.minimum(np.abs(since), np.abs(since - gap))
        return between | (nearest <= ROUNDING_S), before, np.clip(since / gap, 0.0, 1.0)


def make_track(
    name: str,
    times_s: ArrayLike,
    positions_m: ArrayLike,
    quaternions_wxyz: ArrayLike,
    navigation: Navigation,
    notes: Sequence[str] = (),
) -> PoseTrack:
    """A track of poses as a file holds them; what is no pose, or not later than those before it, is left out and noted.

    Args:
        times_s: (N,) the poses' clock.
        positions_m: (N, 3) world.
        quaternions_wxyz: (N, 4) world_from_body.

    Raises:
        RecordingError: fewer than two poses, or a clock that jumps back by more than the longest gap.
    """
    times, positions, quaternions = (np.asarray(a, dtype=np.float64) for a in (times_s, positions_m, quaternions_wxyz))
    valid = np.isfinite(times) & (np.abs(positions) <= FARTHEST_M).all(axis=1)
    with np.errstate(over="ignore"):
        valid &= np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) <= QUATERNION_TOLERANCE
    notes = [
        *notes,
        *_note_left_out(name, ~valid, "have a number that is not finite or too far, or a quaternion not of length 1"),
    ]
    times, positions, quaternions = times[valid], positions[valid], quaternions[valid]
    latest = np.maximum.accumulate(times)
    late = np.concatenate([[False], times[1:] <= latest[:-1]]) if len(times) else valid[:0]
    if len(times) and (back := int(np.argmax(latest - times))) and latest[back] - times[back] > navigation.max_gap_s:
        raise RecordingError(
            f"{name}: the clock jumps back from {latest[back]:.3f} to {times[back]:.3f} s; sort the poses by time, "
            f"or cut the file where the clock began anew"
        )
    notes += _note_left_out(name, late, "are not later than those before them")
    if (~late).sum() < 2:
        raise RecordingError(f"{name}: {(~late).sum()} poses; at least 2 at different times are needed")
    rotations = Rotation.from_quat(quaternions[~late], scalar_first=True)
    offset_s = navigation.offset_s or 0.0
    return PoseTrack(name, times[~late], positions[~late], rotations, navigation.max_gap_s, offset_s, tuple(notes))


def read_csv_track(path: Path, navigation: Navigation, video_times_s: Array | None = None) -> PoseTrack:
    """A track from poses.csv, whose rows go by time_s; its columns are those of `recording.poses`.

    Args:
        navigation: offset and longest gap. Without an offset, and with a column `file` of a video's frame numbers, the
            first row has the time of its frame.
        video_times_s: (M,) presentation times of a video.

    Raises:
        RecordingError: a column is missing, `file` holds no frame numbers, or as `make_track`.
    """
    table = TextTable(path, ",")
    columns, notes = choose_columns(table)
    values = table.numbers(columns.names)
    times = values[:, 0]
    if video_times_s is not None and "file" in table.header:
        numbers = _frame_numbers(table)
        known = np.isfinite(times) & (numbers < len(video_times_s))
        ahead = times[known] - video_times_s[numbers[known]]
        if navigation.offset_s is None and len(ahead):
            navigation = replace(navigation, offset_s=float(ahead[0]))
        if len(ahead) and np.ptp(ahead) > np.median(np.diff(video_times_s, prepend=-1.0)) + ROUNDING_S:  # a frame
            notes.append(
                f"{path}: the video's frames and these rows drift apart by {np.ptp(ahead):.3f} s: time_s counts"
            )
    size = len(columns.position)
    quaternions, places = columns.quaternions(values[:, 1 + size :]), values[:, 1 : 1 + size]
    track = make_track(str(path), times, places if size else np.zeros((len(values), 3)), quaternions, navigation, notes)
    if not size:
        return replace(track, has_positions=False)
    return place_in_world(track, navigation.origin) if columns.is_geodetic else track


def join_tracks(attitudes: PoseTrack, positions: PoseTrack, geodetic: bool, navigation: Navigation) -> PoseTrack:
    """One track of the attitudes of one and the positions of another, at the times of both.

    Args:
        attitudes, positions: on one clock, each with its own offset 0.
        geodetic: positions are latitude, longitude, degrees, and altitude, m; the track is then as `place_in_world`
            makes it.
        navigation: the offset of their clock, and the world's origin.

    Raises:
        RecordingError: they share no time.
    """
    times = np.union1d(attitudes.times_s, positions.times_s)
    times = times[attitudes.covers(times) & positions.covers(times)]
    times = times[(times >= attitudes.times_s[0]) & (times <= attitudes.times_s[-1])]
    if len(times) < 2:
        raise RecordingError(f"{attitudes.name} and {positions.name} share no time")
    places_m = positions.positions_m
    if geodetic:
        places_m = np.column_stack([places_m[:, 0], np.unwrap(places_m[:, 1], period=360.0), places_m[:, 2]])
    places_m, rotations = replace(positions, positions_m=places_m).sample(times)[0], attitudes.sample(times)[1]
    if geodetic:
        places_m[:, 1] = (places_m[:, 1] + 180.0) % 360.0 - 180.0
    notes, offset_s = (*attitudes.notes, *positions.notes), navigation.offset_s or 0.0
    track = PoseTrack(positions.name, times, places_m, rotations, navigation.max_gap_s, offset_s, notes)
    return place_in_world(track, navigation.origin) if geodetic else track


def place_in_world(track: PoseTrack, origin: tuple[float, float, float] | None) -> PoseTrack:
    """A track of latitude, longitude, degrees, altitude, m, in the North-East-Down world of an origin (the same units).

    Attitudes are of the local axes at each position and are turned into those of the origin. Without an origin the
    first position is the origin, and a note states it.

    Raises:
        RecordingError: latitudes or longitudes out of range.
    """
    geodetic, notes = track.positions_m, track.notes
    if origin is None:
        origin = (float(geodetic[0, 0]), float(geodetic[0, 1]), float(geodetic[0, 2]))
        notes = (*notes, note_origin(track.name, origin))
    try:
        positions, rotations = ned_from_geodetic(geodetic, track.rotations, origin)
    except ValueError as error:
        raise RecordingError(f"{track.name}: {error}") from None
    return replace(track, positions_m=positions, rotations=rotations, notes=notes)


def _frame_numbers(table: TextTable) -> NDArray[np.int64]:
    """Numbers of a column `file`: bare, or as <video>#<number>."""
    numbers = np.empty(len(table), np.int64)
    for row, file in enumerate(table.texts("file")):
        digits = file.rpartition("#")[2].strip()
        if not (digits.isascii() and digits.isdigit() and len(digits) < MOST_DIGITS):
            raise RecordingError(
                f"{table.path} line {table[row][0]}: file must be the frame's number from 0, got {file!r}"
            )
        numbers[row] = int(digits)
    return numbers


def _note_left_out(name: str, rows: NDArray[np.bool_], why: str) -> list[str]:
    return [f"{name}: {rows.sum()} of {len(rows)} poses left out: they {why}"] if rows.any() else []
