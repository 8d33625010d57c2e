"""A line finder without weights: bright stripes, straight lines through them, and the pair that could be a runway.

A runway's edges are two bright stripes, or ladders of two stripes each, on something darker and even. They are
straight, side by side, converge with distance, and have similar contrast. Without a distinct best pair no
runway is reported. A prior's box is then magnified and searched alone: fewer stripes compete with the runway there, and
a far one has more rows.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deckline.checks import check_image
from deckline.detect.crop import Box, box_around, check_box
from deckline.types import Detection, LinePoints
from deckline_lab.rivals.stripes import StripeConfig, StripeLine, find_stripes, midline

# Thresholds were set on 180 clear views of the simulator (presets paper, cvn, axial and random ships), so that most
# returned pairs are right; `deckline eval detection` measures them on other views.
MIN_POINTS = 3  # of a line that is returned
# Two pairs closer than this, side by side, are one: the stripes of a ladder; lone stripes.
SAME_LADDER, SAME_STRIPE = 0.2, 0.03  # of a pair's width, from side to side


@dataclass(frozen=True)
class ClassicalConfig:
    """What counts as a runway."""

    stripes: StripeConfig = field(default_factory=StripeConfig)
    min_overlap: float = 0.6  # rows that both lines have, over the rows of the longer one
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
    prior_width_px: float = 320.0  # to which a prior's box is magnified
    max_magnification: int = 4


class ClassicalDetector:
    """Stripes, straight lines and the one distinct best pair; deterministic."""

    name = "classical"

    def __init__(self, config: ClassicalConfig | None = None) -> None:
        self.config = config or ClassicalConfig()

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection:
        """Both lines in an image (H, W, 3) uint8 RGB; `prior_box` is searched if the whole image shows no runway."""
        check_image(image_rgb)
        found = _find_runway(image_rgb, self.config)
        if prior_box is None or len(found.left):
            return found
        return _find_in_box(image_rgb, check_box(prior_box), self.config)


class _Marking(NamedTuple):
    """What could be the marking of one edge."""

    line: StripeLine  # a stripe, or the middle of a ladder
    spacing_px: float  # of a ladder's two stripes, in the middle of its rows; 0 for a stripe


class _Pair(NamedTuple):
    """Two markings that could be a runway's edges."""

    left: _Marking
    right: _Marking
    score: float


def _find_runway(image_rgb: NDArray[np.uint8], config: ClassicalConfig) -> Detection:
    pair = _best_pair(_find_markings(find_stripes(image_rgb, config.stripes), config), image_rgb.min(axis=2), config)
    if pair is None:
        return Detection(LinePoints.empty(), LinePoints.empty())
    left, right = (_line_points(side.line, config) for side in (pair.left, pair.right))
    return Detection(left, right, box_around(left, right))


def _line_points(line: StripeLine, config: ClassicalConfig) -> LinePoints:
    sigma = np.full(len(line.points_px), max(line.spread_px, config.sigma_floor_px))
    return LinePoints(line.points_px, np.full(len(sigma), line.fill), sigma)


def _find_in_box(image_rgb: NDArray[np.uint8], box: Box, config: ClassicalConfig) -> Detection:
    """What is found in a magnified part of the image, in the image's pixels; one point for each of its rows."""
    import cv2  # here: training imports this package on machines without OpenCV

    height, width = image_rgb.shape[:2]
    u0, v0 = int(np.clip(np.floor(box[0]), 0, width - 1)), int(np.clip(np.floor(box[1]), 0, height - 1))
    u1 = int(np.clip(np.ceil(box[2]) + 1, u0 + 1, width))
    v1 = int(np.clip(np.ceil(box[3]) + 1, v0 + 1, height))
    factor = int(np.clip(config.prior_width_px // (u1 - u0), 1, config.max_magnification))
    part = np.asarray(cv2.resize(image_rgb[v0:v1, u0:u1], None, fx=factor, fy=factor), dtype=np.uint8)  # bilinear
    found = _find_runway(part, config)
    one_a_row = slice(factor // 2, None, factor)
    left, right = (
        LinePoints(
            (side.points_px[one_a_row] + 0.5) / factor - 0.5 + np.array([u0, v0]),
            side.confidence[one_a_row],
            side.sigma_px[one_a_row] / factor,
        )
        for side in (found.left, found.right)
    )
    if min(len(left), len(right)) < MIN_POINTS:
        return Detection(LinePoints.empty(), LinePoints.empty())
    return Detection(left, right, (float(u0), float(v0), float(u1 - 1), float(v1 - 1)))


def _find_markings(lines: list[StripeLine], config: ClassicalConfig) -> list[_Marking]:
    found = [_Marking(line, 0.0) for line in lines]
    for left in lines:
        for right in lines:
            top, bottom = _common_rows(left, right)
            if left is right or bottom - top < config.ladder_ratio * max(left.rows, right.rows):
                continue
            far, near = (right.x_at(v) - left.x_at(v) for v in (top, bottom))
            if far <= 0 or near < far or _ratio(left.contrast, right.contrast) < config.ladder_ratio:
                continue
            if near < config.ladder[1] * config.aspect[1] * (bottom - top):
                found.append(_Marking(midline(left, right), (near + far) / 2))
    return [marking for marking in found if len(marking.line.points_px) >= config.stripes.min_rows]


def _best_pair(markings: list[_Marking], level: NDArray[np.uint8], config: ClassicalConfig) -> _Pair | None:
    """The pair of the best score; None if a pair elsewhere is nearly as good."""
    scored = (_score_pair(left, right, markings, level, config) for left in markings for right in markings)
    pairs = sorted((pair for pair in scored if pair is not None), key=lambda pair: -pair.score)
    if not pairs:
        return None
    others = [pair.score for pair in pairs[1:] if not _is_same_pair(pairs[0], pair)]
    return pairs[0] if not others or pairs[0].score >= config.min_margin * others[0] else None


def _score_pair(
    left: _Marking, right: _Marking, markings: list[_Marking], level: NDArray[np.uint8], config: ClassicalConfig
) -> _Pair | None:
    """A pair with the score of its likeness to a runway's edges; None where it cannot be one."""
    a, b = left.line, right.line
    top, bottom = _common_rows(a, b)
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
    if _unevenness_between(a, b, level) > config.max_unevenness * min(a.contrast, b.contrast):
        return None
    score = 2 / (1 / a.support + 1 / b.support) * np.sqrt(contrasts)
    score *= config.ladder_factor if ladders else 1.0
    score *= config.halfway_factor if any(_is_halfway(third.line, a, b) for third in markings) else 1.0
    return _Pair(left, right, float(score))


def _common_rows(*lines: StripeLine) -> tuple[float, float]:
    """First and last row that lines share; the last one is above the first where they share none."""
    return max(line.top for line in lines), min(line.bottom for line in lines)


def _ratio(one: float, other: float) -> float:
    """The smaller over the larger."""
    return min(one, other) / max(one, other)


def _ladders_agree(left: _Marking, right: _Marking, width_px: float, config: ClassicalConfig) -> bool:
    """Whether both ladders are about as wide, and as wide as a ladder is for a pair of that width."""
    low, high = (share * width_px for share in config.ladder)
    fits = all(low <= side.spacing_px <= high for side in (left, right))
    return fits and _ratio(left.spacing_px, right.spacing_px) >= config.ladder_ratio


def _unevenness_between(left: StripeLine, right: StripeLine, level: NDArray[np.uint8]) -> float:
    """1-sigma of the grey levels between two lines and beside a centre line; robust against people and wires."""
    v = np.linspace(*_common_rows(left, right), 12)
    share = np.concatenate([np.linspace(0.25, 0.42, 6), np.linspace(0.58, 0.75, 6)])
    start, end = left.x_at(v), right.x_at(v)
    u = start[:, None] + (end - start)[:, None] * share
    row = np.clip(np.rint(v), 0, level.shape[0] - 1).astype(int)[:, None]
    values = level[row, np.clip(np.rint(u), 0, level.shape[1] - 1).astype(int)].astype(np.float64)
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _is_halfway(line: StripeLine, left: StripeLine, right: StripeLine) -> bool:
    """Whether a line could be the centre line between two others, on a good part of their rows."""
    rows = _common_rows(line, left, right)
    if rows[1] - rows[0] < 0.3 * min(left.rows, right.rows):
        return False
    for v in rows:
        width = right.x_at(v) - left.x_at(v)
        if width <= 0 or not 0.4 < (line.x_at(v) - left.x_at(v)) / width < 0.6:
            return False
    return True


def _is_same_pair(one: _Pair, other: _Pair) -> bool:
    """Whether the sides of two pairs are as near each other as the stripes of a ladder, or lone stripes nearer."""
    share = SAME_LADDER if one.left.spacing_px > 0 else SAME_STRIPE
    for a, b in ((one.left.line, other.left.line), (one.right.line, other.right.line)):
        v = sum(_common_rows(a, b)) / 2
        width = one.right.line.x_at(v) - one.left.line.x_at(v)
        if abs(a.x_at(v) - b.x_at(v)) > share * max(width, 0.0):
            return False
    return True
