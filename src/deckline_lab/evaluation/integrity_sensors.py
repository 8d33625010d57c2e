"""Faults of detected points, poses, depth, camera mount and deck height: they need no rendered picture."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
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
DROPPED = 0.7  # share of the frames

History = Sequence[Sighting]  # of a flight without the fault, the newest frame last
# A step takes the history and the index of the first faulty frame; it returns what the flight gets in place of the
# newest frame: one sighting, none for a dropped or held frame, two after a held one.
Step = Callable[[History, int], Iterable[Sighting]]
Begin = Callable[[np.random.Generator], Step]  # draws the size of a fault


def each(change: Callable[[Sighting], Sighting]) -> Step:
    """A fault that changes every frame on its own."""
    return lambda flight, first: [change(flight[-1])]


def each_frame(change: Callable[[Frame], dict[str, Any]]) -> Step:
    """A fault that replaces fields of every frame and leaves the detection."""
    return each(lambda now: now._replace(frame=replace(now.frame, **change(now.frame))))


def draw_signed(rng: np.random.Generator, span: tuple[float, float]) -> float:
    """A size within a span, with either sign."""
    return float(rng.uniform(*span) * rng.choice([-1.0, 1.0]))


def swap_lines(rng: np.random.Generator) -> Step:
    """The points of the left and the right line are exchanged."""
    return _each_detection(lambda frame, left, right: {"left": right, "right": left})


def foul_line(rng: np.random.Generator) -> Step:
    """One edge's points lie on a line parallel to it, outside the runway."""
    return _detect_other_line(SIDES[rng.integers(2)], float(rng.uniform(*FOUL_M)), 0.0)


def catapult_track(rng: np.random.Generator) -> Step:
    """One edge's points lie on a line outside the runway at an angle to it."""
    turn = draw_signed(rng, CATAPULT_RAD)
    return _detect_other_line(SIDES[rng.integers(2)], float(rng.uniform(*CATAPULT_M)), turn)


def _detect_other_line(side: str, outwards_m: float, turn_rad: float) -> Step:
    """One edge's points lie on another line of the deck, with the noise they had."""

    def change(frame: Frame, left: LinePoints, right: LinePoints) -> dict[str, LinePoints]:
        points, true = left if side == "left" else right, true_segments(frame.truth).get(side)
        if true is None or not len(points):
            return {}
        other = offset_line(true, -outwards_m if side == "left" else outwards_m, turn_rad)
        return {side: move_points(points, true, other, frame)}

    return _each_detection(change)


def _each_detection(change: Callable[[Frame, LinePoints, LinePoints], dict[str, LinePoints]]) -> Step:
    def apply(now: Sighting) -> Sighting:
        if now.detection is None:
            raise ValueError(f"{now.frame.file}: this fault changes detected points, got a frame without a detection")
        lines: dict[str, Any] = change(now.frame, now.detection.left, now.detection.right)
        return now._replace(detection=replace(now.detection, **lines))

    return each(apply)


def turn_camera(rng: np.random.Generator) -> Step:
    """The camera is turned by BORESIGHT_RAD about a random axis."""
    axis = rng.normal(size=3)
    turn = RigidTransform.from_rotation(Rotation.from_rotvec(BORESIGHT_RAD * axis / np.linalg.norm(axis)))
    return each_frame(lambda frame: {"body_from_camera": frame.body_from_camera * turn})


def turn_mount(axis: str, angle_deg: float) -> Begin:
    """The camera mount is turned about one body axis, either way."""

    def begin(rng: np.random.Generator) -> Step:
        turn = RigidTransform.from_rotation(Rotation.from_euler(axis, angle_deg * rng.choice([-1, 1]), degrees=True))
        return each_frame(lambda frame: {"body_from_camera": turn * frame.body_from_camera})

    return begin


def move_principal_point(by_px: float) -> Begin:
    """The stated principal point is beside the true one, either way."""

    def begin(rng: np.random.Generator) -> Step:
        aside_px = by_px * rng.choice([-1.0, 1.0])
        return each_frame(lambda frame: {"camera": replace(frame.camera, cx=frame.camera.cx + aside_px)})

    return begin


def crop_left(share: float) -> Begin:
    """A share of the columns at the left is cut off; camera and size stay as stated, and the right edge is black."""

    def change(now: Sighting) -> Sighting:
        frame, width = now.frame, now.frame.camera.width
        cut = round(share * width)
        image = np.pad(frame.image_rgb[:, cut:], ((0, 0), (0, cut), (0, 0)))
        depth = frame.depth_m
        if depth is not None:
            depth = np.pad(depth[:, cut:], ((0, 0), (0, cut)), constant_values=np.nan)
        frame = replace(frame, image_rgb=image, depth_m=depth)
        if now.detection is None:
            return Sighting(frame)
        left, right = (_shift_points(getattr(now.detection, side), -cut) for side in SIDES)
        return Sighting(frame, replace(now.detection, left=left, right=right))

    return lambda rng: each(change)


def _shift_points(points: LinePoints, by_px: float) -> LinePoints:
    """Points moved along the rows; those left of the picture are gone."""
    moved = points.points_px + np.array([by_px, 0.0])
    inside = moved[:, 0] >= 0
    return LinePoints(moved[inside], points.confidence[inside], points.sigma_px[inside])


def change_nothing(rng: np.random.Generator) -> Step:
    """Frames stay as they are, for a fault of what is stated."""
    return each(lambda now: now)


def scale_depth(rng: np.random.Generator) -> Step:
    """All depths are wrong by DEPTH_BIAS of them, either way."""
    scale = np.float32(1.0 + DEPTH_BIAS * rng.choice([-1.0, 1.0]))
    return each_frame(lambda frame: {} if frame.depth_m is None else {"depth_m": frame.depth_m * scale})


def set_deck(deck_z_m: Callable[[Frame, float], float | None]) -> Begin:
    """The reported deck height becomes a function of the frame and of the right one."""
    return lambda rng: each_frame(
        lambda frame: {} if frame.deck_z_m is None else {"deck_z_m": deck_z_m(frame, frame.deck_z_m)}
    )


def shift_deck(rng: np.random.Generator) -> Step:
    """The reported deck height is wrong by a constant."""
    error_m = draw_signed(rng, DECK_M)
    return set_deck(lambda frame, deck_z_m: deck_z_m + error_m)(rng)


def shift_deck_once(rng: np.random.Generator) -> Step:
    """The reported deck height is wrong in the first faulty frame alone."""
    shift = shift_deck(rng)
    return lambda flight, first: shift(flight, first) if len(flight) == first + 1 else flight[-1:]


def freeze_camera(rng: np.random.Generator) -> Step:
    """Picture and detection stay those of the last frame without the fault."""
    return lambda flight, first: [_hold_picture(flight[max(first - 1, 0)], flight[-1])]


def stall_picture(rng: np.random.Generator) -> Step:
    """Picture and detection stay those of the first frame with the fault."""
    return lambda flight, first: [_hold_picture(flight[first], flight[-1])]


def stall_all(rng: np.random.Generator) -> Step:
    """Picture, depth and pose stay those of the first frame with the fault."""

    def step(flight: History, first: int) -> list[Sighting]:
        held, now = flight[first], _hold_picture(flight[first], flight[-1])
        frame = replace(now.frame, depth_m=held.frame.depth_m)
        return [now._replace(frame=report_pose(frame, held.frame.world_from_body))]

    return step


def _hold_picture(held: Sighting, now: Sighting) -> Sighting:
    return Sighting(replace(now.frame, image_rgb=held.frame.image_rgb), held.detection)


def drop_frames(rng: np.random.Generator) -> Step:
    """A share of DROPPED of the frames is lost."""
    return lambda flight, first: flight[-1:] if rng.random() >= DROPPED else []


def delay_pose(rng: np.random.Generator) -> Step:
    """The reported pose is that of DELAY_S before, or that of the first frame with the fault, if it is later."""

    def step(flight: History, first: int) -> list[Sighting]:
        now = flight[-1]
        frames = [at.frame for at in flight[first:]]
        known = [(frame.time_s, frame.world_from_body) for frame in frames if frame.world_from_body is not None]
        if now.frame.world_from_body is None:
            return [now]
        return [now._replace(frame=report_pose(now.frame, pose_at(known, now.frame.time_s - DELAY_S)))]

    return step


def swap_poses(rng: np.random.Generator) -> Step:
    """Each two frames exchange their poses; the first of them is held until the second is there."""

    def step(flight: History, first: int) -> list[Sighting]:
        if (len(flight) - first) % 2:
            return []
        one, other = flight[-2:]
        return [
            at._replace(frame=report_pose(at.frame, wrong.frame.world_from_body))
            for at, wrong in ((one, other), (other, one))
        ]

    return step


def report_pose(frame: Frame, world_from_body: RigidTransform | None) -> Frame:
    """A frame that reports another pose; its truth holds the true one."""
    truth = frame.truth and replace(frame.truth, world_from_body=frame.true_world_from_body)
    return replace(frame, world_from_body=world_from_body, truth=truth)


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
    inside = np.isfinite(u) & (u >= 0) & (u <= frame.camera.width - 1)
    moved = np.column_stack([u, v])[inside]
    return LinePoints(moved, points.confidence[inside], points.sigma_px[inside])


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
