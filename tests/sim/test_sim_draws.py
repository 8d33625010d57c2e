"""What the presets draw: counts and means over many seeds, as they were once compared with the documented ranges."""

from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from deckline.geometry import Camera, camera_mount
from deckline_sim.camera.exposure import draw_exposure
from deckline_sim.camera.imaging import draw_air
from deckline_sim.camera.lens import random_lens
from deckline_sim.camera.sensor import draw_sensor
from deckline_sim.config import AirConfig, ExposureConfig, LensConfig, SensorConfig
from deckline_sim.scene.weather import random_weather
from deckline_sim.ship.layout import random_layout
from deckline_sim.ship.random_plan import random_plan, random_surface
from deckline_sim.ship.ship import build_ship
from golden import check_golden

CAMERA = Camera.from_fov(640, 360, 1.0)
VELOCITY, SUN, HORIZON = np.array([60.0, 2.0, 3.0]), np.array([0.6, 0.0, 0.8]), np.array([0.6, 0.7, 0.8])
STEADY = np.zeros(3)


def draw_plan(runway, rng):
    """What is painted on a random deck: the kinds of its edges, and how many of each other part."""
    layout = random_layout(rng)
    plan = random_plan(layout, runway, rng)
    parts = ("wires_m", "fouls", "catapults", "panels", "spots", "stripes", "numbers")
    centre = None if plan.centre is None else f"{len(plan.centre.rgbs)} colours, gaps {plan.centre.gap_m > 0}"
    return {
        "on_land": layout.on_land,
        "edge": plan.edge.kind,
        "uneven": plan.right_edge is not None,
        "centre": centre,
        "surface_rgb": random_surface(rng).rgb,
        **{part: len(getattr(plan, part)) for part in parts},
    }


def draw_ship(rng):
    """Sizes of a random ship and of what lies around it."""
    ship = build_ship("train", rng)
    return {
        "runway": ship.runway,
        "runway_on_land": ship.runway and ship.layout.on_land,
        "length_m": ship.layout.length_m,
        "solids_m": float(np.ptp(ship.solids[:, 2])),
        "triangles": len(ship.solids) // 3,
        "alone": len(ship.background) == 0,
    }


DRAWS = {
    "weather": (80, lambda rng: asdict(random_weather(rng))),
    "fair weather": (40, lambda rng: asdict(random_weather(rng, fair=True))),
    "exposure": (
        400,
        lambda rng: asdict(draw_exposure(ExposureConfig(), CAMERA, camera_mount(), VELOCITY, STEADY, rng, rng, True)),
    ),
    "still exposure": (
        2,
        lambda rng: asdict(draw_exposure(ExposureConfig(), CAMERA, camera_mount(), VELOCITY, STEADY, rng, rng, False)),
    ),
    "air": (80, lambda rng: asdict(draw_air(AirConfig(), 2000.0, 0.0, HORIZON, SUN, 0.0, rng, True))),
    "lens": (60, lambda rng: vars(random_lens(LensConfig(), CAMERA, rng, wide=True))),
    "plain lens": (2, lambda rng: vars(random_lens(LensConfig(), CAMERA, rng, wide=False))),
    **{
        f"sensor of strength {strength}": (
            100,
            lambda rng, strength=strength: asdict(draw_sensor(SensorConfig(), strength, 0.2, rng)),
        )
        for strength in (0.15, 1.0)
    },
    "plan": (300, lambda rng: draw_plan(True, rng)),
    "plan without runway": (150, lambda rng: draw_plan(False, rng)),
    "ship": (80, draw_ship),
}


def summarize(values):
    """Words: how many values there are of each kind; of numbers the least, the mean and the greatest."""
    is_number = [isinstance(value, int | float) and not isinstance(value, bool) for value in values]
    numbers = [value for value, one in zip(values, is_number, strict=True) if one]
    plain = ["numbers" if one else str(value) for value, one in zip(values, is_number, strict=True)]
    if all(isinstance(value, tuple) for value in values):
        plain = [f"{len(value)} values" for value in values]
        numbers = [number for value in values for number in np.ravel(value)]
    counts = ", ".join(f"{kind}: {count}" for kind, count in sorted(Counter(plain).items()))
    return counts + (f"; {np.min(numbers):.9g} {np.mean(numbers):.9g} {np.max(numbers):.9g}" if numbers else "")


@pytest.mark.parametrize("name", DRAWS)
def test_draws_are_those_that_were_checked(name):
    count, draw = DRAWS[name]
    drawn = [draw(np.random.default_rng(seed)) for seed in range(count)]
    found = {key: summarize([one[key] for one in drawn]) for key in drawn[0] if not key.endswith("seed")}
    check_golden(Path(__file__).parent / "golden" / f"draws_{name.replace(' ', '_')}.json", found)
