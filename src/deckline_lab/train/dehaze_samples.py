"""Hazy pairs to train dehazers on. Haze is drawn anew each time a clear view is used, so that no two epochs repeat;
recorded pairs retain their haze.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation
from torch import Tensor

from deckline.checks import check_numbers
from deckline.dehaze.by_pose import GeometryDehazer
from deckline.dehaze.pixel_map import display_levels, linear_levels
from deckline.dehaze.tensors import image_to_tensor
from deckline.dehaze.veil import VeilDehazer
from deckline.geometry import Camera
from deckline.haze import add_haze, air_path, beta_from_visibility, scatter, transmission, world_rays
from deckline.types import Frame
from deckline_lab.datasets.tiles import tile_corners
from deckline_lab.train.airlight import random_airlight
from deckline_lab.train.clear_views import ClearView
from deckline_lab.train.pair_views import PairView
from deckline_lab.train.photographs import add_camera_air
from deckline_lab.train.view_sets import Views
from deckline_sim.camera.imaging import draw_air
from deckline_sim.config import AirConfig

SUN_ELEVATION_DEG = (5.0, 70.0)
GLOW_MEAN, GLOW_MOST = 0.5, 1.5  # exponential; more would want another exposure than the clear picture's
# What a pose is wrong by when the sea's range is taken from it: a good navigation unit's attitude, and its height
# together with that of the ship's deck above the water.
ATTITUDE_SIGMA_RAD, SEA_SIGMA_M = np.deg2rad(0.2), 1.0


@dataclass(frozen=True)
class HazeAugmentation:
    """What haze training images get."""

    visibility_m: tuple[float, float] = (250.0, 4000.0)  # 2 % contrast, log-uniform
    clear_share: float = 0.06  # of the images get next to no haze, so that clear images come out untouched
    clear_visibility_m: tuple[float, float] = (20000.0, 200000.0)  # log-uniform
    physical_share: float = 0.0  # of the images: haze in linear light with height, patches and colour, where a pose is
    recorded_share: float = 0.0  # of the images have the haze that they were recorded in, where there is one
    prior_share: float = 0.5  # of the images come with the geometry dehazer's picture, for networks that take one
    photograph_share: float = 0.35  # of the images are photographs, where there are some
    camera_share: float = 0.0  # of the others also get the camera model of photographs: air of no known law, tone, wear
    veil_share: float = 0.8  # of those come with what `veil` makes of them, for networks that take a prior
    horizon_share: float = 0.8  # of the airlights are near the sky's colour at the horizon, the others random
    exact_share: float = 0.5  # of those are the horizon's colour itself, as Koschmieder's law has it for one light
    noise_share: float = 0.3  # of the hazy images get sensor noise
    noise_max: float = 2.0  # its largest 1-sigma, grey levels
    crop_scale: tuple[float, float] = (0.75, 1.25)  # size of the window a crop is resized from, relative to the crop
    flip_horizontal: float = 0.5  # probability
    flip_vertical: float = 0.0  # the paper flips with 0.5; aircraft that see a deck from above do not

    def __post_init__(self) -> None:
        for name in ("visibility_m", "clear_visibility_m", "crop_scale"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be 0 < low <= high, got {low} and {high}")
        shares = [name for name in vars(self) if name.endswith("_share") or name.startswith("flip_")]
        check_numbers(self, "", *shares, least=0, most=1)


def add_random_haze(
    view: ClearView | PairView, haze: HazeAugmentation, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A view (H, W, 3) in random haze with noise, and its transmission (H, W); a pair's haze is its own, and its
    transmission counts as 1.
    """
    if isinstance(view, PairView):
        return add_random_noise(view.hazy_rgb, haze, rng), np.ones(view.hazy_rgb.shape[:2], np.float32)
    if view.hazy_rgb is not None and haze.recorded_share and rng.random() < haze.recorded_share:
        return view.hazy_rgb, transmission(view.range_m, beta_from_visibility(view.visibility_m))
    visibility_m = random_visibility(haze, rng)
    if view.world_from_camera is not None and rng.random() < haze.physical_share:
        hazy, t = add_physical_haze(view, visibility_m, random_airlight(view.horizon_rgb, 1.0, rng, 1.0), rng)
    else:
        airlight = random_airlight(view.horizon_rgb, haze.horizon_share, rng, haze.exact_share)
        beta = beta_from_visibility(visibility_m)
        hazy, t = add_haze(view.clear_rgb, view.range_m, beta, airlight), transmission(view.range_m, beta)
    return add_random_noise(hazy, haze, rng), t


def random_visibility(haze: HazeAugmentation, rng: np.random.Generator) -> float:
    """2 % contrast, m; at times that of next to no haze."""
    limits = haze.clear_visibility_m if rng.random() < haze.clear_share else haze.visibility_m
    return float(np.exp(rng.uniform(*np.log(limits))))


def add_random_noise(
    hazy_rgb: NDArray[np.uint8], haze: HazeAugmentation, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """A picture (H, W, 3), in the share of all that get it with sensor noise."""
    if rng.random() >= haze.noise_share:
        return hazy_rgb
    noise = rng.standard_normal(hazy_rgb.shape, dtype=np.float32) * rng.uniform(0, haze.noise_max)
    return np.clip(np.rint(hazy_rgb + noise), 0, 255).astype(np.uint8)


def add_physical_haze(
    view: ClearView, visibility_m: float, horizon_rgb: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """A view (H, W, 3) in air drawn as the simulator draws it, light taken as sRGB's; and the transmission (H, W)."""
    if view.world_from_camera is None:
        raise ValueError("haze that varies with height needs the view's pose")
    air = draw_air(
        AirConfig(model="physical", glow=min(rng.exponential(GLOW_MEAN), GLOW_MOST)),
        visibility_m,
        0.0,
        linear_levels(horizon_rgb) / 255,
        _random_sun(rng),
        view.sea_z_m,
        rng,
        wide=True,
    )
    directions, _ = world_rays(_rays(view.camera), view.world_from_camera.rotation.as_matrix())
    ranges, eye = view.range_m.astype(np.float32), view.world_from_camera.translation
    clear = (linear_levels(np.arange(256)) / np.float32(255))[view.clear_rgb]
    with np.errstate(over="ignore"):  # a pixel at a distorted lens's border may lie far below the sea: all haze
        light = scatter(clear, ranges, directions, eye, air)
        t = np.exp(-air_path(ranges, directions, eye, air) * np.float32(air.extinction_per_m[1]))
    return np.clip(np.rint(display_levels(255 * light)), 0, 255).astype(np.uint8), t


def geometry_prior(
    view: ClearView | PairView, hazy_rgb: NDArray[np.uint8], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """What the geometry dehazer makes of a view's hazy picture (H, W, 3) with a pose as wrong as they are in flight.

    The picture itself where the view has no pose or the dehazer leaves it alone.
    """
    if isinstance(view, PairView) or view.world_from_camera is None or view.deck_z_m is None:
        return hazy_rgb
    pose = view.world_from_camera
    turned = Rotation.from_rotvec(rng.normal(0, ATTITUDE_SIGMA_RAD, 3)) * pose.rotation
    sea_z_m = max(view.sea_z_m + rng.normal(0, SEA_SIGMA_M), view.deck_z_m)
    frame = Frame(
        file="",
        time_s=0.0,
        image_rgb=hazy_rgb,
        camera=view.camera,
        body_from_camera=RigidTransform.identity(),
        world_from_body=RigidTransform.from_components(pose.translation, turned),
        deck_z_m=view.deck_z_m,
        sea_z_m=sea_z_m,
    )
    return GeometryDehazer().restore(frame).image_rgb


def make_pair(
    view: ClearView | PairView,
    window: tuple[slice, slice],
    haze: HazeAugmentation,
    rng: np.random.Generator,
    prior: bool = False,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32], NDArray[np.uint8]]:
    """One window of a view, flipped at random.

    Returns:
        Hazy and clear (h, w, 3), transmission (h, w), and the picture (h, w, 3) that a network with a prior starts
        from: the geometry dehazer's, that of `veil`, or the hazy one again, which it is without `prior`.
    """
    clear = view.clear_rgb
    is_photograph = isinstance(view, ClearView) and not view.camera.known
    if isinstance(view, ClearView) and (is_photograph or (haze.camera_share and rng.random() < haze.camera_share)):
        visibility_m, airlight = random_visibility(haze, rng), random_airlight(view.horizon_rgb, 0.5, rng, 0.5)
        hazy, clear, t = add_camera_air(view, visibility_m, airlight, rng)
        prior_rgb = VeilDehazer()(hazy) if prior and rng.random() < haze.veil_share else hazy
    else:
        hazy, t = add_random_haze(view, haze, rng)
        prior_rgb = geometry_prior(view, hazy, rng) if prior and rng.random() < haze.prior_share else hazy
    flip = tuple(slice(None, None, -1 if rng.random() < p else 1) for p in (haze.flip_vertical, haze.flip_horizontal))
    return hazy[window][flip], clear[window][flip], t[window][flip], prior_rgb[window][flip]


def random_window(
    size: tuple[int, int], crop: tuple[int, int], scale: tuple[float, float], rng: np.random.Generator
) -> tuple[slice, slice]:
    """Where in an image of `size` (H, W) a crop (h, w) is taken from: `scale` times its size, made to fit."""
    fit = min(size[0] / crop[0], size[1] / crop[1])
    factor = min(rng.uniform(*scale), fit)
    height, width = (min(round(side * factor), limit) for side, limit in zip(crop, size, strict=True))
    top, left = rng.integers(0, size[0] - height + 1), rng.integers(0, size[1] - width + 1)
    return slice(top, top + height), slice(left, left + width)


def random_tile(size: tuple[int, int], tile_px: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """One of the paper's eight squares of an image of `size` (H, W), its side `tile_px`."""
    corners = tile_corners(size[1], size[0], tile_px)
    left, top = corners[rng.integers(0, len(corners))]
    return slice(top, top + tile_px), slice(left, left + tile_px)


def make_batch(
    views: Views[ClearView | PairView],
    batch: int,
    crop: tuple[int, int],
    haze: HazeAugmentation,
    seed: list[int],
    prior: bool,
    photographs: Views[ClearView] | None = None,
    sub_images: bool = False,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Hazy and clear (batch, 3, h, w) in 0..1, transmission (batch, 1, h, w), and the picture (batch, 3, h, w) that a
    network with a prior starts from. The same for the same seed, so a resumed run sees what it would have seen.
    With `sub_images` the crops, square ones, are the paper's eight of a picture; else they lie anywhere.
    """
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(batch):
        is_photograph = photographs is not None and rng.random() < haze.photograph_share
        view = photographs.draw(rng) if photographs is not None and is_photograph else views.draw(rng)
        size = view.clear_rgb.shape[:2]
        window = random_tile(size, crop[0], rng) if sub_images else random_window(size, crop, haze.crop_scale, rng)
        hazy, clear, t, prior_rgb = make_pair(view, window, haze, rng, prior)
        pictures = [image_to_tensor(image) for image in (hazy, clear, prior_rgb)]
        sample = torch.from_numpy(np.concatenate([*pictures, np.ascontiguousarray(t)[None, None]], axis=1))
        if sample.shape[2:] != crop:
            sample = F.interpolate(sample, crop, mode="bilinear", antialias=True, align_corners=False)
        samples.append(sample)
    stacked = torch.cat(samples)
    return stacked[:, :3], stacked[:, 3:6], stacked[:, 9:], stacked[:, 6:9]


def _random_sun(rng: np.random.Generator) -> NDArray[np.float64]:
    """Unit vector (3,) from the sun to the ground, world z down."""
    elevation, azimuth = np.deg2rad(rng.uniform(*SUN_ELEVATION_DEG)), rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


@lru_cache(maxsize=64)
def _rays(camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) of every pixel in the optical frame; straight ahead where none reaches a pixel."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(camera.height, camera.width, 3)
    return np.where(np.isfinite(rays), rays, [0.0, 0.0, 1.0]).astype(np.float32)
