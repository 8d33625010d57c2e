"""Faults put on purpose into rendered frames: pictures, poses, times, and what a flight is told of camera and deck."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.evaluation.integrity_faults import DELAY_S, offset_line, pose_at
from deckline.haze import beta_from_visibility, transmission
from deckline.truth import true_segments
from deckline.types import SIDES, Frame, Segment

ROLL_DEG = (5.0, 15.0)  # of a picture, either way
DROPPED = 0.7  # share of the frames
YAW_DEG, PITCH_DEG = 5.0, 3.0  # of the camera mount, either way
DECK_M = 10.0  # up
NIGHT = 0.04  # of the light
PAINT_M = (3.0, 5.5)  # from an edge line's middle to an extra line's, either way
PAINT_WIDTH_M, PAINT_LEVEL = 0.8, 210.0
STEP_M, NEAR_M = 5.0, 2.0  # pieces that a line is painted in; nearer ones are left out
FINE = 4  # subpixels a side of a painted line's edge

Frames = Sequence[Frame]
Change = Callable[[Frames, np.random.Generator], Iterator[Frame]]  # of the frames that have the fault, in order of time


@dataclass(frozen=True)
class FrameFault:
    """Something that goes wrong in pictures or in what comes with them."""

    name: str
    sudden: bool  # it comes in flight; otherwise it is there from the first frame
    change: Change  # draws how bad it is
    told: bool = False  # wrong is only what the flight is told of camera and deck, so that no picture is needed


def inject_frames(
    frames: Frames, fault: FrameFault | None, onset_s: float, rng: np.random.Generator
) -> Iterator[tuple[Frame, bool]]:
    """Frames, in order of time, and whether each has the fault; a sudden one comes at `onset_s`."""
    whole = [frame for frame in frames if fault is None or (fault.sudden and frame.time_s < onset_s)]
    yield from ((frame, False) for frame in whole)
    if fault is not None:
        yield from ((frame, True) for frame in fault.change(frames[len(whole) :], rng))


def _each(change: Callable[[Frame], dict[str, Any]]) -> Change:
    return lambda frames, rng: (replace(frame, **change(frame)) for frame in frames)


def _mirror(frame: Frame) -> dict[str, Any]:
    return {"image_rgb": np.ascontiguousarray(frame.image_rgb[:, ::-1])}


def _roll(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    angle_deg = float(rng.uniform(*ROLL_DEG) * rng.choice([-1.0, 1.0]))
    for frame in frames:
        camera = frame.camera
        turn = cv2.getRotationMatrix2D((camera.cx, camera.cy), angle_deg, 1.0)
        size = camera.width, camera.height
        image = cv2.warpAffine(frame.image_rgb, turn, size, borderMode=cv2.BORDER_REFLECT)
        yield replace(frame, image_rgb=np.asarray(image, dtype=np.uint8))


def _stall_picture(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    return (replace(frame, image_rgb=frames[0].image_rgb) for frame in frames)


def _stall_all(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    stalled = (replace(frame, depth_m=frames[0].depth_m) for frame in _stall_picture(frames, rng))
    return (tell_pose(frame, frames[0].world_from_body) for frame in stalled)


def _drop(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    return (frame for frame in frames if rng.random() >= DROPPED)


def _delay_poses(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    known = [(frame.time_s, frame.world_from_body) for frame in frames if frame.world_from_body is not None]
    return (tell_pose(frame, pose_at(known, frame.time_s - DELAY_S)) for frame in frames)


def _swap_poses(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    for first, second in zip(frames[::2], frames[1::2], strict=False):
        yield tell_pose(first, second.world_from_body)
        yield tell_pose(second, first.world_from_body)


def tell_pose(frame: Frame, world_from_body: RigidTransform | None) -> Frame:
    """A frame that comes with another pose; where the aircraft truly is stays known."""
    truth = frame.truth and replace(frame.truth, world_from_body=frame.true_world_from_body)
    return replace(frame, world_from_body=world_from_body, truth=truth)


def _turn_mount(axis: str, angle_deg: float) -> Change:
    def change(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
        turn = RigidTransform.from_rotation(Rotation.from_euler(axis, angle_deg * rng.choice([-1, 1]), degrees=True))
        return (replace(frame, body_from_camera=turn * frame.body_from_camera) for frame in frames)

    return change


def _tell_deck(deck_z_m: Callable[[Frame, float], float | None]) -> Change:
    return _each(lambda frame: {} if frame.deck_z_m is None else {"deck_z_m": deck_z_m(frame, frame.deck_z_m)})


def _darken(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    """Little light, amplified: shot noise of an eight-bit camera whose full scale is a photon a level."""
    for frame in frames:
        light = rng.poisson(NIGHT * frame.image_rgb.astype(np.float32)) / NIGHT
        yield replace(frame, image_rgb=np.clip(light, 0, 255).astype(np.uint8))


def _paint_line(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    """One more line beside an edge line, along all of it, inside or outside."""
    side, right_m = SIDES[rng.integers(2)], float(rng.uniform(*PAINT_M) * rng.choice([-1.0, 1.0]))
    for frame in frames:
        edge = true_segments(frame.truth).get(side)
        yield frame if edge is None else replace(frame, image_rgb=paint(frame, offset_line(edge, right_m, 0.0)))


def paint(frame: Frame, line: Segment) -> NDArray[np.uint8]:
    """The frame's image (H, W, 3) with a painted line on its deck, seen through the frame's haze.

    Raises:
        ValueError: a frame without pose or truth.
    """
    pose, truth = frame.true_world_from_camera, frame.truth
    if pose is None or truth is None:
        raise ValueError(f"{frame.file}: to paint a line needs the true pose and air")
    along = line.p1_m - line.p0_m
    across = PAINT_WIDTH_M / 2 * np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    ends = line.p0_m + np.linspace(0, 1, 1 + int(np.linalg.norm(along) // STEP_M))[:, None] * along
    image = frame.image_rgb
    colour, cover = image.copy(), np.zeros((FINE * len(image), FINE * image.shape[1]), np.uint8)
    airlight = np.full(3, PAINT_LEVEL) if truth.airlight_rgb is None else np.asarray(truth.airlight_rgb, np.float64)
    beta = beta_from_visibility(truth.visibility_m) if truth.visibility_m else 0.0
    for start, end in pairwise(ends):
        corners = pose.inv().apply([start - across, start + across, end + across, end - across])
        if corners[:, 2].min() < NEAR_M:
            continue
        t = float(transmission(np.linalg.norm(corners.mean(axis=0)), beta))
        pixels = np.clip(frame.camera.project(corners), -8000, 8000)
        cv2.fillConvexPoly(colour, np.rint(pixels).astype(np.int32), (t * PAINT_LEVEL + (1 - t) * airlight).tolist())
        cv2.fillConvexPoly(cover, np.rint(FINE * (pixels + 0.5)).astype(np.int32), 255)
    share = cv2.resize(cover, image.shape[1::-1], interpolation=cv2.INTER_AREA)[..., None] / np.float32(255)
    return np.rint(image + share * (colour.astype(np.float32) - image)).astype(np.uint8)


FRAME_FAULTS = {
    fault.name: fault
    for fault in (
        FrameFault("mirrored picture", False, _each(_mirror)),
        FrameFault("rolled picture", False, _roll),
        FrameFault("stalled picture", True, _stall_picture),
        FrameFault("stalled picture and pose", True, _stall_all),
        FrameFault("dropped frames", True, _drop),
        FrameFault("pose late by 0.2 s", True, _delay_poses),
        FrameFault("swapped poses", True, _swap_poses),
        FrameFault("mount 5 deg in yaw", False, _turn_mount("z", YAW_DEG), told=True),
        FrameFault("mount 3 deg in pitch", False, _turn_mount("y", PITCH_DEG), told=True),
        FrameFault("deck height -10 m", False, _tell_deck(lambda frame, z_m: z_m - DECK_M), told=True),
        FrameFault("deck height of the sea", False, _tell_deck(lambda frame, z_m: frame.sea_z_m), told=True),
        FrameFault("deck height, wrong sign", False, _tell_deck(lambda frame, z_m: -z_m), told=True),
        FrameFault("night gain", False, _darken),
        FrameFault("extra line", False, _paint_line),
    )
}
