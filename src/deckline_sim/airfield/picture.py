"""A picture of an airfield with its truth, for training: fast, plane ground, any camera.

The renderer (`deckline_sim.scene`) draws ships and one kind of runway exactly; this module draws land runways in the
breadth that photographs have, at some 20 a second on one core.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from deckline.types import EdgeKind
from deckline_sim.airfield.ground import (
    FAR_M,
    NOISE_SLOPES,
    TILE,
    Float32,
    Float64,
    GroundCamera,
    draw_ground,
    draw_sky,
    fractal_noise,
    sample_tile,
)
from deckline_sim.airfield.land_runway import LandRunway, random_runway
from deckline_sim.ship.paint_shapes import Coat, dashes, layers, polygons, stripe

NEAR_M = 1.0  # in front of the camera: where polygons are cut
FORWARD = np.array([0.0, 0.0, 1.0])  # camera axes
SIDES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])  # inwards from the left, right, upper, lower border
SUPERSAMPLED_PX = 2_000_000  # at most, of the picture of the paint
MOST_FIXED = 30_000  # px: larger coordinates overflow in OpenCV, which takes them with binary places
NO_RUNWAY = 0.12  # of the airfields: fields and roads alone
DARK = 0.06  # of daylight, at night


@dataclass(frozen=True, eq=False)
class AirfieldPicture:
    """A picture with its ranges, camera and true edge lines."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3)
    range_m: Float32  # (H, W) ray length; inf for sky
    viewer: GroundCamera
    # (2, 2, 3) of the left and the right edge line, near end first: x, y, height; None: no runway
    ends_m: Float64 | None
    edge: EdgeKind | None
    deck_m: float = 0.0  # height of the lines above the plane
    centre_painted: bool = False  # whether a line is painted midway between them


def make_textures(rng: Generator, photographs: Iterable[NDArray[np.uint8]] = ()) -> list[Float32]:
    """Tiles (TILE, TILE) of mean 0 and spread 1: fractal noise, and pieces of photographs mirrored to repeat."""
    tiles = []
    for photograph in photographs:
        grey = cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY).astype(np.float32)
        size = TILE // 2
        if min(grey.shape) < size:
            continue
        top, left = (int(rng.integers(0, side - size + 1)) for side in grey.shape)
        part = grey[top : top + size, left : left + size]
        part = part - cv2.GaussianBlur(part, (0, 0), size / 8)
        if part.std() > 2:
            part = np.clip(part / part.std(), -3, 3)
            part = np.concatenate([part, part[::-1]])
            tiles.append(np.concatenate([part, part[:, ::-1]], axis=1))
    return tiles + [fractal_noise(rng, slope=slope) for slope in NOISE_SLOPES]


def draw_airfield(width: int, height: int, textures: Sequence[Float32], rng: Generator) -> AirfieldPicture:
    """A random airfield from a random approach.

    Args:
        textures: of `make_textures`.
    """
    runway = random_runway(rng)
    viewer = _approach(width, height, runway, rng)
    image, points, range_m = draw_surroundings(viewer, textures, rng)
    empty = rng.random() < NO_RUNWAY
    wear = textures[int(rng.integers(len(textures)))]
    if empty:
        lay_coat(image, viewer, _road(rng), points, wear, 0.2, rng)
    else:
        lay_coat(image, viewer, runway.pavement, points, wear, 0.1, rng)
        lay_coat(image, viewer, runway.paint, points, wear, rng.uniform(0.1, 0.5), rng)
    _draw_buildings(image, range_m, viewer, runway, rng)
    if runway.night:
        image *= np.float32(DARK * rng.uniform(0.5, 2.5))
    if not empty:
        _draw_lights(image, viewer, runway, rng)
    picture = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    if empty:
        return AirfieldPicture(picture, range_m, viewer, None, None)
    ends = np.array([[[x, y, 0.0] for x in runway.span_m] for y in (-runway.half_m, runway.half_m)])
    return AirfieldPicture(picture, range_m, viewer, ends, runway.edge, centre_painted=runway.centre_painted)


def draw_surroundings(
    viewer: GroundCamera, textures: Sequence[Float32], rng: Generator, at_sea: bool = False
) -> tuple[Float32, Float32, Float32]:
    """Ground and sky: the picture (H, W, 3), 0..255, what is seen of the plane (H, W, 2), m, and ranges (H, W), m."""
    rays = viewer.rays()
    below = np.minimum(rays[..., 2], -1e-6)
    along = np.float32(viewer.position_m[2]) / -below  # in units of the ray
    length = np.linalg.norm(rays, axis=2)
    ground = rays[..., 2] < -viewer.position_m[2] / FAR_M
    along = np.where(ground, along, np.float32(FAR_M))
    points = (viewer.position_m[:2] + rays[..., :2] * along[..., None]).astype(np.float32)
    footprint = along * length * (along / np.float32(viewer.position_m[2])) / np.float32(viewer.focal_px)
    colour, grass = draw_ground(viewer, points, footprint, textures, rng, at_sea)
    image = np.where(ground[..., None], colour, draw_sky(rays, textures, rng))
    range_m = np.where(ground, along * length, np.float32(np.inf))
    _draw_relief(image, range_m, viewer, grass, rng)
    return image, points, range_m


def _approach(width: int, height: int, runway: LandRunway, rng: Generator) -> GroundCamera:
    """On or beside an approach path, looking so that the runway is mostly in view."""
    distance = float(np.exp(rng.uniform(np.log(80), np.log(5000))))
    glide = np.deg2rad(rng.uniform(2.0, 4.5) if rng.random() < 0.75 else rng.uniform(1.5, 9.0))
    high = max((distance + 300) * np.tan(glide), 12.0)
    lateral_m = distance * (rng.normal(0, 0.03) if rng.random() < 0.7 else rng.normal(0, 0.3))
    position = np.array([-distance, lateral_m, high])
    return look_at(width, height, position, np.array([rng.uniform(0, 0.5) * runway.length_m, 0.0, 0.0]), rng)


def look_at(width: int, height: int, position_m: Float64, target_m: Float64, rng: Generator) -> GroundCamera:
    """A random camera at a place (3,) that has a target (3,) mostly in its picture."""
    focal = width / 2 / np.tan(np.deg2rad(rng.uniform(22, 100)) / 2)
    target = target_m - position_m
    yaw = np.arctan2(target[1], target[0])
    pitch = np.arctan2(target[2], np.hypot(*target[:2]))
    # where in the picture the target lies
    yaw -= np.arctan(rng.uniform(-0.42, 0.42) * width / focal)
    pitch += np.arctan(rng.uniform(-0.38, 0.4) * height / focal)
    roll = np.deg2rad(rng.normal(0, 3) if rng.random() < 0.85 else rng.normal(0, 14))
    return GroundCamera(width, height, float(focal), position_m, _axes(yaw, pitch, roll))


def _axes(yaw: float, pitch: float, roll: float) -> Float64:
    """Right, down and forward (rows) of a camera turned by `yaw` to the right of x and `pitch` up; y is right."""
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    down = np.array([np.sin(pitch) * np.cos(yaw), np.sin(pitch) * np.sin(yaw), -np.cos(pitch)])
    right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
    return np.stack([right, down, forward])


def lay_coat(
    image: Float32, viewer: GroundCamera, coat: Coat, points: Float32, wear: Float32, worn: float, rng: Generator
) -> None:
    """Draw a coat of triangles over the picture, supersampled, worn by a texture on the ground."""
    shapes = _project_triangles(viewer, coat)
    if not shapes:
        return
    corners = np.concatenate([polygon for polygon, _, _ in shapes])
    low = np.clip(np.floor(corners.min(0)) - 1, 0, [viewer.width, viewer.height]).astype(int)
    high = np.clip(np.ceil(corners.max(0)) + 2, 0, [viewer.width, viewer.height]).astype(int)
    wide, tall = high - low
    if wide <= 0 or tall <= 0:
        return
    most = min(6, MOST_FIXED / (viewer.width + viewer.height))
    factor = int(np.clip(np.sqrt(SUPERSAMPLED_PX / (wide * tall)), 1, max(most, 1)))
    colours = np.zeros((tall * factor, wide * factor, 4), dtype=np.uint8)  # and whether there is any
    for polygon, rgb, opacity in shapes:
        if opacity >= 1:
            cv2.fillConvexPoly(colours, _fixed(polygon - low, factor), [*rgb.tolist(), 255], cv2.LINE_AA, 4)
    part = cv2.resize(colours, (int(wide), int(tall)), interpolation=cv2.INTER_AREA).astype(np.float32)
    cover = part[..., 3:] / 255
    stains = np.zeros(part.shape[:2], dtype=np.float32)
    for polygon, _, opacity in shapes:
        if opacity < 1:
            cv2.fillConvexPoly(stain := np.zeros_like(stains), _fixed(polygon - low, 1), opacity, cv2.LINE_AA, 4)
            stains += stain
    if stains.any():
        part *= 1 - np.minimum(cv2.blur(stains, (3, 3)), 0.85)[..., None]
    where = (slice(low[1], high[1]), slice(low[0], high[0]))
    value = sample_tile(wear, points[where], float(rng.uniform(0.1, 0.6)))
    grain = np.clip(1 + np.float32(worn) * value, 0.2, 1.6)[..., None]
    image[where] = image[where] * (1 - cover) + part[..., :3] * grain


def _fixed(polygon: Float64, factor: int) -> NDArray[np.int32]:
    """Corners for OpenCV with four binary places, in a picture `factor` times as large."""
    return np.rint(((polygon + 0.5) * factor - 0.5) * 16).astype(np.int32)


def _project_triangles(viewer: GroundCamera, coat: Coat) -> list[tuple[Float64, Float32, float]]:
    """Polygons (K, 2) px, their colours (3,) 0..255 and opacities, in order, of what is in front of the camera."""
    if not len(coat):
        return []
    ground = np.concatenate([coat[:, :2].astype(np.float64), np.zeros((len(coat), 1))], axis=1).reshape(-1, 3, 3)
    rgb = coat[:, 2:5].reshape(-1, 3, 3).mean(axis=1) * 255
    opacity = coat[:, 5].reshape(-1, 3).mean(axis=1)
    shapes = []
    for corners, colour, cover in zip(ground, rgb, opacity, strict=True):
        pixels = project_polygon(viewer, corners)
        if len(pixels) == 0 or cover <= 0:
            continue
        if (pixels.max(0) >= 0).all() and (pixels.min(0) <= [viewer.width, viewer.height]).all():
            shapes.append((pixels, colour, float(cover)))
    return shapes


def project_polygon(viewer: GroundCamera, corners_m: ArrayLike) -> Float64:
    """Pixels (N, 2) of a convex polygon (K, 3) x, y, height, cut well outside the picture; (0, 2) where unseen."""
    corners = (np.asarray(corners_m, dtype=np.float64) - viewer.position_m) @ viewer.axes.T
    reach = (viewer.width + viewer.height) / viewer.focal_px
    for normal, offset in ((FORWARD, NEAR_M), *((side, 0.0) for side in SIDES + FORWARD * reach)):
        corners = _cut(corners, corners @ normal - offset)
    middle = np.array([(viewer.width - 1) / 2, (viewer.height - 1) / 2])
    return corners[:, :2] / corners[:, 2:] * viewer.focal_px + middle


def draw_face(
    image: Float32, viewer: GroundCamera, corners_m: ArrayLike, rgb: Float64, range_m: Float32 | None = None
) -> None:
    """Draw a convex polygon (K, 3) x, y, height into a picture, and the range of its middle into ranges (H, W)."""
    pixels = project_polygon(viewer, corners_m)
    if len(pixels):
        at = _fixed(pixels, 1)
        cv2.fillConvexPoly(image, at, rgb.tolist(), cv2.LINE_AA, 4)
        if range_m is not None:
            middle = np.asarray(corners_m, dtype=np.float64).mean(axis=0) - viewer.position_m
            cv2.fillConvexPoly(range_m, at, float(np.linalg.norm(middle)), cv2.LINE_8, 4)


def _cut(corners: Float64, height: Float64) -> Float64:
    """The part of a convex polygon (K, 3) where the height (K,) of its corners over a plane is not negative."""
    if (height >= 0).all():
        return corners
    out = []
    for k in range(len(corners)):
        a, b, share = corners[k - 1], corners[k], height[k - 1] - height[k]
        if (height[k - 1] >= 0) != (height[k] >= 0):
            out.append(a + (b - a) * height[k - 1] / share)
        if height[k] >= 0:
            out.append(b)
    return np.array(out).reshape(-1, 3)


def _road(rng: Generator) -> Coat:
    """A road with its lines, which resembles a runway."""
    wide, lanes = float(rng.uniform(7, 30)), int(rng.integers(2, 7))
    angle, shift = rng.normal(0, 0.25), rng.normal(0, 60)
    along = np.array([np.cos(angle), np.sin(angle)])
    shifted = np.array([0.0, shift])
    ends = np.array([along * -3000, along * 6000]) + shifted
    grey = rng.uniform(0.2, 0.6) * (1 + rng.normal(0, 0.04, 3))
    coats = [stripe(ends, wide, grey)]
    inner = wide - 2 * rng.uniform(0.4, 2.5)
    for k in range(lanes + 1):
        offset = -inner / 2 + inner * k / lanes
        if k in (0, lanes):
            coats.append(stripe(ends, 0.2, [0.9, 0.9, 0.88], offset))
        else:
            right = np.array([-along[1], along[0]]) * offset
            near = np.array([along * -500, along * 1500]) + shifted
            coats.append(dashes(near + right, 0.2, [[0.9, 0.9, 0.88]], 4.0, 8.0))
    for _ in range(rng.integers(0, 30)):
        axes = np.array([along, [-along[1], along[0]]])
        place = np.array([rng.uniform(-500, 3000), rng.uniform(-0.4, 0.4) * wide])
        car = place + np.array([[-2, -1], [2, -1], [2, 1], [-2, 1]])
        corners = shifted + car @ axes
        coats.append(polygons(corners, rng.uniform(0.05, 0.95) * np.ones(3)))
    return layers(coats)


def _draw_relief(image: Float32, range_m: Float32, viewer: GroundCamera, grass: Float64, rng: Generator) -> None:
    """Hills or a tree line along the horizon, fainter the farther they are."""
    for depth in np.sort(rng.uniform(0, 1, int(rng.integers(0, 4))))[::-1]:
        bearing = np.linspace(-1.4, 1.4, 160)
        rough = fractal_noise(rng, 256, slope=1.4)[0, :160]
        tall = np.maximum(0.0, rough + rng.uniform(-1, 1)) * rng.uniform(0.002, 0.05) + rng.uniform(0, 0.006)
        forward = viewer.axes[2]
        heading = np.arctan2(forward[1], forward[0]) + bearing
        rays = np.stack([np.cos(heading), np.sin(heading), tall], 1)
        top, ahead = viewer.project(viewer.position_m + 1000 * rays)
        foot, _ = viewer.project(viewer.position_m + 1000 * (rays * [1, 1, 0] - [0, 0, 0.004]))
        visible = ahead > 50
        outline = np.concatenate([top[visible], foot[visible][::-1]])
        haze = rng.uniform(120, 220) * np.ones(3)
        colour = (0.6 * grass + (haze - 0.6 * grass) * (0.2 + 0.7 * depth)).tolist()
        if visible.sum() > 1:
            points = np.rint(np.clip(outline, -MOST_FIXED, MOST_FIXED) * 16).astype(np.int32)
            cv2.fillPoly(image, [points], colour, cv2.LINE_AA, shift=4)
            cv2.fillPoly(hills := np.zeros_like(range_m), [points], 1.0, cv2.LINE_8, shift=4)
            range_m[(hills > 0) & (range_m > FAR_M)] = FAR_M * (0.3 + 0.7 * depth)


def _draw_buildings(image: Float32, range_m: Float32, viewer: GroundCamera, runway: LandRunway, rng: Generator) -> None:
    """Hangars, a tower, houses, trees: upright boxes beside the runway that hide none of it, the farthest first."""
    count = int(rng.integers(0, 40))
    side = rng.choice([-1.0, 1.0], count)
    at = np.stack([rng.uniform(-800, 1.3 * runway.length_m, count), side * (120 + rng.exponential(250, count))], 1)
    size = np.stack([rng.uniform(4, 90, count), rng.uniform(3, 22, count)], 1)
    _, lateral_m, high = viewer.position_m
    for k in np.argsort(-np.linalg.norm(at - viewer.position_m[:2], axis=1)):
        (x, y), (wide, tall) = at[k], size[k]
        inner = side[k] * y - wide / 2  # towards the runway
        behind = side[k] * lateral_m + (inner - side[k] * lateral_m) * (high / (high - tall) if high > tall else np.inf)
        if behind < runway.width_m:  # the ground that the roof's inner edge hides
            continue
        colour = rng.uniform(30, 230) * (1 + rng.normal(0, 0.08, 3))
        walls = [
            [[x, y - wide / 2], [x, y + wide / 2]],
            [[x, y - side[k] * wide / 2], [x + wide, y - side[k] * wide / 2]],
        ]
        for shade, ((x0, y0), (x1, y1)) in zip((1.0, 0.7), walls, strict=True):
            corners = np.array([[x0, y0, 0], [x1, y1, 0], [x1, y1, tall], [x0, y0, tall]])
            draw_face(image, viewer, corners, colour * shade, range_m)


def _draw_lights(image: Float32, viewer: GroundCamera, runway: LandRunway, rng: Generator) -> None:
    """Glows that grow slower than they come near."""
    if not len(runway.lights_m):
        return
    pixels, depth = viewer.project(runway.lights_m)
    power = rng.uniform(0.4, 1.5) * (1.0 if runway.night else rng.uniform(0.2, 1.0))
    for (u, v), d, rgb in zip(pixels, depth, runway.lights_rgb, strict=True):
        if d < 5 or not (2 <= u < viewer.width - 2 and 2 <= v < viewer.height - 2):
            continue
        sigma = float(np.clip(0.45 + 40 * power / d, 0.45, 3.0)) * viewer.width / 1280 + 0.2
        reach = int(3 * sigma) + 1
        u0, v0 = max(int(u) - reach, 0), max(int(v) - reach, 0)
        u1, v1 = min(int(u) + reach + 2, viewer.width), min(int(v) + reach + 2, viewer.height)
        gx = np.exp(-((np.arange(u0, u1) - u) ** 2) / (2 * sigma**2))
        gy = np.exp(-((np.arange(v0, v1) - v) ** 2) / (2 * sigma**2))
        image[v0:v1, u0:u1] += (280 * power * gy[:, None, None] * gx[:, None] * rgb).astype(np.float32)
