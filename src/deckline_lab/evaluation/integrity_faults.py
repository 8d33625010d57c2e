"""Faults put on purpose into a flight's frames and detections, to see whether they are noticed."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from deckline.truth import true_segments
from deckline.types import SIDES, Frame, LinePoints, Segment
from deckline_lab.evaluation.approaches import Sighting

BORESIGHT_RAD = float(np.deg2rad(1.0))
DEPTH_BIAS = 0.03
DELAY_S = 0.2
FOUL_M = (3.0, 6.0)  # beside an edge line, outwards; the simulator's named ships have 4
CATAPULT_M = (3.0, 12.0)  # beside an edge line where the runway begins, outwards
CATAPULT_RAD = (float(np.deg2rad(2.0)), float(np.deg2rad(9.0)))  # to the edge line, either way
DECK_M = (1.0, 3.0)  # of a wrong deck height, up or down
MOST_POSES = 1000  # kept for a late pose: 0.2 s at 5 kHz


Step = Callable[[Sighting, bool], Sighting]  # a sighting, and whether the fault is there by now


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong."""

    name: str
    sudden: bool  # it comes in flight; otherwise it is there from the first frame
    begin: Callable[[np.random.Generator], Step]  # draws how bad it is; the step gets sightings in order of time

    def is_active(self, frame: Frame, onset_s: float) -> bool:
        """Whether it has begun."""
        return not self.sudden or frame.time_s >= onset_s


def inject(
    sightings: Iterable[Sighting], fault: Fault | None, onset_s: float, rng: np.random.Generator
) -> Iterator[Sighting]:
    """The sightings, in order of time, with a fault; a sudden one comes at `onset_s`."""
    if fault is None:
        yield from sightings
        return
    step = fault.begin(rng)
    for sighting in sightings:
        yield step(sighting, fault.is_active(sighting.frame, onset_s))


def _change_frame(change: Callable[[Frame], dict[str, Any]]) -> Step:
    def step(sighting: Sighting, active: bool) -> Sighting:
        return sighting._replace(frame=replace(sighting.frame, **change(sighting.frame))) if active else sighting

    return step


def _change_detection(change: Callable[[Sighting], dict[str, LinePoints]]) -> Step:
    def step(sighting: Sighting, active: bool) -> Sighting:
        if not active:
            return sighting
        lines: dict[str, Any] = change(sighting)
        return sighting._replace(detection=replace(sighting.detection, **lines))

    return step


def _swap_lines(rng: np.random.Generator) -> Step:
    return _change_detection(lambda sighting: {"left": sighting.detection.right, "right": sighting.detection.left})


def _foul_line(rng: np.random.Generator) -> Step:
    return _detect_other_line(SIDES[rng.integers(2)], float(rng.uniform(*FOUL_M)), 0.0)


def _catapult_track(rng: np.random.Generator) -> Step:
    turn = float(rng.uniform(*CATAPULT_RAD)) * float(rng.choice([-1.0, 1.0]))
    return _detect_other_line(SIDES[rng.integers(2)], float(rng.uniform(*CATAPULT_M)), turn)


def _detect_other_line(side: str, outwards_m: float, turn_rad: float) -> Step:
    """One edge's points lie on another line of the deck, with the noise they had."""

    def change(sighting: Sighting) -> dict[str, LinePoints]:
        frame, points = sighting.frame, getattr(sighting.detection, side)
        true = true_segments(frame.truth).get(side)
        if true is None or not len(points):
            return {}
        other = offset_line(true, -outwards_m if side == "left" else outwards_m, turn_rad)
        return {side: move_points(points, true, other, frame)}

    return _change_detection(change)


def offset_line(line: Segment, right_m: float, turn_rad: float) -> Segment:
    """A line in the same plane, its ramp end so far to the right and turned about that end (+: to the right)."""
    along, right = line.p1_m - line.p0_m, to_right(line)
    start = line.p0_m + right_m * right
    return Segment(start, start + np.cos(turn_rad) * along + np.sin(turn_rad) * np.linalg.norm(along[:2]) * right)


def to_right(line: Segment) -> NDArray[np.float64]:
    """Unit vector (3,), level, to the right of a line."""
    along = line.p1_m - line.p0_m
    return np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])


def move_points(points: LinePoints, line: Segment, other: Segment, frame: Frame) -> LinePoints:
    """Points of one true line as they would lie on another, in the same rows; those outside the image are gone."""
    v = points.points_px[:, 1]
    u = points.points_px[:, 0] + u_at(other, v, frame) - u_at(line, v, frame)
    keep = np.isfinite(u) & (u >= 0) & (u <= frame.camera.width - 1)
    moved = np.column_stack([u, v])[keep]
    return LinePoints(moved, points.confidence[keep], points.sigma_px[keep])


def u_at(line: Segment, v_px: np.ndarray, frame: Frame) -> np.ndarray:
    """Where a line, continued both ways, crosses image rows (N,); NaN for rows that it does not cross ahead.

    Raises:
        ValueError: a frame without a pose, or with a distorted image, in which a straight line is none.
    """
    pose = frame.true_world_from_camera
    if pose is None:
        raise ValueError(f"{frame.file}: no pose, so nobody knows where a line is in the image")
    camera = frame.camera
    if camera.has_distortion:
        raise ValueError(f"{frame.file}: lines are moved in pinhole images only, got a camera with distortion")
    start, along = pose.inv().apply(line.p0_m), pose.rotation.inv().apply(line.p1_m - line.p0_m)
    slope = (np.asarray(v_px) - camera.cy) / camera.fy
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (slope * start[2] - start[1]) / (along[1] - slope * along[2])
        x, z = start[0] + steps * along[0], start[2] + steps * along[2]
        return np.asarray(np.where(z > 0, camera.cx + camera.fx * x / z, np.nan))


def _turn_camera(rng: np.random.Generator) -> Step:
    axis = rng.normal(size=3)
    turn = RigidTransform.from_rotation(Rotation.from_rotvec(BORESIGHT_RAD * axis / np.linalg.norm(axis)))
    return _change_frame(lambda frame: {"body_from_camera": frame.body_from_camera * turn})


def _scale_depth(rng: np.random.Generator) -> Step:
    scale = np.float32(1.0 + DEPTH_BIAS * rng.choice([-1.0, 1.0]))
    return _change_frame(lambda frame: {} if frame.depth_m is None else {"depth_m": frame.depth_m * scale})


def _freeze_camera(rng: np.random.Generator) -> Step:
    last: list[Sighting] = []

    def step(sighting: Sighting, active: bool) -> Sighting:
        if not active or not last:
            last[:] = [sighting]
            return sighting
        return Sighting(replace(sighting.frame, image_rgb=last[0].frame.image_rgb), last[0].detection)

    return step


def _delay_pose(rng: np.random.Generator) -> Step:
    known: deque[tuple[float, RigidTransform]] = deque(maxlen=MOST_POSES)

    def step(sighting: Sighting, active: bool) -> Sighting:
        frame = sighting.frame
        if frame.world_from_body is None:
            return sighting
        known.append((frame.time_s, frame.world_from_body))
        if not active:
            return sighting
        late = pose_at(list(known), frame.time_s - DELAY_S)
        truth = frame.truth and replace(frame.truth, world_from_body=frame.true_world_from_body)
        return sighting._replace(frame=replace(frame, world_from_body=late, truth=truth))

    return step


def pose_at(known: list[tuple[float, RigidTransform]], time_s: float) -> RigidTransform:
    """A pose between those known, in order of time: straight in position, the shortest way in attitude.

    Before the first and after the last one it is theirs.
    """
    times = np.array([time for time, _ in known])
    after = int(np.searchsorted(times, time_s))
    if after == 0 or after == len(known):
        return known[min(after, len(known) - 1)][1]
    (t0, before), (t1, behind) = known[after - 1], known[after]
    share = (time_s - t0) / (t1 - t0)
    turn = Slerp([0.0, 1.0], Rotation.concatenate([before.rotation, behind.rotation]))(share)
    return RigidTransform.from_components((1 - share) * before.translation + share * behind.translation, turn)


def _shift_deck(rng: np.random.Generator) -> Step:
    error_m = float(rng.uniform(*DECK_M)) * float(rng.choice([-1.0, 1.0]))
    return _change_frame(lambda frame: {} if frame.deck_z_m is None else {"deck_z_m": frame.deck_z_m + error_m})


def _shift_deck_once(rng: np.random.Generator) -> Step:
    shift = _shift_deck(rng)
    done = False

    def step(sighting: Sighting, active: bool) -> Sighting:
        nonlocal done
        now, done = active and not done, done or active
        return shift(sighting, now)

    return step


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("swapped lines", True, _swap_lines),
        Fault("foul line", True, _foul_line),
        Fault("catapult track", True, _catapult_track),
        Fault("boresight 1 deg", False, _turn_camera),
        Fault("depth bias 3 %", False, _scale_depth),
        Fault("frozen camera", True, _freeze_camera),
        Fault("pose late by 0.2 s", True, _delay_pose),
        Fault("deck height once", True, _shift_deck_once),
        Fault("deck height", False, _shift_deck),
    )
}
