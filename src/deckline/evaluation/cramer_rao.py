"""The least error that points and noise allow: the Cramer-Rao bound of line offset, direction and deck height.

Computed on its own, by numerical derivatives of a forward projection, and so a check on the estimator's analytic ones.
"""

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
from deckline.types import SIDES, Frame

Array = NDArray[np.float64]
NAMES = (
    *("attitude_x", "attitude_y", "attitude_z", "position_x", "position_y", "position_z"),
    *("focal", "depth_scale", "tilt_along", "tilt_across"),
)
STEP = 1e-4  # of numerical derivatives, m
STEP_RAD = 1e-7  # the same of angles, and as a share of scales


class Bound(NamedTuple):
    """Covariances that no unbiased estimator beats."""

    lines: Array  # (6, 6) offset to its right, m, azimuth, rad, z, m, of the left line, then of the right
    centre: Array  # (3, 3) the same of the line midway


class _Scene(NamedTuple):
    """Where to differentiate: lines through the points, a level deck, the frame's pose."""

    frame: Frame
    pixels: dict[str, Array]  # (N, 2) by side
    ground: dict[str, tuple[Array, float, Array]]  # a point (2,) of the line, its azimuth, the way (N,) to every point
    height_m: float
    hub: Array  # (2,) where the deck's slopes are measured
    deep: dict[str, NDArray[np.bool_]]  # (N,) which points have a depth


class _Unknowns(NamedTuple):
    """Offset and azimuth of every line, the deck's z, then those nuisances that are not known exactly."""

    sides: tuple[str, ...]
    nuisances: tuple[str, ...]

    @property
    def height(self) -> int:
        return 2 * len(self.sides)

    @property
    def size(self) -> int:
        return self.height + 1 + len(self.nuisances)

    @property
    def steps(self) -> Array:
        angles = [STEP if name.startswith("position") else STEP_RAD for name in self.nuisances]
        return np.array([*[STEP, STEP_RAD] * len(self.sides), STEP, *angles])

    def values(self, x: Array) -> dict[str, float]:
        """All nuisances by name."""
        return dict.fromkeys(NAMES, 0.0) | dict(zip(self.nuisances, x[self.height + 1 :].tolist(), strict=True))


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
    """Bound for given points and `config.noise`, with nuisances (pose, calibration, deck) under their priors.

    Args:
        frame: camera, pose and deck height; its depth image says which points have a depth.
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
    scene = _scene(frame, points_px, mode, beside_m)
    sigmas = _prior_sigmas(config, relative)
    unknowns = _Unknowns(tuple(points_px), tuple(name for name in NAMES if sigmas[name] > 0))
    weights, directions = _weights(scene, unknowns, sigma_px, config)
    jacobian = np.empty((len(weights), unknowns.size))
    for k, step in enumerate(np.diag(unknowns.steps)):
        change = _seen(scene, unknowns, step, directions) - _seen(scene, unknowns, -step, directions)
        jacobian[:, k] = change / (2 * step[k])
    white = _decorrelated(jacobian * np.sqrt(weights)[:, None], scene, unknowns, correlation)
    information = white.T @ white + _knowledge(unknowns, mode, config, relative, frame.deck_z_m)
    nuisances = slice(unknowns.size - len(unknowns.nuisances), unknowns.size)
    information[nuisances, nuisances] += np.diag([sigmas[name] ** -2 for name in unknowns.nuisances])
    return _bounds(np.asarray(np.linalg.inv(information), dtype=np.float64), unknowns, scene)


def _weighted_line(xy_m: Array, weights: Array) -> tuple[Array, float]:
    """Weighted total least squares line in the plane: centre (2,) and azimuth, rad, up to half a turn.

    Minimises sum w_i d_i^2 over the perpendicular distances d_i in closed form.

    Raises:
        ValueError: fewer than two points.
    """
    if len(xy_m) < 2:
        raise ValueError(f"a line needs at least 2 points, got {len(xy_m)}")
    centre = weights @ xy_m / weights.sum()
    offsets = xy_m - centre
    _, vectors = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)
    return centre, float(np.arctan2(vectors[1, 1], vectors[0, 1]))


def _prior_sigmas(config: RunConfig, relative: bool) -> dict[str, float]:
    noise, tilt = config.noise, config.noise.slope_rad
    carried = 0.0 if relative else 1.0
    return dict(
        zip(
            NAMES,
            (
                *(noise.attitude_rad, noise.attitude_rad, noise.attitude_rad * carried),
                *([noise.position_m * carried] * 3),
                *(noise.focal_fraction, noise.depth_scale, tilt, tilt),
            ),
            strict=True,
        )
    )


def _scene(frame: Frame, points_px: dict[str, Array], mode: Mode, beside_m: Array | None) -> _Scene:
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
    lines, weights = {}, {}
    for side, px in points_px.items():
        rays = pose.rotation.apply(frame.camera.rays(px))
        lines[side] = intersect_plane(pose.translation, rays, height)[:, :2]
        weights[side] = np.clip(rays[:, 2], 0, None) ** 2
    every, all_weights = np.concatenate(list(lines.values())), np.concatenate(list(weights.values()))
    hub = all_weights @ every / all_weights.sum() if beside_m is None else np.asarray(beside_m, dtype=np.float64)[:2]
    ground = {}
    for side, xy in lines.items():
        middle, azimuth = _weighted_line(xy, weights[side])
        if (middle - pose.translation[:2]) @ [np.cos(azimuth), np.sin(azimuth)] < 0:
            azimuth += np.pi
        along = np.array([np.cos(azimuth), np.sin(azimuth)])
        point = middle + (hub - middle) @ along * along
        ground[side] = (point, azimuth, (xy - point) @ along)
    return _Scene(frame, points_px, ground, height, hub, deep)


def _moved(scene: _Scene, value: dict[str, float]) -> tuple[Camera, RigidTransform]:
    """Camera and its pose for given nuisances."""
    body, mount, camera = scene.frame.world_from_body, scene.frame.body_from_camera, scene.frame.camera
    if body is None:
        raise ValueError(f"{scene.frame.file}: no pose: give poses.csv")
    turn = Rotation.from_rotvec([value[f"attitude_{axis}"] for axis in "xyz"])
    shift = np.array([value[f"position_{axis}"] for axis in "xyz"])
    world_from_body = RigidTransform.from_components(body.translation + shift, turn * body.rotation)
    zoom = 1 + value["focal"]
    return replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom), world_from_body * mount


def _line_points(scene: _Scene, unknowns: _Unknowns, side: str, x: Array) -> Array:
    """World points (N, 3) of a line that is moved, turned, and lies on a deck that is raised and sloped."""
    (point, azimuth, ways), number = scene.ground[side], unknowns.sides.index(side)
    angle = azimuth + x[2 * number + 1]
    right = np.array([-np.sin(azimuth), np.cos(azimuth)])
    xy = point + x[2 * number] * right + ways[:, None] * np.array([np.cos(angle), np.sin(angle)])
    return np.column_stack([xy, scene.height_m + x[unknowns.height] + _rise(scene, xy, unknowns.values(x))])


def _rise(scene: _Scene, xy: Array, value: dict[str, float]) -> Array:
    mean = sum(np.array([np.cos(azimuth), np.sin(azimuth)]) for _, azimuth, _ in scene.ground.values())
    along = np.asarray(mean) / np.linalg.norm(mean)
    ways = (xy - scene.hub) @ np.stack([along, [-along[1], along[0]]]).T
    return np.asarray(ways @ [value["tilt_along"], value["tilt_across"]])


def _seen(scene: _Scene, unknowns: _Unknowns, x: Array, directions: dict[str, Array]) -> Array:
    """What is measured: every point across its line, px, then the logarithms of depth at the points' pixels."""
    value = unknowns.values(x)
    camera, pose = _moved(scene, value)
    across, depths = [], []
    for side in unknowns.sides:
        points = _line_points(scene, unknowns, side, x)
        across.append((camera.project(pose.inv().apply(points)) * directions[side]).sum(axis=1))
        rays = pose.rotation.apply(camera.rays(scene.pixels[side][scene.deep[side]]))
        # The sloped deck is followed from where the ray meets the level one: slopes are small.
        level = intersect_plane(pose.translation, rays, scene.height_m + x[unknowns.height])
        rise = _rise(scene, level[:, :2], value)
        depth = (level[:, 2] + rise - pose.translation[2]) / rays[:, 2]
        depths.append(np.log(depth * (1 + value["depth_scale"])))
    return np.concatenate(across + depths)


def _weights(
    scene: _Scene, unknowns: _Unknowns, sigma_px: dict[str, Array], config: RunConfig
) -> tuple[Array, dict[str, Array]]:
    """Inverse variances of what is measured, and the unit vector (N, 2) across the image line at every point."""
    noise, directions, variances = config.noise, {}, []
    base = np.zeros(unknowns.size)
    camera, pose = _moved(scene, unknowns.values(base))
    for side in unknowns.sides:
        points = _line_points(scene, unknowns, side, base)
        azimuth = scene.ground[side][1]
        step = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * STEP
        ahead, behind = (camera.project(pose.inv().apply(points + sign * step)) for sign in (1, -1))
        along = ahead - behind
        across = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        directions[side] = across
        sigma = np.maximum(sigma_px[side], MIN_SIGMA_PX)
        variances.append((across[:, 0] * sigma) ** 2 + (across[:, 1] * ROW_SIGMA_PX) ** 2)
    count = sum(int(deep.sum()) for deep in scene.deep.values())
    variances.append(np.full(count, max(noise.depth_fraction, MIN_DEPTH_FRACTION) ** 2))
    return 1 / np.concatenate(variances), directions


def _decorrelated(rows: Array, scene: _Scene, unknowns: _Unknowns, correlation: float) -> Array:
    """Rows of unit variance without what each point has from its neighbour in its line; depths stay as they are."""
    result, first = rows.copy(), 0
    for side in unknowns.sides:
        mine = first + np.argsort(scene.pixels[side][:, 1], kind="stable")
        result[mine[1:]] -= correlation * rows[mine[:-1]]
        result[mine[1:]] /= np.sqrt(1 - correlation**2)
        first += len(mine)
    return result


def _knowledge(unknowns: _Unknowns, mode: Mode, config: RunConfig, relative: bool, deck_z_m: float | None) -> Array:
    """Information (P, P) of what is known of the deck beforehand."""
    deck, information = config.frame_deck, np.zeros((unknowns.size, unknowns.size))

    def know(shares: dict[tuple[str, str], float], sigma: float) -> None:
        row = np.zeros(unknowns.size)
        for (side, what), share in shares.items():
            row[2 * unknowns.sides.index(side) + (what == "azimuth")] = share
        information[...] += np.outer(row, row) / sigma**2

    know({("right", "azimuth"): 1.0, ("left", "azimuth"): -1.0}, parallel_sigma(deck))
    if deck.width_m is not None:
        know({("right", "offset"): 1.0, ("left", "offset"): -1.0}, max(deck.width_sigma_m, MIN_SIGMA_M))
    if "centre" in unknowns.sides:
        places = (
            ("offset", max(CENTRE_SIGMA_M, MIN_SIGMA_M)),
            ("azimuth", max(CENTRE_SIGMA_RAD, MIN_SIGMA_RAD)),
        )
        for what, sigma in places:
            know({("centre", what): 1.0, ("left", what): -0.5, ("right", what): -0.5}, sigma)
    if mode != "fine" and deck_z_m is not None:
        own = config.noise.position_m if relative else 0.0
        sigma = max(float(np.hypot(config.noise.deck_z_m, own)), MIN_SIGMA_M)
        information[unknowns.height, unknowns.height] += sigma**-2
    return information


def _bounds(covariance: Array, unknowns: _Unknowns, scene: _Scene) -> Bound:
    chosen = np.zeros((6, len(covariance)))
    for k, side in enumerate(SIDES):
        first = 2 * unknowns.sides.index(side)
        chosen[3 * k, first] = chosen[3 * k + 1, first + 1] = chosen[3 * k + 2, unknowns.height] = 1.0
        for number, name in enumerate(unknowns.nuisances):
            one = dict.fromkeys(NAMES, 0.0) | {name: 1.0}
            rise = float(_rise(scene, scene.ground[side][0][None], one)[0])
            chosen[3 * k + 2, unknowns.height + 1 + number] = rise
    middle = np.hstack([np.eye(3), np.eye(3)]) / 2 @ chosen
    return Bound(chosen @ covariance @ chosen.T, middle @ covariance @ middle.T)
