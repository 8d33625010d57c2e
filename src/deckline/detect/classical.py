"""A line finder without weights: bright stripes, straight lines through them, and the pair that could be a runway.

What a runway's edges are to it: two bright stripes, or ladders of two stripes each, on something darker and even;
straight, side by side, nearer to each other the farther away, of like contrast. Where no pair stands out it says "not
seen". Where the runway is expected in a part of the image, and the whole shows no such pair, that part is magnified and
looked through for itself: less competes with the runway there, and a far one has more rows.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.detect.looks import Box, check_box
from deckline.detect.stripes import StripeConfig, StripeLine, middle_of, stripe_lines
from deckline.geometry import Camera
from deckline.types import Detection, LinePoints

# Thresholds were set on 180 clear views of the simulator (presets paper, cvn, axial and random ships), so that most
# pairs that come back are right; what they make of other views is measured by `deckline eval detection`.
FEWEST_POINTS = 3  # of a line that is returned
# Two pairs closer than this, side by side and as shares of their width, are one: the stripes of a ladder; lone stripes.
SAME_LADDER, SAME_STRIPE = 0.2, 0.03  # of a pair's width, from side to side


@dataclass(frozen=True)
class ClassicalConfig:
    """What counts as a runway."""

    stripes: StripeConfig = field(default_factory=StripeConfig)
    min_overlap: float = 0.6  # of the longer line's rows that the other one has too
    max_taper: float = 0.88  # width of the pair at its upper end over that at its lower end; parallel is no runway
    min_width_px: float = 8.0  # of the pair at its lower end
    # Width of the pair at its lower end over its height: 1.4 to 1.6 on a glideslope, less from above, more from below.
    aspect: tuple[float, float] = (0.4, 3.0)
    min_contrast_ratio: float = 0.4  # of the fainter stripe to the brighter one
    max_unevenness: float = 0.3  # of what lies between, 1-sigma over the stripes' contrast: a deck, not foam
    ladder: tuple[float, float] = (0.07, 0.2)  # distance of a ladder's two stripes over the pair's width
    ladder_ratio: float = 0.7  # of the narrower ladder to the wider one, and of a ladder's fainter stripe to the other
    ladder_factor: float = 2.0  # of the score, where both sides are ladders
    halfway_factor: float = 1.4  # of the score, where a third line could be the centre line
    min_margin: float = 1.25  # score of the best pair over the best one elsewhere; below it: not seen
    sigma_floor_px: float = 0.35  # of a point that lies on its line
    expected_width_px: float = 320.0  # to which the part is magnified in which the runway is expected
    max_magnification: int = 4


@dataclass(frozen=True, eq=False)
class VanishingPrior:
    """Where lines along the runway meet, as far as a pose tells."""

    point_px: NDArray[np.float64]  # (2,) u, v
    radius_px: float  # pairs that meet farther from it are not the runway

    @classmethod
    def from_pose(
        cls, camera: Camera, world_from_camera: RigidTransform, azimuth_rad: float, tolerance_rad: float
    ) -> "VanishingPrior":
        """Of a level runway with this azimuth, from world x towards world y.

        Raises:
            ValueError: the camera looks away from that direction.
        """
        direction = world_from_camera.rotation.inv().apply([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
        if direction[2] <= 0:
            raise ValueError("the camera looks away from the runway's direction: its lines do not meet in the image")
        return cls(camera.project(direction[None])[0], float(np.tan(tolerance_rad) * camera.fx))


class ClassicalDetector:
    """Stripes, straight lines and the one pair that stands out; deterministic."""

    name = "classical"

    def __init__(self, config: ClassicalConfig | None = None) -> None:
        self.config = config or ClassicalConfig()

    def __call__(
        self, image_rgb: NDArray[np.uint8], look_at: Box | None = None, vanishing: VanishingPrior | None = None
    ) -> Detection:
        """Both lines in an image (H, W, 3) uint8 RGB.

        Args:
            image_rgb: the image.
            look_at: u0, v0, u1, v1 of where the runway is expected, px; looked through if the whole shows no runway.
            vanishing: rules out pairs that meet elsewhere.

        Raises:
            ValueError: anything but such an image, or a box that is empty or not finite.
        """
        if image_rgb.ndim != 3 or image_rgb.shape[2] != 3 or image_rgb.dtype != np.uint8:
            raise ValueError(f"expected an image (H, W, 3) of uint8, got {image_rgb.shape} of {image_rgb.dtype}")
        found = _found(image_rgb, vanishing, self.config)
        if look_at is None or len(found.left):
            return found
        return _found_in(check_box(look_at), image_rgb, vanishing, self.config)


class _Marking(NamedTuple):
    """What could be the marking of one edge."""

    line: StripeLine  # a stripe, or the middle of a ladder
    spacing_px: float  # of a ladder's two stripes, in the middle of its rows; 0 for a stripe


class _Pair(NamedTuple):
    """Two markings that could be a runway's edges."""

    left: _Marking
    right: _Marking
    score: float


def _found(image_rgb: NDArray[np.uint8], vanishing: VanishingPrior | None, config: ClassicalConfig) -> Detection:
    lines = stripe_lines(image_rgb, config.stripes)
    pair = _standing_out(_markings(lines, config), image_rgb.min(axis=2), vanishing, config)
    if pair is None:
        return Detection(LinePoints.empty(), LinePoints.empty())
    left, right = (_points(side.line, config) for side in (pair.left, pair.right))
    corners = np.concatenate([left.points_px, right.points_px])
    (u0, v0), (u1, v1) = corners.min(axis=0), corners.max(axis=0)
    return Detection(left, right, (float(u0), float(v0), float(u1), float(v1)))


def _found_in(
    box: Box, image_rgb: NDArray[np.uint8], vanishing: VanishingPrior | None, config: ClassicalConfig
) -> Detection:
    """What is found in a magnified part of the image, in the image's pixels; one point for each of its rows."""
    import cv2  # here: training imports this package on machines without OpenCV

    height, width = image_rgb.shape[:2]
    u0, v0 = int(np.clip(np.floor(box[0]), 0, width - 1)), int(np.clip(np.floor(box[1]), 0, height - 1))
    u1 = int(np.clip(np.ceil(box[2]) + 1, u0 + 1, width))
    v1 = int(np.clip(np.ceil(box[3]) + 1, v0 + 1, height))
    factor = int(np.clip(config.expected_width_px // (u1 - u0), 1, config.max_magnification))
    part = np.asarray(cv2.resize(image_rgb[v0:v1, u0:u1], None, fx=factor, fy=factor), dtype=np.uint8)  # bilinear
    corner = np.array([u0, v0])
    if vanishing is not None:
        point = (vanishing.point_px - corner + 0.5) * factor - 0.5
        vanishing = VanishingPrior(point, vanishing.radius_px * factor)
    found = _found(part, vanishing, config)
    left, right = (_in_image(side, corner, factor) for side in (found.left, found.right))
    if min(len(left), len(right)) < FEWEST_POINTS:
        return Detection(LinePoints.empty(), LinePoints.empty())
    return Detection(left, right, (float(u0), float(v0), float(u1 - 1), float(v1 - 1)))


def _in_image(points: LinePoints, corner_px: NDArray, factor: int) -> LinePoints:
    """Points found in a part of the image that was magnified by `factor`; of neighbouring rows one."""
    kept = slice(factor // 2, None, factor)
    pixels = (points.points_px[kept] + 0.5) / factor - 0.5 + corner_px
    return LinePoints(pixels, points.confidence[kept], points.sigma_px[kept] / factor)


def _markings(lines: list[StripeLine], config: ClassicalConfig) -> list[_Marking]:
    """Every stripe, and every two that could be a ladder."""
    found = [_Marking(line, 0.0) for line in lines]
    for left in lines:
        for right in lines:
            top, bottom = max(left.top, right.top), min(left.bottom, right.bottom)
            if left is right or bottom - top < config.ladder_ratio * max(left.rows, right.rows):
                continue
            far, near = (right.x_at(v) - left.x_at(v) for v in (top, bottom))
            if far <= 0 or near < far or _ratio(left.contrast, right.contrast) < config.ladder_ratio:
                continue
            if near < config.ladder[1] * config.aspect[1] * (bottom - top):
                found.append(_Marking(middle_of(left, right), (near + far) / 2))
    return [marking for marking in found if len(marking.line.points_px) >= config.stripes.min_rows]


def _standing_out(
    markings: list[_Marking], level: NDArray[np.uint8], vanishing: VanishingPrior | None, config: ClassicalConfig
) -> _Pair | None:
    """The best pair, unless another one elsewhere is nearly as good."""
    found = (_pair(left, right, markings, level, vanishing, config) for left in markings for right in markings)
    pairs = sorted((pair for pair in found if pair is not None), key=lambda pair: -pair.score)
    if not pairs:
        return None
    best = pairs[0]
    others = [pair.score for pair in pairs[1:] if not _same(best, pair)]
    return best if not others or best.score >= config.min_margin * others[0] else None


def _pair(
    left: _Marking,
    right: _Marking,
    markings: list[_Marking],
    level: NDArray[np.uint8],
    vanishing: VanishingPrior | None,
    config: ClassicalConfig,
) -> _Pair | None:
    """A pair with its score: how much it looks like a runway's edges. None where it cannot be."""
    a, b = left.line, right.line
    top, bottom = max(a.top, b.top), min(a.bottom, b.bottom)
    ladders = left.spacing_px > 0
    if a is b or ladders != (right.spacing_px > 0) or bottom - top < config.min_overlap * max(a.rows, b.rows):
        return None
    far, near = (b.x_at(v) - a.x_at(v) for v in (top, bottom))
    if not (near >= config.min_width_px and 0 < far <= config.max_taper * near):
        return None
    low, high = config.aspect
    contrasts = _ratio(a.contrast, b.contrast)
    if not low * (bottom - top) < near < high * (bottom - top) or contrasts < config.min_contrast_ratio:
        return None
    if ladders and not _ladders_agree(left, right, (far + near) / 2, config):
        return None
    if vanishing is not None and not _meet_near(vanishing, a, top, far / (near - far) * (bottom - top)):
        return None
    if not _even_between(a, b, (top, bottom), level, config.max_unevenness):
        return None
    score = 2 / (1 / a.support + 1 / b.support) * np.sqrt(contrasts)
    score *= config.ladder_factor if ladders else 1.0
    score *= config.halfway_factor if any(_lies_halfway(third.line, a, b) for third in markings) else 1.0
    return _Pair(left, right, float(score))


def _ratio(one: float, other: float) -> float:
    """The smaller over the larger."""
    return min(one, other) / max(one, other)


def _ladders_agree(left: _Marking, right: _Marking, width_px: float, config: ClassicalConfig) -> bool:
    """Whether both ladders are about as wide, and as wide as a ladder is for a pair of that width."""
    low, high = config.ladder
    fits = all(low * width_px <= side.spacing_px <= high * width_px for side in (left, right))
    return fits and _ratio(left.spacing_px, right.spacing_px) >= config.ladder_ratio


def _meet_near(vanishing: VanishingPrior, left: StripeLine, top: float, above: float) -> bool:
    """Whether a pair whose lines meet so many rows above its top meets where the pose says."""
    meeting = np.array([left.x_at(top - above), top - above])
    return bool(np.linalg.norm(meeting - vanishing.point_px) <= vanishing.radius_px)


def _even_between(
    left: StripeLine, right: StripeLine, rows: tuple[float, float], level: NDArray[np.uint8], limit: float
) -> bool:
    """Whether what lies between two lines varies by less than `limit` of their contrast, beside a centre line."""
    v = np.linspace(rows[0], rows[1], 12)
    share = np.concatenate([np.linspace(0.25, 0.42, 6), np.linspace(0.58, 0.75, 6)])
    start = left.at_top + left.slope * (v - left.top)
    end = right.at_top + right.slope * (v - right.top)
    u = start[:, None] + (end - start)[:, None] * share
    row = np.clip(np.rint(v), 0, level.shape[0] - 1).astype(int)[:, None]
    values = level[row, np.clip(np.rint(u), 0, level.shape[1] - 1).astype(int)].astype(np.float64)
    unevenness = 1.4826 * np.median(np.abs(values - np.median(values)))  # 1-sigma; a few people or wires do not count
    return bool(unevenness <= limit * min(left.contrast, right.contrast))


def _lies_halfway(line: StripeLine, left: StripeLine, right: StripeLine) -> bool:
    """Whether a line could be the centre line between two others, on a good part of their rows."""
    top, bottom = max(line.top, left.top, right.top), min(line.bottom, left.bottom, right.bottom)
    if bottom - top < 0.3 * min(left.rows, right.rows):
        return False
    for v in (top, bottom):
        width = right.x_at(v) - left.x_at(v)
        if width <= 0 or not 0.4 < (line.x_at(v) - left.x_at(v)) / width < 0.6:
            return False
    return True


def _same(one: _Pair, other: _Pair) -> bool:
    """Whether two pairs say the same: sides as near each other as the stripes of a ladder, or lone stripes nearer."""
    share = SAME_LADDER if one.left.spacing_px > 0 else SAME_STRIPE
    for a, b in ((one.left.line, other.left.line), (one.right.line, other.right.line)):
        v = (max(a.top, b.top) + min(a.bottom, b.bottom)) / 2
        width = one.right.line.x_at(v) - one.left.line.x_at(v)
        if abs(a.x_at(v) - b.x_at(v)) > share * max(width, 0.0):
            return False
    return True


def _points(line: StripeLine, config: ClassicalConfig) -> LinePoints:
    sigma = np.full(len(line.points_px), max(line.spread_px, config.sigma_floor_px))
    return LinePoints(line.points_px, np.full(len(sigma), line.fill), sigma)
