"""Dehazing in linear light, of haze that adds light."""

import numpy as np

from deckline.dehaze import GeometryDehazer
from deckline.dehaze.pixel_map import display_levels, linear_levels
from deckline.haze import beta_from_visibility
from deckline_lab.evaluation.metrics import psnr_db
from deckline_lab.rivals.linear_light import LinearGeometryDehazer
from dehaze.sea_scene import AIRLIGHT, frame_of, ray_z, sea_pair, world_from_body


def test_haze_that_adds_light_is_taken_away_as_light() -> None:
    _, clear = sea_pair(0.0)
    down = ray_z(world_from_body())
    t = np.where(down > 0, np.exp(-beta_from_visibility(1200.0) * 60 / np.maximum(down, 1e-9)), 0)[..., None]
    light, airlight = linear_levels(clear), linear_levels(AIRLIGHT)
    hazy = np.rint(display_levels(airlight + t * (light - airlight))).astype(np.uint8)
    near = down > 60 / 1000
    display, linear = (
        psnr_db(dehazer.restore(frame_of(hazy)).image_rgb, clear, near)
        for dehazer in (GeometryDehazer(), LinearGeometryDehazer())
    )
    assert linear > 26
    assert linear > display + 3
