"""The paper's Figures 14 and 15: points that a detector finds before and after dehazing, and the localized lines."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.flight import Flight, FrameResult
from deckline.recording import open_recording
from deckline.report.draw import draw_dashes, draw_dot, draw_segment, draw_tag, write_picture
from deckline.truth import range_to_ramp_m, true_segments
from deckline.types import SIDES, Frame, RunwayLine, Segment
from deckline_lab.evaluation.pictures import INK, PAPER
from deckline_sim.visible_line import project_line

Picture = NDArray[np.uint8]

SHOWN_M = (60.0, 300.0)  # range to the ramp of the frames shown
TILE_PX = (560, 315)
MARGIN = 0.35  # of the runway's box, around it
POINT, TRUE, LOCALIZED = (255, 176, 0), (60, 220, 90), (60, 120, 255)
TEXT_PX = 14

# Adds to a tile what a result shows: the tile, the result, tile px per image px, the image px of the tile's corner.
Draw = Callable[[Picture, FrameResult, float, NDArray[np.float64]], None]


def draw_lines(recording: Path, flights: Mapping[str, tuple[Flight, Flight]], paths: tuple[Path, Path]) -> None:
    """Figures 14 and 15 of the two frames in the densest haze.

    Args:
        recording: frames with their true lines.
        flights: without and with dehazing, by detector.
        paths: of the two pictures (.png): points found, a row for each detector; lines localized after dehazing.
    """
    frames = densest_frames(recording, 2)
    found, localized = [], []
    for name, pair in flights.items():
        results = [flight(frame) for frame in frames for flight in pair]
        words = [f"{name}, {seen}" for _ in frames for seen in ("hazy", "dehazed")]
        found.append(np.hstack([_tile(*each, _draw_points) for each in zip(results, words, strict=True)]))
        localized.append([_tile(result, name, _draw_localized) for result in results[1::2]])
    for path, rows in zip(paths, (found, [np.hstack(row) for row in localized]), strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_picture(path, np.vstack(rows))
        print(path)


def densest_frames(recording: Path, count: int) -> list[Frame]:
    """The frames at `SHOWN_M` in the densest haze, each of another flight."""
    by_flight: dict[float, Frame] = {}
    for frame in open_recording(recording):
        if frame.truth is not None and SHOWN_M[0] <= range_to_ramp_m(frame) <= SHOWN_M[1]:
            by_flight[frame.truth.visibility_m or np.inf] = frame
    return [by_flight[visibility_m] for visibility_m in sorted(by_flight)[:count]]


def _draw_points(picture: Picture, result: FrameResult, scale: float, corner: NDArray[np.float64]) -> None:
    for side in SIDES:
        for point in getattr(result.detection, side).points_px:
            draw_dot(picture, (point - corner) * scale, 3.0, POINT)


def _draw_localized(picture: Picture, result: FrameResult, scale: float, corner: NDArray[np.float64]) -> None:
    for side, segment in true_segments(result.frame.truth).items():
        line = result.estimate.lines.get(side)
        projected = None if line is None else project_line(result.frame, beside(segment, line))
        if projected is not None:
            draw_segment(picture, (projected[0][[0, -1]] - corner) * scale, LOCALIZED, 2)


def beside(segment: Segment, line: RunwayLine) -> Segment:
    """The part of a localized line that lies beside a true one."""
    ends = (segment.p0_m, segment.p1_m)
    near, far = (line.point_m + ((end - line.point_m) @ line.direction) * line.direction for end in ends)
    return replace(segment, p0_m=near, p1_m=far)


def _tile(result: FrameResult, words: str, draw: Draw) -> Picture:
    """The runway's part of what the detector saw, true lines dashed, with what `draw` adds."""
    frame = result.frame
    seen = frame.image_rgb if result.dehazed is None else result.dehazed.image_rgb
    lines = [project_line(frame, segment) for segment in true_segments(frame.truth).values()]
    ends = np.array([line[0][[0, -1]] for line in lines if line is not None])
    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
    middle, size = (low + high) / 2, (1 + 2 * MARGIN) * np.maximum(high - low, 16.0)
    scale = float(min(np.array(TILE_PX) / size))
    corner = middle - np.array(TILE_PX) / (2 * scale)
    move = np.column_stack([np.eye(2) * scale, -scale * corner])
    picture = np.asarray(cv2.warpAffine(seen, move, TILE_PX, borderMode=cv2.BORDER_REPLICATE), np.uint8)
    for each in ends:
        draw_dashes(picture, (each - corner) * scale, TRUE, 1, dash_px=6.0)
    draw(picture, result, scale, corner)
    visibility_m = float("nan") if frame.truth is None else frame.truth.visibility_m
    words += f"; {range_to_ramp_m(frame):.0f} m, visibility {visibility_m:.0f} m"
    draw_tag(picture, words, (6, 6), TEXT_PX, PAPER, INK)
    return picture
