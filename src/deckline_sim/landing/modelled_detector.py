"""Detections drawn from `detection_model`, look by look, and flights of drawn detections."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import RigidTransform

from deckline.config import RunConfig
from deckline.dehaze.base import IdentityDehazer
from deckline.detect.crop import Box
from deckline.flight import Flight
from deckline.geometry import Camera
from deckline.localize import Localizer, localize
from deckline.types import Detection, LinePoints, Segment
from deckline_sim.landing.detection_model import DEPTHS, RANGE_M, SIZE_PX, DetectionModel, Presence

Array = NDArray[np.float64]
MIN_AHEAD_M = 1.0  # of the camera: what is nearer is cut
MIN_ROWS_PX = 1.0  # of a line in the image; shorter ones are not found
MOST_TRIMMED = 0.8  # share of a line's rows, at its far end
SCORES = ("offset", "slope", "nearest point", "reported sigma")
OUTWARD = (-1.0, 1.0)  # sign of an error away from the runway, of the left and the right line
CONFIDENCE = 0.9  # of every modelled point


class LineState:
    """What a line's errors keep from look to look."""

    def __init__(self) -> None:
        self.false_s = 0.0  # time that it goes on being another line
        self.false_m = 0.0  # distance of that line to the right


class ModelledDetector:
    """Draws the detections of one flight, in the order of its pictures.

    Args:
        model: of the detector.
        is_dark: at dusk or night.
        visibility_m: at 2 % contrast, m.
        rng: draws everything.
    """

    def __init__(self, model: DetectionModel, is_dark: bool, visibility_m: float, rng: np.random.Generator) -> None:
        self.model = model
        self.is_dark = is_dark
        self.visibility_m = visibility_m
        self.rng = rng
        self.kept = float(rng.standard_normal())  # of the latent variable
        self.now = float(rng.standard_normal())
        self.lines = (LineState(), LineState())
        self.slow: Array = rng.standard_normal((3, len(SCORES)))  # scores of left, right and what both share
        self.new: Array = rng.standard_normal((3, len(SCORES)))
        self.time_s: float | None = None

    def detect(
        self, time_s: float, lines: tuple[Segment, Segment], world_from_camera: RigidTransform, camera: Camera
    ) -> Detection:
        """The points of one picture.

        Args:
            time_s: of the picture.
            lines: left and right, true.
            world_from_camera: true.
            camera: true, a pinhole.
        """
        self._advance(1.0 / self.model.rate_hz if self.time_s is None else time_s - self.time_s)
        self.time_s = time_s
        camera_from_world = world_from_camera.inv()
        range_m = float(np.linalg.norm(((lines[0].p0_m + lines[1].p0_m) / 2 - world_from_camera.translation)[:2]))
        width_px = camera.fx * float(np.linalg.norm(lines[1].p0_m - lines[0].p0_m)) / max(range_m, MIN_AHEAD_M)
        points = [LinePoints.empty(), LinePoints.empty()]
        for side, is_found in enumerate(self._find(range_m, width_px)):
            ends_m = camera_from_world.apply(np.stack([lines[side].p0_m, lines[side].p1_m]))
            ends_px = visible_ends(camera, ends_m) if is_found else None
            if ends_px is not None:
                points[side] = self._draw(side, ends_px, range_m, camera)
        return Detection(points[0], points[1])

    def _advance(self, passed_s: float) -> None:
        presence, errors, false = self.model.presence, self.model.errors, self.model.false_lines
        kept = float(np.exp(-passed_s / presence.correlation_s))
        self.now = kept * self.now + np.sqrt(1.0 - kept**2) * float(self.rng.standard_normal())
        kept = float(np.exp(-passed_s / errors.correlation_s))
        self.slow = kept * self.slow + np.sqrt(1.0 - kept**2) * self.rng.standard_normal(self.slow.shape)
        self.new = self.rng.standard_normal(self.new.shape)
        for line in self.lines:
            line.false_s -= passed_s
            if line.false_s <= 0.0 and self.rng.random() < false.per_s * passed_s:
                line.false_s = float(self.rng.exponential(false.seconds))
                line.false_m = false.offset_m * float(self.rng.standard_normal())

    def _find(self, range_m: float, width_px: float) -> tuple[bool, bool]:
        """Which of left and right are found; of one line, that of the larger score."""
        presence = self.model.presence
        share = presence.flight_share
        latent = latent_mean(presence, range_m / self.visibility_m, width_px, self.is_dark)
        latent += float(np.sqrt(share) * self.kept + np.sqrt(1.0 - share) * self.now)
        if latent > 0.0:
            return True, True
        is_left = bool(self.slow[0, 0] > self.slow[1, 0])
        return (is_left, not is_left) if latent > -presence.one_line else (False, False)

    def _scores(self, side: int, range_m: float) -> Array:
        """Scores of unit variance of a line's `SCORES` in this picture."""
        errors = self.model.errors
        slow = np.array([errors.slow_share, errors.slow_share, self.model.extent.near_slow_share, errors.slow_share])
        scores = np.sqrt(slow) * self.slow + np.sqrt(1.0 - slow) * self.new
        offset = float(np.interp(range_m, RANGE_M, errors.offset_between))
        between = np.array([offset, 0.0, self.model.extent.near_between, 1.0])
        mixed: Array = np.sqrt(1.0 - between) * scores[side] + np.sqrt(between) * scores[2]
        return mixed

    def _draw(self, side: int, ends_px: Array, range_m: float, camera: Camera) -> LinePoints:
        """Points of a line with these visible ends."""
        errors, depth, state = self.model.errors, range_m / self.visibility_m, self.lines[side]
        offset, slope, nearest, spread = self._scores(side, range_m)
        share = self._draw_shares(depth, range_m, float(nearest))
        along = 1.0 - 2.0 * (share - share[0]) / max(share[-1] - share[0], 1e-9)  # 1 at the near end, -1 at the far one
        u, v, inverse_m = (start + share * (end - start) for start, end in zip(*ends_px, strict=True))
        middle = np.interp(range_m, RANGE_M, errors.log_sigma) + np.interp(depth, DEPTHS, errors.log_sigma_depth)
        middle_px = float(np.exp(middle + errors.log_sigma_spread * spread))
        sigma = middle_px * np.exp(along * np.interp(range_m, RANGE_M, errors.log_sigma_rows))
        common = offset * np.interp(range_m, RANGE_M, errors.offset)
        tilt = slope * np.interp(range_m, RANGE_M, errors.slope)
        tilt += OUTWARD[side] * np.interp(range_m, RANGE_M, errors.slope_outward)
        step_px = abs(float(v[0] - v[-1])) / (len(v) - 1)
        white = correlated_noise(len(v), float(np.exp(-step_px / errors.rows_px)), self.rng)
        u = u + middle_px * (common + tilt * along) + sigma * white * np.interp(range_m, RANGE_M, errors.white)
        if state.false_s > 0.0:
            u = u + state.false_m * camera.fx * inverse_m
        is_inside = (u >= 0.0) & (u <= camera.width - 1) & (v >= 0.0) & (v <= camera.height - 1)
        points = np.column_stack([u, v])[is_inside]
        return LinePoints(points, np.full(len(points), CONFIDENCE), sigma[is_inside])

    def _draw_shares(self, depth: float, range_m: float, nearest: float) -> Array:
        """Where a line has points, as shares of the way from its near to its far end."""
        extent = self.model.extent
        whole = float(np.interp(depth, DEPTHS, extent.points))
        far = min(float(self.rng.exponential(np.interp(depth, DEPTHS, extent.far))), MOST_TRIMMED)
        mean, sigma = (np.interp(range_m, RANGE_M, table) for table in (extent.near_steps, extent.near_steps_spread))
        near = min(float(mean + sigma * nearest) / whole, MOST_TRIMMED - far / 2)
        return np.linspace(near, 1.0 - far, max(round(whole * (1.0 - near - far)), 2))


class NoDetector:
    """The detector of a flight whose points are all drawn."""

    name = "drawn"

    def __call__(self, image_rgb: NDArray[np.uint8], prior_box: Box | None = None) -> Detection:
        raise AssertionError("unreachable: every detection is given")


def point_flight(config: RunConfig, localizer: Localizer = localize) -> Flight:
    """A flight whose detections are all given."""
    return Flight(config, IdentityDehazer(), NoDetector(), localizer)


def latent_mean(presence: Presence, depth: float | Array, width_px: float | Array, is_dark: bool) -> float | Array:
    """Mean of the latent variable of presence.

    Args:
        depth: distance to the ramp in visibilities.
        width_px: apparent width of the runway at the ramp, px.
        is_dark: at dusk or night.
    """
    size = np.log(np.minimum(width_px, 10.0 * SIZE_PX) / SIZE_PX)
    return presence.intercept + presence.per_visibility * depth + presence.per_size * size + presence.dusk * is_dark


def visible_ends(camera: Camera, ends_m: Array) -> Array | None:
    """u, v, px, and inverse distance along the axis, 1/m, (2, 3) of a line's near and far visible end.

    None for a line that is not in the image or covers less than `MIN_ROWS_PX` rows. All three are linear along the
    line's picture.

    Args:
        camera: a pinhole.
        ends_m: (2, 3) near and far end in the camera's frame, m.
    """
    near, far = ends_m
    if far[2] <= MIN_AHEAD_M:
        return None
    if near[2] < MIN_AHEAD_M:
        near = near + (MIN_AHEAD_M - near[2]) / (far[2] - near[2]) * (far - near)
    cut = np.stack([near, far])
    ends = np.column_stack([camera.project(cut), 1.0 / cut[:, 2]])
    share = np.array([0.0, 1.0])
    for axis, last in ((0, camera.width - 1.0), (1, camera.height - 1.0)):
        start, end = ends[:, axis]
        if start == end:
            if not 0.0 <= start <= last:
                return None
            continue
        inside = np.sort((np.array([0.0, last]) - start) / (end - start))
        share = np.array([max(share[0], inside[0]), min(share[1], inside[1])])
    clipped: Array = ends[0] + share[:, None] * (ends[1] - ends[0])
    return clipped if share[0] < share[1] and abs(clipped[0, 1] - clipped[1, 1]) >= MIN_ROWS_PX else None


def correlated_noise(count: int, correlation: float, rng: np.random.Generator) -> Array:
    """Unit-variance noise (N,) whose neighbours have a correlation: a first-order autoregression."""
    white = rng.standard_normal(count)
    white[1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], white))
