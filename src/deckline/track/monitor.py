"""Monitors over frames: faults that last, lines that change places, and a camera that repeats its picture."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from deckline.config import RunConfig
from deckline.geometry import intersect_plane
from deckline.track.extent import Extent
from deckline.track.filter import ANGLE, SPACING, State
from deckline.track.integrity import Residuals, bias_flag, residual_flag
from deckline.track.measurement import GatedMeasurement
from deckline.types import Frame, Notice, Notices, Reason, RunwayEstimate, RunwayLine

LEARNED_SIGMA_M = 1.0  # of a spacing, below which it counts as learned
MIN_SPACING_M = 1.0  # below this left and right are swapped
SAMPLE_PX = 37  # every so many rows and columns of the picture are compared
MIN_TURN_RAD, MIN_MOVE_M = 1e-3, 0.1  # of the camera, which every picture shows
MIN_EXPECTED_MOTION_PX = 0.5  # of the lines in the image, before their rest means anything
MAX_REST_SHARE = 0.02  # of the expected motion, below which the lines rest
MIN_RESTING_FRAMES = 3  # in a row


@dataclass(frozen=True, eq=False)
class FaultMonitor:
    """Memory of contradictions between measurements and track."""

    residuals: Residuals = field(default_factory=Residuals)
    since_s: dict[Reason, float] = field(default_factory=dict)  # since when a measurement is left out
    learned: State | None = None  # with the spacing that was learned before the track began again

    def update(self, gated: GatedMeasurement | None, time_s: float, step_s: float, config: RunConfig) -> "FaultMonitor":
        """After one more frame; a frame without a line says nothing of those that are left out."""
        residuals = self.residuals.update(gated, step_s, config.integrity.window_s)
        if gated is None:
            return replace(self, residuals=residuals)
        since = {notice.reason: self.since_s.get(notice.reason, time_s) for notice in gated.excluded}
        return replace(self, residuals=residuals, since_s=since)

    def restart(self, before: State | None) -> "FaultMonitor":
        """For a new track: what was learned of the old one is kept."""
        learned = before is not None and np.sqrt(before.covariance[SPACING, SPACING]) < LEARNED_SIGMA_M
        return FaultMonitor(since_s=self.since_s, learned=before if learned and self.learned is None else self.learned)

    def active_flags(
        self,
        gated: GatedMeasurement | None,
        state: State | None,
        extent: Extent | None,
        time_s: float,
        config: RunConfig,
    ) -> Notices:
        """All flags of one frame."""
        flags: list[Notice | None] = []
        for notice in () if gated is None else gated.excluded:
            since = self.since_s.get(notice.reason, time_s)
            if time_s - since >= config.integrity.persist_s:
                flags.append(Notice(notice.reason, f"{notice.message}, for {time_s - since:.1f} s"))
        if state is not None:
            near_m = 0.0 if extent is None else float(state.local(extent.near_m)[0])
            flags += [bias_flag(state, near_m, config), residual_flag(self.residuals, config)]
            flags += [] if self.learned is None else [_spacing_flag(self.learned, state, config)]
        return tuple(flag for flag in flags if flag is not None)


def check_order(lines: dict[str, RunwayLine]) -> Notice | None:
    """A flag for two lines that cannot be left and right of one runway."""
    if "left" not in lines or "right" not in lines:
        return None
    left, right = lines["left"], lines["right"]
    lateral_axis = np.array([-left.direction[1], left.direction[0], 0.0])
    spacing = float((right.point_m - left.point_m) @ lateral_axis)
    if spacing > MIN_SPACING_M:
        return None
    return Notice(Reason.SWAPPED, f"the right line lies {-spacing:.1f} m left of the left line")


def _spacing_flag(learned: State, state: State, config: RunConfig) -> Notice | None:
    """A flag for lines whose spacing differs from that before the track began again."""
    x = float(learned.local(state.point_m)[0])
    before = float(learned.mean[SPACING] + learned.mean[ANGLE] * x)
    jacobian = np.zeros(len(learned.mean))
    jacobian[[SPACING, ANGLE]] = 1.0, x
    variance = float(jacobian @ learned.covariance @ jacobian + state.covariance[SPACING, SPACING])
    innovation = float(state.mean[SPACING]) - before
    if abs(innovation) < config.integrity.alarm_sigma * np.sqrt(variance):
        return None
    message = f"the lines are {state.mean[SPACING]:.1f} m apart and were {before:.1f} m apart before"
    return Notice(Reason.SPACING, message)


@dataclass(frozen=True, eq=False)
class FrozenImageMonitor:
    """Memory of the last picture, to notice one that is shown again while the aircraft moves.

    Equal pixels decide where a picture has any contrast. Lines that rest in the image although the pose says they must
    move are the other sign.
    """

    sample: NDArray[np.uint8] | None = None
    frame: Frame | None = None  # without pictures
    estimate: RunwayEstimate | None = None
    resting: int = 0  # frames in a row in which lines rested though they should have moved
    is_frozen: bool = False

    def update(self, frame: Frame, estimate: RunwayEstimate) -> "FrozenImageMonitor":
        """After one more frame."""
        sample = frame.image_rgb[::SAMPLE_PX, ::SAMPLE_PX].copy()
        bare = _without_pictures(frame)
        if self.sample is None or self.frame is None or self.sample.shape != sample.shape:
            return FrozenImageMonitor(sample, bare, estimate)
        same = bool(np.ptp(sample)) and bool(np.array_equal(self.sample, sample)) and _has_moved(self.frame, frame)
        resting = self.resting + 1 if self._lines_rest(frame, estimate) else 0
        return FrozenImageMonitor(sample, bare, estimate, resting, same or resting >= MIN_RESTING_FRAMES)

    def _lines_rest(self, frame: Frame, estimate: RunwayEstimate) -> bool:
        """Whether all lines lie where they lay although they should have moved."""
        before, pose = None if self.frame is None else self.frame.world_from_camera, frame.world_from_camera
        if before is None or pose is None or self.estimate is None:
            return False
        sides = set(self.estimate.pixel_lines) & set(estimate.pixel_lines) & set(self.estimate.lines)
        expected_px, actual_px = 0.0, 0.0
        for side in sides:
            line = self.estimate.pixel_lines[side]
            rays = before.rotation.apply(frame.camera.rays(line.ends_px))
            on_deck = intersect_plane(before.translation, rays, self.estimate.lines[side].height_m)
            optical = pose.inv().apply(np.where(np.isfinite(on_deck), on_deck, pose.translation))
            a, b, c = line.coefficients
            expected = frame.camera.project(optical) @ [a, b] + c
            a, b, c = estimate.pixel_lines[side].coefficients
            if np.isfinite(expected).any():
                expected_px = max(expected_px, float(np.nanmax(np.abs(expected))))
            actual_px = max(actual_px, float(np.max(np.abs(line.ends_px @ [a, b] + c))))
        return expected_px > MIN_EXPECTED_MOTION_PX and actual_px < MAX_REST_SHARE * expected_px


def _without_pictures(frame: Frame) -> Frame:
    """The frame's pose and camera; pictures would keep memory."""
    height, width = frame.camera.height, frame.camera.width
    black = np.broadcast_to(np.zeros((1, 1, 3), dtype=np.uint8), (height, width, 3))
    return replace(frame, image_rgb=black, depth_m=None, truth=None)


def _has_moved(before: Frame, now: Frame) -> bool:
    """Whether the camera turned or moved by what every picture shows."""
    first, second = before.world_from_camera, now.world_from_camera
    if first is None or second is None:
        return False
    turn = (first.rotation.inv() * second.rotation).magnitude()
    return bool(turn > MIN_TURN_RAD or np.linalg.norm(second.translation - first.translation) > MIN_MOVE_M)
