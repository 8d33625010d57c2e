"""The least error that points and noise allow: the Cramer-Rao bound of line offset, direction and deck height.

Computed on its own, by numerical derivatives of a forward projection, and so a check on the estimator's analytic ones.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Mode, RunConfig
from deckline.geometry import Camera, intersect_plane
from deckline.localize.depth import MIN_SIGMA_PX, sample_depth, select_independent
from deckline.localize.model import (
    CENTRE_SIGMA_M,
    CENTRE_SIGMA_RAD,
    MIN_DEPTH_FRACTION,
    MIN_SIGMA_M,
    MIN_SIGMA_RAD,
    parallel_sigma,
)
from deckline.localize.observations import ROW_SIGMA_PX
from deckline.localize.ransac import least_squares_line
from deckline.types import SIDES, Frame

Array = NDArray[np.float64]
Values = Mapping[str, float]  # unknowns by name; those left out are 0
STEP = 1e-4  # of numerical derivatives, m
STEP_RAD = 1e-7  # the same of angles, and as a share of scales
IN_METRES = ("offset", "height", "position")  # what the names of unknowns in metres contain


class Bound(NamedTuple):
    """Covariances that no unbiased estimator beats."""

    lines: Array  # (6, 6) offset to its right, m, azimuth, rad, z, m, of the left line, then of the right
    centre: Array  # (3, 3) the same of the line midway


class _Line(NamedTuple):
    pixels: Array  # (N, 2)
    point: Array  # (2,) of the line
    azimuth: float
    distances: Array  # (N,) from there along the line to every point
    has_depth: NDArray[np.bool_]  # (N,)


class _Linearization(NamedTuple):
    """Where to differentiate: lines through the points, a level deck, the frame's pose."""

    frame: Frame
    lines: dict[str, _Line]  # by side
    height_m: float
    pivot: Array  # (2,) where the deck's slopes are measured


def cramer_rao(
    frame: Frame,
    points_px: dict[str, Array],
    sigma_px: dict[str, Array],
    mode: Mode,
    config: RunConfig,
    beside_m: Array | None = None,
    relative: bool = False,
    correlation: float = 0.0,
) -> Bound:
    """Bound for given points and the configured noise, with nuisances (pose, calibration, deck) under their priors.

    Args:
        frame: camera, pose and deck height; its depth image decides which points have a depth.
        points_px: (N, 2) of `left` and `right`, and of `centre` where a painted centre line is used.
        sigma_px: (N,) 1-sigma of u of each.
        mode: `fine` counts the depth camera, `coarse` the reported deck height, `auto` both.
        config: noise and what is known of the deck.
        beside_m: (2,) or (3,) world; offsets are bounded where the lines pass beside this point. None: the middle of
            what was measured.
        relative: bound what counts as seen from the aircraft, without what its own wrong position and heading carry
            along; else the lines in the world.
        correlation: of the errors of neighbouring points of one line, a first-order autoregression along it.

    Raises:
        ValueError: not both lines, or a frame without pose, deck height or depth.
    Source: Fisher information with Gaussian priors on nuisances (Van Trees 1968, section 2.4).
    """
    if not set(SIDES) <= set(points_px) or frame.world_from_body is None:
        raise ValueError(f"{frame.file}: the bound needs points of both lines and a pose, got {', '.join(points_px)}")
    scene = _build_scene(frame, points_px, mode, beside_m)
    nuisances = {name: sigma for name, sigma in _nuisance_sigmas(config, relative).items() if sigma > 0}
    lines = [f"{side}.{what}" for side in points_px for what in ("offset", "azimuth")]
    names = [*lines, "height", *nuisances]
    weights, across = _noise_model(scene, sigma_px, config)
    columns = []
    for name in names:
        step = STEP if any(word in name for word in IN_METRES) else STEP_RAD
        change = _predict(scene, {name: step}, across) - _predict(scene, {name: -step}, across)
        columns.append(change / (2 * step))
    white = _whiten(np.stack(columns, axis=1) * np.sqrt(weights)[:, None], scene, correlation)
    information = white.T @ white + _deck_information(names, mode, config, relative, frame.deck_z_m)
    information += np.diag([nuisances[name] ** -2 if name in nuisances else 0.0 for name in names])
    return _bound_lines(np.asarray(np.linalg.inv(information), dtype=np.float64), names, scene)


def _nuisance_sigmas(config: RunConfig, relative: bool) -> dict[str, float]:
    """1-sigma of the errors of pose, calibration and deck slope; 0 for what is known or does not count."""
    noise, world = config.noise, 0.0 if relative else 1.0
    return {
        "attitude_x": noise.attitude_rad,
        "attitude_y": noise.attitude_rad,
        "attitude_z": noise.attitude_rad * world,
        **{f"position_{axis}": noise.position_m * world for axis in "xyz"},
        "focal": noise.focal_fraction,
        "depth_scale": noise.depth_scale,
        "tilt_along": noise.slope_rad,
        "tilt_across": noise.slope_rad,
    }


def _build_scene(frame: Frame, points_px: dict[str, Array], mode: Mode, beside_m: Array | None) -> _Linearization:
    pose = frame.world_from_camera
    if pose is None:
        raise ValueError(f"{frame.file}: no pose: give poses.csv")
    deep = {side: np.zeros(len(px), dtype=bool) for side, px in points_px.items()}
    height = frame.deck_z_m
    if mode != "coarse" and frame.depth_m is not None:
        depths = {side: sample_depth(frame.depth_m, px) for side, px in points_px.items()}
        deep = {side: select_independent(points_px[side], np.isfinite(depth)) for side, depth in depths.items()}
        if mode == "fine" or height is None:
            rays = np.concatenate([pose.rotation.apply(frame.camera.rays(px)) for px in points_px.values()])
            height = float(np.nanmedian(pose.translation[2] + np.concatenate(list(depths.values())) * rays[:, 2]))
    if height is None or not np.isfinite(height):
        raise ValueError(f"{frame.file}: the bound needs a deck height or depth for mode {mode}")
    ground, weights = {}, {}
    for side, px in points_px.items():
        rays = pose.rotation.apply(frame.camera.rays(px))
        ground[side] = intersect_plane(pose.translation, rays, height)[:, :2]
        weights[side] = np.clip(rays[:, 2], 0, None) ** 2
    every, all_weights = np.concatenate(list(ground.values())), np.concatenate(list(weights.values()))
    pivot = all_weights @ every / all_weights.sum() if beside_m is None else np.asarray(beside_m, dtype=np.float64)[:2]
    lines = {}
    for side, xy in ground.items():
        across_x, across_y, _ = least_squares_line(xy, weights[side])
        middle, azimuth = weights[side] @ xy / weights[side].sum(), float(np.arctan2(across_x, -across_y))
        if (middle - pose.translation[:2]) @ [np.cos(azimuth), np.sin(azimuth)] < 0:
            azimuth += np.pi
        along = np.array([np.cos(azimuth), np.sin(azimuth)])
        point = middle + (pivot - middle) @ along * along
        lines[side] = _Line(points_px[side], point, azimuth, (xy - point) @ along, deep[side])
    return _Linearization(frame, lines, height, pivot)


def _perturb_camera(scene: _Linearization, values: Values) -> tuple[Camera, RigidTransform]:
    """Camera and its pose for given nuisances."""
    body, mount, camera = scene.frame.world_from_body, scene.frame.body_from_camera, scene.frame.camera
    if body is None:
        raise ValueError(f"{scene.frame.file}: no pose: give poses.csv")
    turn = Rotation.from_rotvec([values.get(f"attitude_{axis}", 0.0) for axis in "xyz"])
    shift = np.array([values.get(f"position_{axis}", 0.0) for axis in "xyz"])
    world_from_body = RigidTransform.from_components(body.translation + shift, turn * body.rotation)
    zoom = 1 + values.get("focal", 0.0)
    return replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom), world_from_body * mount


def _line_points(scene: _Linearization, side: str, values: Values) -> Array:
    """World points (N, 3) of a line that is moved, turned, and lies on a deck that is raised and sloped."""
    line = scene.lines[side]
    angle = line.azimuth + values.get(f"{side}.azimuth", 0.0)
    right = np.array([-np.sin(line.azimuth), np.cos(line.azimuth)])
    along = np.array([np.cos(angle), np.sin(angle)])
    xy = line.point + values.get(f"{side}.offset", 0.0) * right + line.distances[:, None] * along
    return np.column_stack([xy, scene.height_m + values.get("height", 0.0) + _slope_height(scene, xy, values)])


def _slope_height(scene: _Linearization, xy: Array, values: Values) -> Array:
    """Change of z (N,) at points (N, 2) by the deck's slopes along and across the lines."""
    mean = sum(np.array([np.cos(line.azimuth), np.sin(line.azimuth)]) for line in scene.lines.values())
    along = np.asarray(mean) / np.linalg.norm(mean)
    distances = (xy - scene.pivot) @ np.stack([along, [-along[1], along[0]]]).T
    return np.asarray(distances @ [values.get("tilt_along", 0.0), values.get("tilt_across", 0.0)])


def _predict(scene: _Linearization, values: Values, across: Mapping[str, Array]) -> Array:
    """The measurements: every point across its line, px, then the logarithms of depth at the points' pixels."""
    camera, pose = _perturb_camera(scene, values)
    offsets, depths = [], []
    for side, line in scene.lines.items():
        points = _line_points(scene, side, values)
        offsets.append((camera.project(pose.inv().apply(points)) * across[side]).sum(axis=1))
        rays = pose.rotation.apply(camera.rays(line.pixels[line.has_depth]))
        # The ray meets the sloped deck about where it meets the level one: slopes are small.
        level = intersect_plane(pose.translation, rays, scene.height_m + values.get("height", 0.0))
        z = level[:, 2] + _slope_height(scene, level[:, :2], values) - pose.translation[2]
        depths.append(np.log(z / rays[:, 2] * (1 + values.get("depth_scale", 0.0))))
    return np.concatenate(offsets + depths)


def _noise_model(
    scene: _Linearization, sigma_px: Mapping[str, Array], config: RunConfig
) -> tuple[Array, dict[str, Array]]:
    """Inverse variances of the measurements, and the unit vector (N, 2) across the image line at every point."""
    across, variances = {}, []
    camera, pose = _perturb_camera(scene, {})
    for side, line in scene.lines.items():
        points = _line_points(scene, side, {})
        step = np.array([np.cos(line.azimuth), np.sin(line.azimuth), 0.0]) * STEP
        ahead, behind = (camera.project(pose.inv().apply(points + sign * step)) for sign in (1, -1))
        along = ahead - behind
        across[side] = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        sigma = np.maximum(sigma_px[side], MIN_SIGMA_PX)
        variances.append((across[side][:, 0] * sigma) ** 2 + (across[side][:, 1] * ROW_SIGMA_PX) ** 2)
    count = sum(int(line.has_depth.sum()) for line in scene.lines.values())
    variances.append(np.full(count, max(config.noise.depth_fraction, MIN_DEPTH_FRACTION) ** 2))
    return 1 / np.concatenate(variances), across


def _whiten(rows: Array, scene: _Linearization, correlation: float) -> Array:
    """Rows of unit variance without what each point shares with its neighbour in its line; depths stay as they are."""
    result, first = rows.copy(), 0
    for line in scene.lines.values():
        order = first + np.argsort(line.pixels[:, 1], kind="stable")
        result[order[1:]] -= correlation * rows[order[:-1]]
        result[order[1:]] /= np.sqrt(1 - correlation**2)
        first += len(order)
    return result


def _deck_information(names: list[str], mode: Mode, config: RunConfig, relative: bool, deck_z_m: float | None) -> Array:
    """Information (P, P) of what is known of the deck beforehand."""
    deck, information = config.frame_deck, np.zeros((len(names), len(names)))

    def add(shares: Values, sigma: float) -> None:
        row = np.array([shares.get(name, 0.0) for name in names])
        information[...] += np.outer(row, row) / sigma**2

    add({"right.azimuth": 1.0, "left.azimuth": -1.0}, parallel_sigma(deck))
    if deck.width_m is not None:
        add({"right.offset": 1.0, "left.offset": -1.0}, max(deck.width_sigma_m, MIN_SIGMA_M))
    if "centre.offset" in names:
        sigmas = {"offset": max(CENTRE_SIGMA_M, MIN_SIGMA_M), "azimuth": max(CENTRE_SIGMA_RAD, MIN_SIGMA_RAD)}
        for what, sigma in sigmas.items():
            add({f"centre.{what}": 1.0, f"left.{what}": -0.5, f"right.{what}": -0.5}, sigma)
    if mode != "fine" and deck_z_m is not None:
        own_m = config.noise.position_m if relative else 0.0
        add({"height": 1.0}, max(float(np.hypot(config.noise.deck_z_m, own_m)), MIN_SIGMA_M))
    return information


def _bound_lines(covariance: Array, names: list[str], scene: _Linearization) -> Bound:
    """The covariance of both lines and their middle, from that of all unknowns."""
    rows = []
    for side in SIDES:
        heights = {"height": 1.0}
        for name in ("tilt_along", "tilt_across"):
            heights[name] = float(_slope_height(scene, scene.lines[side].point[None], {name: 1.0})[0])
        for shares in ({f"{side}.offset": 1.0}, {f"{side}.azimuth": 1.0}, heights):
            rows.append([shares.get(name, 0.0) for name in names])
    lines = np.array(rows)
    middle = np.hstack([np.eye(3), np.eye(3)]) / 2 @ lines
    return Bound(lines @ covariance @ lines.T, middle @ covariance @ middle.T)
