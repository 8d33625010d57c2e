"""Draw the site's gallery: views of random ships that are read rightly, and views that are not.

    python scripts/draw_gallery.py docs/figures [--seed 1000] [--frames 60]

Each picture has its range and visibility. Found lines are blue and orange; in the second sheet true lines are white.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.config import Models, RunConfig, Tracking
from deckline.flight import Flight, FrameResult
from deckline.report.annotators import LineAnnotator, MagnifierAnnotator
from deckline.report.draw import draw_text, write_picture
from deckline.truth import range_to_ramp_m, true_segments
from deckline.types import SIDES
from deckline_lab.evaluation.metrics import normal_pixel_error
from deckline_sim import SimConfig, frames
from deckline_sim.visible_line import project_line

SIZE_PX, COLUMNS, ROWS = (480, 270), 3, 3
RIGHT_PX = 3.0  # median distance of each line's points from the true line, in a picture 1280 px wide
Image = NDArray[np.uint8]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--frames", type=int, default=60)
    given = parser.parse_args()
    config = SimConfig(
        preset="train", trajectory="random", frames=given.frames, seed=given.seed, visibility_m=(500.0, 3000.0)
    )
    flight = Flight.from_config(RunConfig(models=Models(dehazer="none"), tracking=Tracking(enabled=False)))
    good: list[Image] = []
    bad: list[Image] = []
    count = 0
    for frame in frames(config):
        result = flight(frame)
        is_right = is_read_rightly(result)
        count += is_right
        sheet = good if is_right else bad
        if len(sheet) < COLUMNS * ROWS:
            sheet.append(draw_result(result, with_truth=not is_right))
    for name, pictures in (("gallery_right.jpg", good), ("gallery_wrong.jpg", bad)):
        write_picture(given.out / name, arrange(pictures))
    print(f"{count} of {given.frames} views are read rightly")


def is_read_rightly(result: FrameResult) -> bool:
    """Whether both lines are found and their points lie within `RIGHT_PX` of the true lines, in the median."""
    frame, pose = result.frame, result.frame.true_world_from_camera
    limit_px, lines = RIGHT_PX * frame.camera.width / 1280, true_segments(frame.truth)
    for side in SIDES:
        points = getattr(result.detection, side).points_px
        if pose is None or not len(points):
            return False
        ends_m = pose.inv().apply([lines[side].p0_m, lines[side].p1_m])
        if not np.median(normal_pixel_error(points, ends_m, frame.camera)) <= limit_px:
            return False
    return True


def draw_result(result: FrameResult, with_truth: bool) -> Image:
    frame = result.frame
    image = cv2.resize(frame.image_rgb, SIZE_PX, interpolation=cv2.INTER_AREA)
    if with_truth:
        scale = np.array(SIZE_PX) / [frame.camera.width, frame.camera.height]
        for segment in (true_segments(frame.truth)[side] for side in SIDES):
            if (line := project_line(frame, segment)) is not None:
                points = np.rint((line[0] + 0.5) * scale - 0.5).astype(np.int32)
                cv2.polylines(image, [points.reshape(-1, 1, 2)], False, (255, 255, 255), 1, cv2.LINE_AA)
    else:
        image = MagnifierAnnotator().annotate(image, result)
    image = LineAnnotator().annotate(image, result)
    visibility_m = frame.truth.visibility_m if frame.truth else None
    text = f"{range_to_ramp_m(frame):.0f} m from the ramp, visibility {visibility_m or 0:.0f} m"
    image[SIZE_PX[1] - 22 :] //= 2
    draw_text(image, text, (8, SIZE_PX[1] - 7), 13, (255, 255, 255))
    return image


def arrange(pictures: list[Image]) -> Image:
    blank = np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
    cells = [*pictures, *[blank] * (COLUMNS * ROWS - len(pictures))]
    return np.vstack([np.hstack(cells[row * COLUMNS : (row + 1) * COLUMNS]) for row in range(ROWS)])


if __name__ == "__main__":
    main()
