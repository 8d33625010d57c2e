"""Draw one recorded approach flown three ways: with its poses, by its pictures alone, and without a camera as well.

    deckline sim --out approach --frames 80 --seed 77 --visibility 1500 --start-m 500 --width 960 --height 540
    python scripts/draw_three_ways.py approach docs/figures

A column a way: the picture of one frame as people see it, then errors of heading, lateral deviation and height with the
stated 95 % intervals over the distance to the ramp. Lengths in runway widths count in true widths. Prints the table of
errors at 90 % of the frames that are 1 s and more into the track.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.flight import Flight, FrameResult
from deckline.geometry import Camera
from deckline.recording import open_recording
from deckline.report.annotators import LineAnnotator, NeedleAnnotator
from deckline.truth import range_to_ramp_m, true_guidance, true_width_m
from deckline.types import Frame
from deckline_lab.evaluation.picture_alone import NORMAL_95, QUANTITIES, PictureScore, score, without_pose

matplotlib.use("Agg")
from matplotlib import pyplot as plt

WAYS = ("with poses, width stated", "pictures alone, width stated", "pictures alone, nothing stated")
SHOWN = QUANTITIES[:3]
FULL_SCALE = (2.0, 6.0, 10.0)  # degrees, m, m
DPI = 110


@dataclass(frozen=True, eq=False)
class Way:
    """One way of flying the recording."""

    name: str
    scores: list[PictureScore]
    picture: NDArray[np.uint8]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--shown", type=float, default=0.85, help="share of the flight at which its picture is shown")
    given = parser.parse_args()
    ways = [fly(given.recording, name, given.shown) for name in WAYS]
    draw(ways, given.out / "three_ways.png")
    print("| way | ok | " + " | ".join(f"{name} at 90 %" for name in SHOWN) + " |")
    for way in ways:
        settled = [one for one in way.scores if one.age_s >= 1.0]
        ok = sum(one.status == "ok" for one in settled)
        if not settled:
            print(f"| {way.name} | no frame 1 s and more into a track |")
            continue
        worst = (np.percentile([abs(one.errors[name][0]) for one in settled], 90) for name in SHOWN)
        print(f"| {way.name} | {ok} of {len(settled)} | " + " | ".join(f"{value:.2f}" for value in worst) + " |")


def fly(recording: Path, name: str, shown: float) -> Way:
    """The recording flown in one of `WAYS`."""
    source = open_recording(recording)
    first = source.load(0)
    config, width_m = RunConfig(), true_width_m(first.truth)
    if width_m is None:
        raise ValueError(f"{recording}: no runway in its truth")
    if name != WAYS[2]:
        config = replace(config, deck=replace(config.deck, width_m=width_m))
    scores, picture = [], first.image_rgb
    with Flight.from_config(config) as flight:
        for index in range(len(source)):
            frame = source.load(index)
            truth = true_guidance(frame, config.approach)
            result = flight(as_flown(frame, name))
            if truth is not None:
                scores.append(score(result, truth, range_to_ramp_m(frame), width_m))
            if index == round(shown * (len(source) - 1)):
                picture = draw_result(result)
    return Way(name, scores, picture)


def as_flown(frame: Frame, name: str) -> Frame:
    """The frame with what is known of it in one of `WAYS`."""
    if name == WAYS[0]:
        return frame
    alone = without_pose(frame, 0.0, 0.0)
    return alone if name == WAYS[1] else replace(alone, camera=Camera.unknown(frame.camera.width, frame.camera.height))


def draw_result(result: FrameResult) -> NDArray[np.uint8]:
    """Its picture with lines and needles."""
    return NeedleAnnotator().annotate(LineAnnotator().annotate(result.frame.image_rgb, result), result)


def draw(ways: list[Way], path: Path) -> None:
    """The figure."""
    figure, axes = plt.subplots(1 + len(SHOWN), len(ways), figsize=(13.2, 11.0), height_ratios=(1.45, 1, 1, 1))
    for column, way in enumerate(ways):
        axes[0, column].imshow(way.picture)
        axes[0, column].set_title(way.name)
        axes[0, column].axis("off")
        for row, (name, scale) in enumerate(zip(SHOWN, FULL_SCALE, strict=True), 1):
            known = [one for one in way.scores if name in one.errors]
            if not known:
                continue
            ranges, errors, sigmas = np.array([(one.range_m, *one.errors[name]) for one in known]).T
            place = axes[row, column]
            place.fill_between(ranges, -NORMAL_95 * sigmas, NORMAL_95 * sigmas, color="#3b82f6", alpha=0.2, linewidth=0)
            place.plot(ranges, errors, color="#1d4ed8", linewidth=1.4)
            place.axhline(0.0, color="#6b7280", linewidth=0.6)
            place.set_ylim(-scale, scale)
            place.set_xlim(max(ranges), 0)
            place.grid(alpha=0.25)
            if column == 0:
                place.set_ylabel(f"error of {name}")
            if row == len(SHOWN):
                place.set_xlabel("distance to the ramp, m")
    figure.tight_layout()
    figure.savefig(path, dpi=DPI)


if __name__ == "__main__":
    main()
