"""The joint fit against the paper's: time as a ratio, and by range its efficiency against the Cramer-Rao bound.

    python benchmarks/localize.py [--draws 200] [--repeats 30]

Lines of a runway are projected exactly; every draw adds the noise that the configuration states: of pixels, pose,
camera, depth and deck height. No pictures. Efficiency is bound over mean squared error of the centre line, seen from
the aircraft, at the ramp; NEES is the mean normalised squared error of three numbers, with the 95 % band of that mean.
"""

import argparse
import os
import platform
import statistics
import time
from dataclasses import replace
from datetime import date

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from deckline.config import Deck, FrameNoise, Localization, Mode, RunConfig
from deckline.geometry import Camera, attitude, camera_mount, intersect_plane, wrap_angle
from deckline.localize import localize
from deckline.localize.depth import select_independent
from deckline.types import SIDES, Detection, Frame, LinePoints, RunwayLine
from deckline_lab.evaluation.cramer_rao import cramer_rao
from deckline_lab.rivals.sgd import localize_by_descent

CAMERA = Camera.from_fov(1280, 720, float(np.deg2rad(90.0)))
LENGTH_M, WIDTH_M, GLIDE = 220.0, 14.7, float(np.tan(np.deg2rad(3.5)))
DEPTH_RANGE_M = 400.0
RANGES_M = (60.0, 100.0, 150.0, 300.0, 500.0, 800.0)
FINE_RANGE_M = 150.0
WEATHERS = {"clear": (0.3, 24), "haze": (1.0, 12)}  # 1-sigma of a point, px, and points a line
METHODS = {"joint": localize, "paper": localize_by_descent}
STILL = RunConfig(deck=Deck(sea_state=0.0, slope_deg=0.0))
PARALLEL = replace(STILL, deck=replace(STILL.deck, angle_sigma_deg=1e-9))


def make_scene(weather: str, mode: Mode, range_m: float) -> tuple[Frame, Detection]:
    """The exact frame, landing along world x with the ramp at the origin, and exact points."""
    pose = RigidTransform.from_components([-range_m, 3.0, -(4.0 + GLIDE * range_m)], attitude(0.03, -0.06, 0.02))
    frame = Frame("drawn", 0.0, np.zeros((720, 1280, 3), np.uint8), CAMERA, camera_mount(), None, pose, 0.0)
    camera = frame.world_from_camera
    if mode == "fine":
        v, u = np.mgrid[0:720, 0:1280]
        rays = CAMERA.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
        hits = intersect_plane(camera.translation, camera.rotation.apply(rays), 0.0)
        depth = camera.inv().apply(hits)[:, 2].reshape(v.shape)
        frame = replace(frame, depth_m=np.where(depth < DEPTH_RANGE_M, depth, np.nan).astype(np.float32))
    sigma_px, count = WEATHERS[weather]
    lines = []
    for offset in (-WIDTH_M / 2, WIDTH_M / 2):
        ground = np.column_stack([np.linspace(0, LENGTH_M, 4000), np.full(4000, offset), np.zeros(4000)])
        pixels = CAMERA.project(camera.inv().apply(ground))
        rows = np.linspace(pixels[0, 1], pixels[-1, 1], count)
        chosen = pixels[np.searchsorted(-pixels[:, 1], -rows).clip(0, 3999)]
        lines.append(LinePoints(chosen, np.full(count, 0.9), np.full(count, sigma_px)))
    return frame, Detection(*lines)


def add_noise(
    frame: Frame, exact: Detection, noise: FrameNoise, rng: np.random.Generator
) -> tuple[Frame, Detection, float]:
    """The frame and the points as an imperfect aircraft measures them, and its heading error, rad."""
    turn, shift = rng.normal(0, noise.attitude_rad, 3), rng.normal(0, noise.position_m, 3)
    pose, zoom = frame.world_from_body, 1 + rng.normal(0, noise.focal_fraction)
    wrong = RigidTransform.from_components(pose.translation + shift, Rotation.from_rotvec(turn) * pose.rotation)
    depth = None if frame.depth_m is None else frame.depth_m * np.float32(1 + rng.normal(0, noise.depth_scale))
    lines = []
    for points in (exact.left, exact.right):
        px = points.points_px + np.column_stack([rng.normal(0, points.sigma_px), np.zeros(len(points))])
        lines.append(replace(points, points_px=px))
        if depth is not None:
            for u, v in np.rint(px[select_independent(px, np.ones(len(px), dtype=bool))]).astype(int):
                depth[v - 1 : v + 2, u - 1 : u + 2] *= 1 + rng.normal(0, noise.depth_fraction)
    camera = replace(frame.camera, fx=frame.camera.fx * zoom, fy=frame.camera.fy * zoom)
    deck_z_m = float(rng.normal(0, noise.deck_z_m))
    noisy = replace(frame, camera=camera, depth_m=depth, world_from_body=wrong, deck_z_m=deck_z_m)
    return noisy, Detection(*lines), float(turn[2])


def error_at_ramp(line: RunwayLine, noisy: Frame, frame: Frame, turn_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Error (3,) of a line at the ramp, seen from the aircraft, and its covariance there."""
    offset = Rotation.from_euler("z", -turn_rad).apply(line.point_m - noisy.world_from_body.translation)
    point = frame.world_from_body.translation + offset
    azimuth = float(wrap_angle(line.azimuth_rad - turn_rad))
    lever = np.array([[1.0, -point[0], 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    error = np.array([point[1] - point[0] * np.tan(azimuth), azimuth, point[2]])
    return error, lever @ line.relative_covariance @ lever.T


def measure(weather: str, mode: Mode, range_m: float, draws: int, rng: np.random.Generator) -> str:
    """One line of the table."""
    frame, exact = make_scene(weather, mode, range_m)
    config = replace(PARALLEL, localization=Localization(mode))
    points = {side: getattr(exact, side).points_px for side in SIDES}
    sigmas = {side: getattr(exact, side).sigma_px for side in SIDES}
    bound = np.diag(cramer_rao(frame, points, sigmas, mode, config, np.zeros(3), relative=True).centre)
    errors, scores = [], []
    for _ in range(draws):
        noisy, found, turn_rad = add_noise(frame, exact, config.noise, rng)
        centre = localize(noisy, found, config, rng).lines.get("centre")
        if centre is not None:
            error, covariance = error_at_ramp(centre, noisy, frame, turn_rad)
            errors.append(error)
            scores.append(error @ np.linalg.solve(covariance, error))
    efficiency = bound / np.mean(np.square(errors), axis=0)
    low, high = chi2.ppf([0.025, 0.975], 3 * len(scores)) / len(scores)
    numbers = (*(np.sqrt(bound) * [1.0, np.rad2deg(1.0), 1.0]), *efficiency)
    row = "".join(f" {number:8.{3 if k < 3 else 2}f}" for k, number in enumerate(numbers))
    nees = f"{np.mean(scores):7.2f} ({low:.2f}-{high:.2f})"
    return f"{weather:6} {mode:7} {range_m:6.0f}{row} {nees} {len(errors)}/{draws}"


def time_methods(repeats: int) -> dict[str, float]:
    """Median CPU time, s, of each method on the same noisy frame, in turns."""
    rng = np.random.default_rng(0)
    noisy, found, _ = add_noise(*make_scene("clear", "fine", 100.0), STILL.noise, rng)
    times: dict[str, list[float]] = {method: [] for method in METHODS}
    for _ in range(repeats + 1):
        for method, localizer in METHODS.items():
            start = time.process_time()
            localizer(noisy, found, STILL, rng)
            times[method].append(time.process_time() - start)
    return {method: statistics.median(values[1:]) for method, values in times.items()}


def main(draws: int, repeats: int) -> None:
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    seconds = time_methods(repeats)
    for method, value in seconds.items():
        ratio = value / seconds["paper"]
        print(f"{method:6} {1e3 * value:7.1f} ms a frame, {ratio:.3f} of the paper's method", flush=True)
    print(f"{'':21} {'bound, 1-sigma':^26} {'efficiency':^26}")
    print(f"{'':6} {'mode':7} {'m':>6} {'m':>8} {'deg':>8} {'z m':>8} {'m':>8} {'deg':>8} {'z m':>8}    NEES")
    rng = np.random.default_rng(1)
    for weather in WEATHERS:
        for range_m in RANGES_M:
            modes: tuple[Mode, ...] = ("fine", "coarse") if range_m <= FINE_RANGE_M else ("coarse",)
            for mode in modes:
                print(measure(weather, mode, range_m, draws, rng), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=30)
    arguments = parser.parse_args()
    main(arguments.draws, arguments.repeats)
