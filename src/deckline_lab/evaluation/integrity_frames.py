"""Faults put on purpose into rendered frames: pictures, poses, times, and what a flight is told of camera and deck."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.extras import needs_extra
from deckline.truth import true_segments
from deckline.types import SIDES, Frame, Segment
from deckline_lab.evaluation.integrity_faults import CATAPULT_M, CATAPULT_RAD, DELAY_S, offset_line, pose_at
from deckline_lab.evaluation.integrity_paint import draw_boxes, erase, paint

ROLL_DEG = (5.0, 15.0)  # of a picture, either way
DROPPED = 0.7  # share of the frames
YAW_DEG, PITCH_DEG = 5.0, 3.0  # of the camera mount, either way
DECK_M = 10.0  # up
NIGHT = 0.04  # of the light
PAINT_M = (3.0, 5.5)  # from an edge line's middle to an extra line's, either way
ERASED_M, BESIDE_M = 3.6, 2.8  # width that an edge line's paint is hidden in, by the deck so far inside of it
MOVED_M = 9.0  # of a line that is painted in place of an edge line, either way
NARROW_M = 6.0  # between the middle and either line, where both are painted anew
SECOND_M, SECOND_RAD = (5.0, 12.0), (0.03, 0.12)  # of a second runway beside the first, either way, and turned
AIRCRAFT_M = (14.0, 10.0, 4.0)  # length, width and height of one that stands on an edge line
PEOPLE, PEOPLE_ASIDE_M = 25, 0.6  # on each edge line, so far off its middle at most
PERSON_M, PERSON_LEVEL = (0.5, 0.6, 1.8), 50.0  # length, width and height
RAIN_MM_H, LENS_DROPS = (10.0, 60.0), (15, 80)  # heavy to torrential; drops that sit on the lens
GAMMA = 2.2  # of the image's levels over light
AIRCRAFT_AT = (0.1, 0.6)  # where on the line it stands, of its length
RUBBER_AT, RUBBER_LEVEL = (0.15, 0.5), 45.0  # part of both edge lines that tyres have blackened
GLARE_PART = (0.01, 0.06)  # of the image's width: 1-sigma of the sun's image on the water and the lens

Edges = dict[str, Segment]  # true left, right and centre line
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


def _rain(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
    """Streaks of falling rain and drops on the lens, as the simulator exposes them; the air stays as it is."""
    with needs_extra("sim"):
        from deckline_sim.camera.exposure import ExposurePass, draw_exposure
        from deckline_sim.config import ExposureConfig
        from deckline_sim.scene.gl import open_context
        from deckline_sim.scene.view import Rendering
    config = ExposureConfig(rain_mm_h=float(rng.uniform(*RAIN_MM_H)), lens_drops=int(rng.integers(*LENS_DROPS)))
    seed = int(rng.integers(2**31))
    with open_context() as context:
        film = ExposurePass(context)
        for number, (before, frame) in enumerate(pairwise((frames[0], *frames))):
            pose = frame.true_world_from_camera
            if pose is None or before.true_world_from_camera is None:
                yield frame
                continue
            moved_m = pose.translation - before.true_world_from_camera.translation
            velocity = moved_m / max(frame.time_s - before.time_s, 1e-3)
            recording, drops = np.random.default_rng(seed), np.random.default_rng([seed, number])
            exposure = draw_exposure(config, frame.camera, pose, velocity, np.zeros(3), recording, drops, wide=False)
            light = np.asarray((frame.image_rgb / 255) ** GAMMA, dtype=np.float32)
            wet = film.expose(Rendering(light, np.ones(light.shape[:2], np.float32)), frame.camera, exposure).radiance
            levels = 255 * np.clip(wet, 0, 1) ** (1 / GAMMA)
            yield replace(frame, image_rgb=np.rint(levels).astype(np.uint8))


def _on_deck(begin: Callable[[np.random.Generator], Callable[[Frame, Edges], Frame]]) -> Change:
    """A change of what is seen on the deck: `begin` draws how bad it is."""

    def change(frames: Frames, rng: np.random.Generator) -> Iterator[Frame]:
        repaint = begin(rng)
        for frame in frames:
            edges = true_segments(frame.truth)
            yield repaint(frame, edges) if edges else frame

    return change


def _draw(rng: np.random.Generator, span: tuple[float, float]) -> float:
    """Within a span, either way."""
    return float(rng.uniform(*span) * rng.choice([-1.0, 1.0]))


def _extra_line(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    """One more line beside an edge line, along all of it, inside or outside."""
    side, right_m = SIDES[rng.integers(2)], _draw(rng, PAINT_M)
    return lambda frame, edges: paint(frame, offset_line(edges[side], right_m, 0.0))


def _crossing_line(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    """A catapult's track: a line that begins beside an edge line and runs at an angle to it."""
    side, right_m, turn_rad = SIDES[rng.integers(2)], _draw(rng, CATAPULT_M), _draw(rng, CATAPULT_RAD)
    return lambda frame, edges: paint(frame, offset_line(edges[side], right_m, turn_rad))


def _second_runway(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    right_m, turn_rad = _draw(rng, SECOND_M), _draw(rng, SECOND_RAD)

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            frame = paint(frame, offset_line(edges[side], right_m, turn_rad))
        return frame

    return repaint


def _lose_edge(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    side = SIDES[rng.integers(2)]
    return lambda frame, edges: _without(frame, edges, side)


def _move_edge(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    side, right_m = SIDES[rng.integers(2)], MOVED_M * float(rng.choice([-1.0, 1.0]))
    return lambda frame, edges: paint(_without(frame, edges, side), offset_line(edges[side], right_m, 0.0))


def _narrow(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            right_m = NARROW_M * (1 if side == "right" else -1)
            frame = paint(_without(frame, edges, side), offset_line(edges["centre"], right_m, 0.0))
        return frame

    return repaint


def _without(frame: Frame, edges: Edges, side: str) -> Frame:
    return erase(frame, edges[side], ERASED_M, BESIDE_M * (1 if side == "left" else -1))


def _blacken(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            start, along = edges[side].p0_m, edges[side].p1_m - edges[side].p0_m
            part = Segment(start + RUBBER_AT[0] * along, start + RUBBER_AT[1] * along)
            frame = paint(frame, part, ERASED_M, RUBBER_LEVEL)
        return frame

    return repaint


def _park(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    side, at, level = SIDES[rng.integers(2)], float(rng.uniform(*AIRCRAFT_AT)), float(rng.uniform(60, 160))
    return lambda frame, edges: draw_boxes(frame, edges[side], [(at, 0.0)], AIRCRAFT_M, level)


def _gather(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    """People in dark clothes who stand on both edge lines."""
    places = {side: rng.uniform([0.0, -PEOPLE_ASIDE_M], [1.0, PEOPLE_ASIDE_M], (PEOPLE, 2)) for side in SIDES}

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            frame = draw_boxes(frame, edges[side], places[side], PERSON_M, PERSON_LEVEL)
        return frame

    return repaint


def _dazzle(rng: np.random.Generator) -> Callable[[Frame, Edges], Frame]:
    """The sun's light about the ramp, as it saturates a sensor."""
    part = float(rng.uniform(*GLARE_PART))

    def repaint(frame: Frame, edges: Edges) -> Frame:
        pose, camera = frame.true_world_from_camera, frame.camera
        if pose is None or (ramp := pose.inv().apply(edges["centre"].p0_m))[2] <= 0:
            return frame
        ((u, v),) = camera.project(ramp[None])
        across = np.exp(-((np.arange(camera.width) - u) ** 2) / (2 * (part * camera.width) ** 2))
        down = np.exp(-((np.arange(camera.height) - v) ** 2) / (2 * (part * camera.width) ** 2))
        light = 255 * (down[:, None] * across)[..., None]
        return replace(frame, image_rgb=np.clip(frame.image_rgb + light, 0, 255).astype(np.uint8))

    return repaint


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
        FrameFault("glare", True, _on_deck(_dazzle)),
        FrameFault("extra line", False, _on_deck(_extra_line)),
        FrameFault("crossing line", False, _on_deck(_crossing_line)),
        FrameFault("second runway", True, _on_deck(_second_runway)),
        FrameFault("edge lost", False, _on_deck(_lose_edge)),
        FrameFault("edge moved by 9 m", False, _on_deck(_move_edge)),
        FrameFault("edges at 6 m", False, _on_deck(_narrow)),
        FrameFault("edges under rubber", False, _on_deck(_blacken)),
        FrameFault("aircraft on an edge", False, _on_deck(_park)),
        FrameFault("people on the edges", False, _on_deck(_gather)),
        FrameFault("rain", False, _rain),
    )
}
