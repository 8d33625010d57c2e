"""Flights of frames that are wrong in every way at once: an answer to each, and no `ok` beyond its protection level."""

from dataclasses import replace

import numpy as np
import pytest

from deckline.config import Deck, Localization, RunConfig, Tracking
from deckline.dehaze.base import IdentityDehazer
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.types import Detection, Frame, LinePoints, Status
from runway_scene import DECK_Z_M, LEFT, PARALLEL_RIGHT, WIDTH_M, approach, keep, line_points, with_depth

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")
CAMERA = Camera.from_fov(320, 180, np.deg2rad(90))
FLIGHTS, FRAMES = 16, 40


class Scripted:
    """A detector that gives the points it was handed."""

    name = "scripted"
    given: Detection

    def __call__(self, image_rgb: np.ndarray, box=None) -> Detection:
        return self.given


def corrupt(points: LinePoints, rng: np.random.Generator) -> LinePoints:
    """The points of a line: gone, few, of any sigma, anywhere, beside it, in one row, in one place, or a little off."""
    pixels, count = points.points_px.copy(), len(points)
    match int(rng.integers(9)):
        case 0:
            return LinePoints.empty()
        case 1:
            return keep(points, rng.random(count) < rng.random())
        case 2:
            return replace(points, sigma_px=np.full(count, rng.choice([1e-6, 30.0, 1e3])))
        case 3:
            pixels = rng.uniform(0, [CAMERA.width, CAMERA.height], (count, 2))
        case 4:
            pixels[:, 0] += rng.normal(0, 10)
        case 5:
            pixels[:, 1] = pixels[:1, 1]
        case 6:
            pixels[:] = pixels[:1]
        case _:
            pixels[:, 0] += rng.normal(0, 0.3, count)
    return replace(points, points_px=pixels)


def take_away(frame: Frame, rng: np.random.Generator) -> Frame:
    """The frame, often without pose or deck height, with depth in parts, or a deck height that is wrong."""
    if rng.random() < 0.5:
        depth_m = with_depth(frame, rng.choice([5.0, 60.0, 400.0])).depth_m
        holes = rng.random(depth_m.shape) < rng.choice([0.0, 0.3, 0.95])
        frame = replace(frame, depth_m=np.where(holes, np.float32(rng.choice([np.nan, 0.0, -1.0, np.inf])), depth_m))
    if rng.random() < 0.05:
        frame = replace(frame, world_from_body=None)
    if rng.random() < 0.05:
        frame = replace(frame, deck_z_m=rng.choice([None, DECK_Z_M + rng.normal(0, 50)]))
    return frame


@pytest.mark.parametrize("seed", range(FLIGHTS))
def test_every_frame_is_answered_and_no_ok_misleads(seed):
    """Points, depth, poses, heights and times; tracked and single frames, in every depth mode."""
    rng = np.random.default_rng(seed)
    config = RunConfig(
        localization=Localization(("auto", "auto", "coarse", "fine")[seed % 4]),
        deck=Deck(sea_state=0.0, slope_deg=0.0, width_m=(None, WIDTH_M)[seed % 2]),
        tracking=Tracking(enabled=seed % 5 > 0),
    )
    detector = Scripted()
    time_s, range_m, right_m, share = 0.0, rng.uniform(200, 400), rng.normal(0, 3), rng.uniform(0, 0.3)
    with Flight(config, IdentityDehazer(), detector) as flight:
        for _ in range(FRAMES):
            time_s += rng.choice([0.1, 2.0, 0.0, -1.0], p=[0.97, 0.01, 0.01, 0.01])
            range_m = max(range_m - 6.5, 10.0)
            turns = rng.normal([0.0, -0.05, 0.03], 0.01)
            true = approach(range_m, 1.0 + 0.07 * range_m, right_m, *turns, camera=CAMERA, right=PARALLEL_RIGHT)
            lines = [line_points(true, side, 30, 0.3) for side in (LEFT, PARALLEL_RIGHT)]
            detector.given = Detection(*(corrupt(line, rng) if rng.random() < share else line for line in lines))
            shown = take_away(replace(true, time_s=time_s, file=f"{time_s:.3f}.png"), rng)
            guidance = flight(shown).guidance
            if guidance.status is Status.OK:
                assert abs(guidance.lateral_deviation_m.value - right_m) < guidance.protection.lateral_m
