"""Faults put on purpose into a flight's frames and detections, to see whether they are noticed."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from deckline.geometry import Camera
from deckline.types import SIDES, Detection, Frame, LinePoints, Segment

BORESIGHT_RAD = float(np.deg2rad(1.0))
DEPTH_BIAS = 0.03
DELAY_S = 0.2
FOUL_M = (3.0, 6.0)  # beside an edge line, outwards; the simulator's named ships have 4
CATAPULT_M = (3.0, 12.0)  # beside an edge line where the runway begins, outwards
CATAPULT_RAD = (float(np.deg2rad(2.0)), float(np.deg2rad(9.0)))  # to the edge line, either way
DECK_M = (1.0, 3.0)  # of a wrong deck height, up or down
MOST_POSES = 1000  # kept for a late pose: 0.2 s at 5 kHz


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame of a flight and what the detector saw in it."""

    frame: Frame
    detection: Detection


Step = Callable[[Shot, bool], Shot]  # a shot, and whether the fault is there by now


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong.

    Attributes:
        sudden: it comes in flight; otherwise it is there from the first frame.
        begin: draws how bad it is; the result is given every shot in order of time.
    """

    name: str
    sudden: bool
    begin: Callable[[np.random.Generator], Step]


def inject(shots: Iterable[Shot], fault: Fault | None, onset_s: float, rng: np.random.Generator) -> Iterator[Shot]:
    """The shots with a fault from a time on; unchanged without a fault.

    Args:
        shots: in order of time.
        onset_s: of a sudden fault; the others are there from the start.
    """
    step = None if fault is None else fault.begin(rng)
    for shot in shots:
        yield shot if step is None or fault is None else step(shot, not fault.sudden or shot.frame.time_s >= onset_s)


def _swapped(rng: np.random.Generator) -> Step:
    def step(shot: Shot, active: bool) -> Shot:
        seen = shot.detection
        return replace(shot, detection=replace(seen, left=seen.right, right=seen.left)) if active else shot

    return step


def _foul_line(rng: np.random.Generator) -> Step:
    return _other_line(SIDES[rng.integers(2)], float(rng.uniform(*FOUL_M)), 0.0)


def _catapult(rng: np.random.Generator) -> Step:
    turn = float(rng.uniform(*CATAPULT_RAD)) * float(rng.choice([-1.0, 1.0]))
    return _other_line(SIDES[rng.integers(2)], float(rng.uniform(*CATAPULT_M)), turn)


def _other_line(side: str, outwards_m: float, turn_rad: float) -> Step:
    """One edge's points lie on another line of the deck, with the noise they had."""

    def step(shot: Shot, active: bool) -> Shot:
        truth = shot.frame.truth
        points = getattr(shot.detection, side)
        if not active or truth is None or truth.left is None or truth.right is None or not len(points):
            return shot
        true = truth.left if side == "left" else truth.right
        other = beside(true, -outwards_m if side == "left" else outwards_m, turn_rad)
        moved = moved_points(points, true, other, shot.frame)
        seen = shot.detection
        seen = replace(seen, left=moved) if side == "left" else replace(seen, right=moved)
        return replace(shot, detection=seen)

    return step


def beside(line: Segment, right_m: float, turn_rad: float) -> Segment:
    """A line in the same plane, its ramp end so far to the right and turned about that end (+: to the right)."""
    along = line.p1_m - line.p0_m
    ahead = along / np.hypot(along[0], along[1])
    right = np.array([-ahead[1], ahead[0], 0.0])
    start = line.p0_m + right_m * right
    return Segment(start, start + np.cos(turn_rad) * along + np.sin(turn_rad) * np.linalg.norm(along[:2]) * right)


def moved_points(points: LinePoints, line: Segment, other: Segment, frame: Frame) -> LinePoints:
    """Points of one true line as they would lie on another, in the same rows; those outside the image are gone."""
    v = points.points_px[:, 1]
    u = points.points_px[:, 0] + u_at(other, v, frame) - u_at(line, v, frame)
    keep = np.isfinite(u) & (u >= 0) & (u <= frame.camera.width - 1)
    moved = np.column_stack([u, v])[keep]
    return LinePoints(moved, points.confidence[keep], points.sigma_px[keep])


def u_at(line: Segment, v_px: np.ndarray, frame: Frame) -> np.ndarray:
    """Where a line, continued both ways, crosses image rows (N,); NaN for rows that it does not cross ahead.

    Raises:
        ValueError: a frame without a pose.
    """
    pose = frame.true_world_from_camera
    if pose is None:
        raise ValueError(f"{frame.file}: no pose, so nobody knows where a line is in the image")
    camera = _pinhole(frame.camera)
    start, along = pose.inv().apply(line.p0_m), pose.rotation.inv().apply(line.p1_m - line.p0_m)
    slope = (np.asarray(v_px) - camera.cy) / camera.fy
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (slope * start[2] - start[1]) / (along[1] - slope * along[2])
        x, z = start[0] + steps * along[0], start[2] + steps * along[2]
        return np.asarray(np.where(z > 0, camera.cx + camera.fx * x / z, np.nan))


def _pinhole(camera: Camera) -> Camera:
    """The camera, if it has no distortion.

    Raises:
        ValueError: it has, and a straight line is none in its image.
    """
    if camera.has_distortion:
        raise ValueError("lines are moved in pinhole images only, got a camera with distortion")
    return camera


def _boresight(rng: np.random.Generator) -> Step:
    axis = rng.normal(size=3)
    turn = RigidTransform.from_rotation(Rotation.from_rotvec(BORESIGHT_RAD * axis / np.linalg.norm(axis)))

    def step(shot: Shot, active: bool) -> Shot:
        if not active:
            return shot
        return replace(shot, frame=replace(shot.frame, body_from_camera=shot.frame.body_from_camera * turn))

    return step


def _depth_bias(rng: np.random.Generator) -> Step:
    scale = np.float32(1.0 + DEPTH_BIAS * rng.choice([-1.0, 1.0]))

    def step(shot: Shot, active: bool) -> Shot:
        depth = shot.frame.depth_m
        return replace(shot, frame=replace(shot.frame, depth_m=depth * scale)) if active and depth is not None else shot

    return step


def _frozen(rng: np.random.Generator) -> Step:
    last: list[Shot] = []

    def step(shot: Shot, active: bool) -> Shot:
        if not active or not last:
            last[:] = [shot]
            return shot
        return Shot(replace(shot.frame, image_rgb=last[0].frame.image_rgb), last[0].detection)

    return step


def _late_pose(rng: np.random.Generator) -> Step:
    known: deque[tuple[float, RigidTransform]] = deque(maxlen=MOST_POSES)

    def step(shot: Shot, active: bool) -> Shot:
        frame = shot.frame
        if frame.world_from_body is None:
            return shot
        known.append((frame.time_s, frame.world_from_body))
        if not active:
            return shot
        late = pose_at(list(known), frame.time_s - DELAY_S)
        truth = frame.truth and replace(frame.truth, world_from_body=frame.true_world_from_body)
        return replace(shot, frame=replace(frame, world_from_body=late, truth=truth))

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


def _deck_height(rng: np.random.Generator) -> Step:
    wrong = float(rng.uniform(*DECK_M)) * float(rng.choice([-1.0, 1.0]))

    def step(shot: Shot, active: bool) -> Shot:
        deck = shot.frame.deck_z_m
        return replace(shot, frame=replace(shot.frame, deck_z_m=deck + wrong)) if active and deck is not None else shot

    return step


def _deck_height_once(rng: np.random.Generator) -> Step:
    always = _deck_height(rng)
    done = False

    def step(shot: Shot, active: bool) -> Shot:
        nonlocal done
        now, done = active and not done, done or active
        return always(shot, now)

    return step


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("swapped lines", True, _swapped),
        Fault("foul line", True, _foul_line),
        Fault("catapult track", True, _catapult),
        Fault("boresight 1 deg", False, _boresight),
        Fault("depth bias 3 %", False, _depth_bias),
        Fault("frozen camera", True, _frozen),
        Fault("pose late by 0.2 s", True, _late_pose),
        Fault("deck height once", True, _deck_height_once),
        Fault("deck height", False, _deck_height),
    )
}
