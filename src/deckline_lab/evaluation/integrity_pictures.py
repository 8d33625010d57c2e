"""Faults of rendered pictures: optics, light, weather, and paint and objects on the deck."""

import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from deckline.truth import true_segments
from deckline.types import SIDES, Frame, Segment
from deckline_lab.evaluation.approaches import Sighting
from deckline_lab.evaluation.integrity_paint import draw_boxes, erase, paint
from deckline_lab.evaluation.integrity_sensors import (
    CATAPULT_M,
    CATAPULT_RAD,
    History,
    Step,
    draw_signed,
    each,
    each_frame,
    offset_line,
)
from deckline_sim.config import ExposureConfig
from deckline_sim.scene.view import Rendering

ROLL_DEG = (5.0, 15.0)  # of a picture, either way
NIGHT = 0.04  # of the light
PAINT_M = (3.0, 5.5)  # from an edge line's middle to an extra line's, either way
ERASED_M, BESIDE_M = 3.6, 2.8  # width that an edge line's paint is hidden in, by the deck so far inside of it
MOVED_M = 9.0  # of a line that is painted in place of an edge line, either way
NARROW_M = 6.0  # between the middle and either line, where both are painted anew
SECOND_M, SECOND_RAD = (5.0, 12.0), (0.03, 0.12)  # of a second runway beside the first, either way, and turned
AIRCRAFT_M = (14.0, 10.0, 4.0)  # length, width and height of one on an edge line
PEOPLE, PEOPLE_ASIDE_M = 25, 0.6  # on each edge line, so far off its middle at most
PERSON_M, PERSON_LEVEL = (0.5, 0.6, 1.8), 50.0  # length, width and height
RAIN_MM_H, LENS_DROPS = (10.0, 60.0), (15, 80)  # heavy to torrential; drops that sit on the lens
GAMMA = 2.2  # of the image's levels over light
AIRCRAFT_AT = (0.1, 0.6)  # where on the line it is, of its length
RUBBER_AT, RUBBER_LEVEL = (0.15, 0.5), 45.0  # part of both edge lines that tyres have blackened
GLARE_PART = (0.01, 0.06)  # of the image's width: 1-sigma of the sun's image on the water and the lens


Edges = dict[str, Segment]  # true left, right and centre line
Repaint = Callable[[Frame, Edges], Frame]


def mirror(rng: np.random.Generator) -> Step:
    """Left and right of the picture are exchanged."""
    return each_frame(lambda frame: {"image_rgb": np.ascontiguousarray(frame.image_rgb[:, ::-1])})


def roll(rng: np.random.Generator) -> Step:
    """The picture is rotated about its principal point."""
    angle_deg = draw_signed(rng, ROLL_DEG)

    def change(frame: Frame) -> dict[str, Any]:
        camera = frame.camera
        turn = cv2.getRotationMatrix2D((camera.cx, camera.cy), angle_deg, 1.0)
        size = camera.width, camera.height
        image = cv2.warpAffine(frame.image_rgb, turn, size, borderMode=cv2.BORDER_REFLECT)
        return {"image_rgb": np.asarray(image, dtype=np.uint8)}

    return each_frame(change)


def darken(rng: np.random.Generator) -> Step:
    """Little light, amplified: shot noise of an eight-bit camera whose full scale is a photon a level."""

    def change(frame: Frame) -> dict[str, Any]:
        light = rng.poisson(NIGHT * frame.image_rgb.astype(np.float32)) / NIGHT
        return {"image_rgb": np.clip(light, 0, 255).astype(np.uint8)}

    return each_frame(change)


def rain(rng: np.random.Generator) -> Step:
    """Streaks of falling rain and drops on the lens, as the simulator exposes them; the air stays as it is."""
    from deckline_sim.camera.exposure import ExposurePass, draw_exposure  # needs OpenGL
    from deckline_sim.scene.gl import open_context

    config = ExposureConfig(rain_mm_h=float(rng.uniform(*RAIN_MM_H)), lens_drops=int(rng.integers(*LENS_DROPS)))
    seed = int(rng.integers(2**31))
    context = open_context()
    exposure_pass = ExposurePass(context)

    def step(flight: History, first: int) -> list[Sighting]:
        number, frame = len(flight) - 1 - first, flight[-1].frame
        before = flight[max(len(flight) - 2, first)].frame
        pose = frame.true_world_from_camera
        if pose is None or before.true_world_from_camera is None:
            return [flight[-1]]
        moved_m = pose.translation - before.true_world_from_camera.translation
        velocity = moved_m / max(frame.time_s - before.time_s, 1e-3)
        recording, drops = np.random.default_rng(seed), np.random.default_rng([seed, number])
        exposure = draw_exposure(config, frame.camera, pose, velocity, np.zeros(3), recording, drops, wide=False)
        light = np.asarray((frame.image_rgb / 255) ** GAMMA, dtype=np.float32)
        lit = Rendering(light, np.ones(light.shape[:2], np.float32))
        wet = exposure_pass.expose(lit, frame.camera, exposure).radiance
        levels = 255 * np.clip(wet, 0, 1) ** (1 / GAMMA)
        return [flight[-1]._replace(frame=replace(frame, image_rgb=np.rint(levels).astype(np.uint8)))]

    weakref.finalize(step, context.release)  # at the end of the flight
    return step


def _on_deck(repaint: Repaint) -> Step:
    """A change of what is visible on the deck, where there is one."""

    def change(now: Sighting) -> Sighting:
        edges = true_segments(now.frame.truth)
        return now._replace(frame=repaint(now.frame, edges)) if edges else now

    return each(change)


def extra_line(rng: np.random.Generator) -> Step:
    """One more line beside an edge line, along all of it, inside or outside."""
    side, right_m = SIDES[rng.integers(2)], draw_signed(rng, PAINT_M)
    return _on_deck(lambda frame, edges: paint(frame, offset_line(edges[side], right_m, 0.0)))


def crossing_line(rng: np.random.Generator) -> Step:
    """A catapult's track: a line that begins beside an edge line and runs at an angle to it."""
    side, right_m, turn_rad = SIDES[rng.integers(2)], draw_signed(rng, CATAPULT_M), draw_signed(rng, CATAPULT_RAD)
    return _on_deck(lambda frame, edges: paint(frame, offset_line(edges[side], right_m, turn_rad)))


def second_runway(rng: np.random.Generator) -> Step:
    """Both edge lines of a second runway are painted beside the first."""
    right_m, turn_rad = draw_signed(rng, SECOND_M), draw_signed(rng, SECOND_RAD)

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            frame = paint(frame, offset_line(edges[side], right_m, turn_rad))
        return frame

    return _on_deck(repaint)


def lose_edge(rng: np.random.Generator) -> Step:
    """The paint of one edge line is missing."""
    side = SIDES[rng.integers(2)]
    return _on_deck(lambda frame, edges: _without(frame, edges, side))


def move_edge(rng: np.random.Generator) -> Step:
    """One edge line is painted MOVED_M away from its place."""
    side, right_m = SIDES[rng.integers(2)], MOVED_M * float(rng.choice([-1.0, 1.0]))
    return _on_deck(lambda frame, edges: paint(_without(frame, edges, side), offset_line(edges[side], right_m, 0.0)))


def narrow(rng: np.random.Generator) -> Step:
    """Both edge lines are painted at NARROW_M from the middle, in place of the true ones."""

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            right_m = NARROW_M * (1 if side == "right" else -1)
            frame = paint(_without(frame, edges, side), offset_line(edges["centre"], right_m, 0.0))
        return frame

    return _on_deck(repaint)


def _without(frame: Frame, edges: Edges, side: str) -> Frame:
    return erase(frame, edges[side], ERASED_M, BESIDE_M * (1 if side == "left" else -1))


def blacken(rng: np.random.Generator) -> Step:
    """Tyre rubber covers a part of both edge lines."""

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            start, along = edges[side].p0_m, edges[side].p1_m - edges[side].p0_m
            part = Segment(start + RUBBER_AT[0] * along, start + RUBBER_AT[1] * along)
            frame = paint(frame, part, ERASED_M, RUBBER_LEVEL)
        return frame

    return _on_deck(repaint)


def park(rng: np.random.Generator) -> Step:
    """A parked aircraft hides a part of one edge line."""
    side, at, level = SIDES[rng.integers(2)], float(rng.uniform(*AIRCRAFT_AT)), float(rng.uniform(60, 160))
    return _on_deck(lambda frame, edges: draw_boxes(frame, edges[side], [(at, 0.0)], AIRCRAFT_M, level))


def gather(rng: np.random.Generator) -> Step:
    """People in dark clothes on both edge lines."""
    places = {side: rng.uniform([0.0, -PEOPLE_ASIDE_M], [1.0, PEOPLE_ASIDE_M], (PEOPLE, 2)) for side in SIDES}

    def repaint(frame: Frame, edges: Edges) -> Frame:
        for side in SIDES:
            frame = draw_boxes(frame, edges[side], places[side], PERSON_M, PERSON_LEVEL)
        return frame

    return _on_deck(repaint)


def dazzle(rng: np.random.Generator) -> Step:
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

    return _on_deck(repaint)
