"""The joint fit against the paper's: time as a ratio, and by range how near it comes to the Cramer-Rao bound.

    python benchmarks/localize.py [--draws 200] [--repeats 30]

Lines of a runway are projected exactly; every draw adds the noise that the settings state: of pixels, pose, camera,
depth and deck height. No pictures. Efficiency is bound over mean squared error of the centre line, seen from the
aircraft, at the ramp; NEES is the mean normalised error squared of three numbers, with the 95 % band of that mean.
"""

import argparse
import os
import platform
import statistics
import time
from dataclasses import dataclass, replace
from datetime import date

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from deckline.evaluation.cramer_rao import cramer_rao
from deckline.geometry import Camera, attitude, camera_mount, intersect_plane, wrap_angle
from deckline.localize import AgreementConfig, LocalizeConfig, NoiseConfig, localize
from deckline.localize.depth import independent
from deckline.types import SIDES, Detection, Frame, LinePoints, RunwayLine

CAMERA = Camera.from_fov(1280, 720, float(np.deg2rad(90.0)))
LENGTH_M, WIDTH_M, GLIDE = 220.0, 14.7, float(np.tan(np.deg2rad(3.5)))
DEPTH_REACH_M = 400.0
PATCH = 1  # px about a point whose depth errs alike
RANGES_M = (60.0, 100.0, 150.0, 300.0, 500.0, 800.0)
FINE_TO_M = 150.0
WEATHERS = {"clear": (0.3, 24), "haze": (1.0, 12)}  # 1-sigma of a point, px, and points a line
METHODS = ("joint", "paper")


@dataclass(frozen=True)
class Case:
    """One view to draw measurements of."""

    weather: str
    mode: str
    range_m: float


def view(case: Case) -> tuple[Frame, Detection]:
    """The exact frame, landing along world x with the ramp at the origin, and exact points."""
    position = [-case.range_m, 3.0, -(4.0 + GLIDE * case.range_m)]
    pose = RigidTransform.from_components(position, attitude(0.03, -0.06, 0.02))
    frame = Frame("drawn", 0.0, np.zeros((720, 1280, 3), np.uint8), CAMERA, camera_mount(), None, pose, 0.0)
    if case.mode == "fine":
        v, u = np.mgrid[0:720, 0:1280]
        rays = CAMERA.rays(np.column_stack([u.ravel(), v.ravel()]).astype(float))
        camera = frame.world_from_camera
        hits = intersect_plane(camera.translation, camera.rotation.apply(rays), 0.0)
        depth = camera.inv().apply(hits)[:, 2].reshape(v.shape)
        frame = replace(frame, depth_m=np.where(depth < DEPTH_REACH_M, depth, np.nan).astype(np.float32))
    sigma_px, count = WEATHERS[case.weather]
    lines = []
    for offset in (-WIDTH_M / 2, WIDTH_M / 2):
        ground = np.column_stack([np.linspace(0, LENGTH_M, 4000), np.full(4000, offset), np.zeros(4000)])
        pixels = CAMERA.project(frame.world_from_camera.inv().apply(ground))
        rows = np.linspace(pixels[0, 1], pixels[-1, 1], count)
        chosen = pixels[np.searchsorted(-pixels[:, 1], -rows).clip(0, 3999)]
        lines.append(LinePoints(chosen, np.full(count, 0.9), np.full(count, sigma_px)))
    return frame, Detection(*lines)


def measured(
    frame: Frame, exact: Detection, noise: NoiseConfig, rng: np.random.Generator
) -> tuple[Frame, Detection, float]:
    """The view as an imperfect aircraft sees it, and its error of heading, rad."""
    turn = rng.normal(0, noise.attitude_rad, 3)
    pose = frame.world_from_body
    shift = rng.normal(0, noise.position_m, 3)
    wrong = RigidTransform.from_components(pose.translation + shift, Rotation.from_rotvec(turn) * pose.rotation)
    zoom = 1 + rng.normal(0, noise.focal_fraction)
    depth = None if frame.depth_m is None else frame.depth_m * np.float32(1 + rng.normal(0, noise.depth_scale))
    lines = []
    for points in (exact.left, exact.right):
        px = points.points_px + np.column_stack([rng.normal(0, points.sigma_px), np.zeros(len(points))])
        lines.append(LinePoints(px, points.confidence, points.sigma_px))
        if depth is not None:
            for u, v in np.rint(px[independent(px, np.ones(len(px), dtype=bool))]).astype(int):
                patch = (slice(v - PATCH, v + PATCH + 1), slice(u - PATCH, u + PATCH + 1))
                depth[patch] *= 1 + rng.normal(0, noise.depth_fraction)
    camera = replace(frame.camera, fx=frame.camera.fx * zoom, fy=frame.camera.fy * zoom)
    deck = float(rng.normal(0, noise.deck_z_m))
    seen = replace(frame, camera=camera, depth_m=depth, world_from_body=wrong, deck_z_m=deck)
    return seen, Detection(*lines), float(turn[2])


def error(line: RunwayLine, seen: Frame, frame: Frame, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Error (3,) of a line beside the ramp as seen from the aircraft, and its covariance there."""
    back = Rotation.from_euler("z", -turn).apply(line.point_m - seen.world_from_body.translation)
    point = frame.world_from_body.translation + back
    azimuth = float(wrap_angle(line.azimuth_rad - turn))
    lever = np.array([[1.0, -point[0], 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = line.covariance if line.relative_covariance is None else line.relative_covariance
    return np.array([point[1] - point[0] * np.tan(azimuth), azimuth, point[2]]), lever @ covariance @ lever.T


def row(case: Case, draws: int, rng: np.random.Generator) -> str:
    """One line of the table."""
    frame, exact = view(case)
    config = LocalizeConfig(mode=case.mode, agreement=AgreementConfig(parallel_rad=0.0))
    points = {side: getattr(exact, side).points_px for side in SIDES}
    sigmas = {side: getattr(exact, side).sigma_px for side in SIDES}
    bound = np.diag(cramer_rao(frame, points, sigmas, case.mode, config, np.zeros(3), relative=True).centre)
    errors, scores = [], []
    for _ in range(draws):
        seen, found, turn = measured(frame, exact, config.noise, rng)
        centre = localize(seen, found, config, rng).lines.get("centre")
        if centre is not None:
            off, covariance = error(centre, seen, frame, turn)
            errors.append(off)
            scores.append(off @ np.linalg.solve(covariance, off))
    efficiency = bound / np.mean(np.square(errors), axis=0)
    low, high = chi2.ppf([0.025, 0.975], 3 * len(scores)) / len(scores)
    least = np.sqrt(bound) * [1.0, np.rad2deg(1.0), 1.0]
    return (
        f"{case.weather:6} {case.mode:7} {case.range_m:6.0f} {least[0]:8.3f} {least[1]:8.3f} {least[2]:8.3f}"
        f" {efficiency[0]:8.2f} {efficiency[1]:8.2f} {efficiency[2]:8.2f} {np.mean(scores):7.2f} ({low:.2f}-{high:.2f})"
        f" {len(errors)}/{draws}"
    )


def seconds_a_frame(repeats: int) -> dict[str, float]:
    """Median CPU time of each method on the same noisy frame, in turns."""
    frame, exact = view(Case("clear", "fine", 100.0))
    rng = np.random.default_rng(0)
    seen, found, _ = measured(frame, exact, NoiseConfig(), rng)
    times: dict[str, list[float]] = {method: [] for method in METHODS}
    for _ in range(repeats + 1):
        for method in METHODS:
            start = time.process_time()
            localize(seen, found, LocalizeConfig(method=method), rng)
            times[method].append(time.process_time() - start)
    return {method: statistics.median(values[1:]) for method, values in times.items()}


def main(draws: int, repeats: int) -> None:
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}")
    seconds = seconds_a_frame(repeats)
    for method, value in seconds.items():
        ratio = value / seconds["paper"]
        print(f"{method:6} {1e3 * value:7.1f} ms a frame, {ratio:.3f} of the paper's method", flush=True)
    print(f"{'':21} {'bound, 1-sigma':^26} {'efficiency':^26}")
    print(f"{'':6} {'mode':7} {'m':>6} {'m':>8} {'deg':>8} {'z m':>8} {'m':>8} {'deg':>8} {'z m':>8}    NEES")
    rng = np.random.default_rng(1)
    for weather in WEATHERS:
        for range_m in RANGES_M:
            modes = ("fine", "coarse") if range_m <= FINE_TO_M else ("coarse",)
            for mode in modes:
                print(row(Case(weather, mode, range_m), draws, rng), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=30)
    arguments = parser.parse_args()
    main(arguments.draws, arguments.repeats)
