"""Where in the image the runway should be: from a prior in the world and a pose, or from the last image."""

import numpy as np
from numpy.typing import NDArray

from deckline.config import WIDEST_USUAL_M, RunwaySurvey
from deckline.detect.crop import Box, box_around
from deckline.geometry import Camera, grid_points, intersect_plane, rotation_matrix
from deckline.types import Detection, Frame, LineVisibility, RunwayEstimate, RunwayPrior

Array = NDArray[np.float64]

MARGIN_SIGMAS = 2.0  # around the prior's lines; a runway farther off is left to the search of the whole image
MIN_DEPTH_M = 1.0  # at which a line that passes the camera is cut
BOX_GRID = grid_points(1.0, 1.0)  # (N, 2) shares of a box that goes through a lens
MAX_AGE_S = 5.0  # of the last image
IMAGE_MARGIN = 0.5  # of the last image's box on every side: what an aircraft turns between frames


def prior_from_survey(survey: RunwaySurvey, deck_width_m: float | None = None) -> RunwayPrior | None:
    """The runway that a survey describes; None without a survey.

    Args:
        deck_width_m: for a survey without a width; None: not stated.
    """
    if survey.ramp_m is None:
        return None
    azimuth = np.deg2rad(survey.heading_deg)
    along = survey.length_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    width_m = survey.width_m or deck_width_m or WIDEST_USUAL_M
    to_right = width_m / 2 * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    left, right = (np.array(survey.ramp_m) + side * to_right + np.outer([0.0, 1.0], along) for side in (-1, 1))
    return RunwayPrior(left, right, survey.sigma_m, float(np.deg2rad(survey.heading_sigma_deg)))


def project_prior(frame: Frame, prior: RunwayPrior) -> Box | None:
    """The part of the image in which the prior's lines lie, with a margin of MARGIN_SIGMAS.

    None where no part of them is in view, without a pose, and for a prior that is not finite.
    """
    pose = frame.world_from_camera
    numbers = [*prior.left_m.ravel(), *prior.right_m.ravel(), prior.sigma_m, prior.azimuth_sigma_rad]
    if pose is None or not np.isfinite(numbers).all():
        return None
    angle = MARGIN_SIGMAS * prior.azimuth_sigma_rad
    lines = _turn(prior, np.array([-angle, 0.0, angle]))
    points = _cut_ahead((lines - pose.translation) @ rotation_matrix(pose))
    if not len(points):  # a straight line's picture is straight: its ends bound it, and so do its margins'
        return None
    margin = MARGIN_SIGMAS * prior.sigma_m / points[:, 2:]
    normalised = points[:, :2] / points[:, 2:]
    return _box_through_lens((normalised - margin).min(axis=0), (normalised + margin).max(axis=0), frame.camera)


def prior_from_box(frame: Frame, box: Box) -> RunwayPrior | None:
    """The place on the deck's plane under the middle of a box of the image, as a runway without length and width.

    None without a pose or the deck's height, and for a box that is not below the camera's horizon.
    """
    pose = frame.world_from_camera
    if pose is None or frame.deck_z_m is None:
        return None
    middle = np.array([[(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]])
    place = intersect_plane(pose.translation, frame.camera.rays(middle) @ rotation_matrix(pose).T, frame.deck_z_m)[0]
    if frame.deck_z_m <= pose.translation[2] or not np.isfinite(place).all():
        return None
    ends = np.tile(place, (2, 1))
    return RunwayPrior(ends, ends, 0.0, 0.0)


def _turn(prior: RunwayPrior, angles_rad: Array) -> Array:
    """Both lines turned about the middle of their near ends by angles (A,): (2 A, 2, 3)."""
    pivot = (prior.left_m[0] + prior.right_m[0]) / 2
    cos, sin, zero = np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad))
    rotations = np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)
    lines = np.concatenate([prior.left_m, prior.right_m]) - pivot
    return (pivot + lines @ rotations).reshape(-1, 2, 3)


def _cut_ahead(lines_m: Array) -> Array:
    """Of lines' ends (L, 2, 3) in the optical frame, those of the parts ahead of the camera: (N, 3)."""
    depth = lines_m[..., 2]
    is_ahead, is_behind = depth.max(axis=1) > MIN_DEPTH_M, depth < MIN_DEPTH_M
    near, away = lines_m[:, 0], lines_m[:, 1] - lines_m[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # of lines that are not cut
        cut = near + ((MIN_DEPTH_M - near[:, 2]) / away[:, 2])[:, None] * away
    ends = np.where(is_behind[..., None], cut[:, None], lines_m)
    return np.asarray(ends[is_ahead].reshape(-1, 3))


def _box_through_lens(low: Array, high: Array, camera: Camera) -> Box | None:
    """A box in normalised image coordinates without distortion -> the box of what of it is in the image.

    It is cut to what the lens reaches first: distortion coefficients bend what is far outside back into the image.
    """
    least, most = camera.reach
    low, high = np.maximum(low, least), np.minimum(high, most)
    if not (low < high).all():
        return None
    rays = np.ones((len(BOX_GRID), 3))
    rays[:, :2] = low + BOX_GRID * (high - low)
    pixels = camera.project(rays)
    u0, v0 = np.clip(pixels.min(axis=0), -0.5, [camera.width - 1.5, camera.height - 1.5])
    u1, v1 = np.clip(pixels.max(axis=0), [u0 + 1.0, v0 + 1.0], [camera.width - 0.5, camera.height - 0.5])
    return float(u0), float(v0), float(u1), float(v1)


def widen(box: Box) -> Box:
    """A box of the last image with the margin that the next one needs."""
    u0, v0, u1, v1 = box
    margin = IMAGE_MARGIN * max(u1 - u0, v1 - v0)
    return u0 - margin, v0 - margin, u1 + margin, v1 + margin


class ImagePrior:
    """Carries the last image's lines forward, for frames of one flight in their order that no tracker can follow.

    Without a pose nothing better is known; with one a tracker predicts better. Constant memory. An image older than
    MAX_AGE_S is forgotten.
    """

    def __init__(self) -> None:
        self._last: tuple[float, tuple[int, int], Box] | None = None  # time, s; image size, px; box around both lines

    def predict(self, frame: Frame) -> Box | None:
        """Where the runway was in the last image, with a margin; None when it was not seen lately."""
        if self._last is not None and frame.time_s - self._last[0] > MAX_AGE_S:
            self._last = None
        if self._last is None or self._last[1] != (frame.camera.width, frame.camera.height):
            return None
        return widen(self._last[2])

    def update(self, frame: Frame, detection: Detection, estimate: RunwayEstimate) -> None:
        """Remember what was seen in a frame, if both lines were and agree."""
        if estimate.seen is not LineVisibility.BOTH:
            return
        box = box_around(detection.left, detection.right)
        self._last = frame.time_s, (frame.camera.width, frame.camera.height), box
