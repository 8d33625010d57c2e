"""How a place moves through the pictures of a flight: by their poses and the deck's plane, or by the pictures alone."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.detect.crop import Box, Crop
from deckline.detect.prior import prior_from_box
from deckline.detect.registration import measure_affine, measure_shift
from deckline.geometry import Camera, rotation_matrix
from deckline.types import Frame, RunwayPrior

MIN_HEIGHT_M = 1.0  # of a camera above the deck, below which the plane gives no homography

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KeptPicture:
    """One picture with its camera."""

    image_rgb: NDArray[np.uint8]  # (H, W, 3); not copied
    camera: Camera
    world_from_camera: RigidTransform | None
    time_s: float


class Motion(Protocol):
    """Where a crop of a new picture lies in an old one."""

    def corners(self, old: KeptPicture, new: KeptPicture, crop: Crop, size: tuple[int, int]) -> Float64 | None:
        """Image px (4, 2) of the crop's corners, clockwise from the upper left one; None: not in view.

        Args:
            size: width and height of the network's image.
        """

    def range_ratio(self, old: KeptPicture, new: KeptPicture) -> float:
        """How much farther away the place was in the old picture: 1 for a camera at rest."""

    def register(self, reference: Float32, sampled: Float32, cell_px: int) -> Float64 | None:
        """What a picture sampled between the corners is still off: (3, 3), from places of a reference, network px.

        Args:
            reference, sampled: (height, width) grey levels; NaN is unknown.
            cell_px: as for `registration.measure_shift`.

        Returns:
            None where it does not show the same place.
        """


@dataclass(frozen=True, eq=False)
class DeckMotion:
    """By the poses, for places of a horizontal plane that moves."""

    runway: RunwayPrior
    """Where the runway should be, world: the plane lies at its mean height."""
    velocity_m_s: Float64
    """(2,) of the ship, north and east."""

    def corners(self, old: KeptPicture, new: KeptPicture, crop: Crop, size: tuple[int, int]) -> Float64 | None:
        homography = plane_homography(old, new, float(self._place_m()[2]), self.velocity_m_s)
        if homography is None:
            return None
        rays = new.camera.rays(crop.to_image(crop_corners(size))) @ homography.T
        return old.camera.project(rays) if (rays[:, 2] > 0).all() else None

    def range_ratio(self, old: KeptPicture, new: KeptPicture) -> float:
        if old.world_from_camera is None or new.world_from_camera is None:
            return 1.0
        place = self._place_m()
        earlier = place - np.array([*(new.time_s - old.time_s) * self.velocity_m_s, 0.0])
        new_m = np.linalg.norm(place - new.world_from_camera.translation)
        return float(np.linalg.norm(earlier - old.world_from_camera.translation) / new_m)

    def register(self, reference: Float32, sampled: Float32, cell_px: int) -> Float64 | None:
        shift = measure_shift(reference, sampled, cell_px)
        return None if shift is None else np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])

    def _place_m(self) -> Float64:
        return np.asarray(np.concatenate([self.runway.left_m, self.runway.right_m]).mean(axis=0))


def place_motion(frame: Frame, box: Box, velocity_m_s: Float64) -> DeckMotion | None:
    """Of the place on the deck's plane under the middle of a box; None without a pose, the deck's height or a place.

    Args:
        velocity_m_s: (2,) of the ship, north and east.
    """
    place = prior_from_box(frame, box)
    return None if place is None else DeckMotion(place, velocity_m_s)


class SeenMotion:
    """By what the pictures show: from the newest one back, the place grows, turns and drifts at about constant rates.

    Of one crop; every older picture is looked for where the one after it tells. What is registered is affine, as the
    near part of a plane grows faster than the far one; the rates are those of a similarity.
    """

    def __init__(self) -> None:
        self.expansion_per_s = 0.0  # closing speed over range, by the pictures registered
        self._turn_rad_s = 0.0
        self._drift_px_s = np.zeros(2)  # of the crop's middle, from new pictures to older ones, network px
        self._age_s, self._middle_px = 0.0, np.zeros(2)  # of the last picture sampled

    def corners(self, old: KeptPicture, new: KeptPicture, crop: Crop, size: tuple[int, int]) -> Float64 | None:
        if old.image_rgb.shape != new.image_rgb.shape:
            return None
        corners, self._age_s = crop_corners(size), new.time_s - old.time_s
        self._middle_px = corners.mean(axis=0)
        at = (corners - self._middle_px) @ self._matrix().T + self._middle_px + self._age_s * self._drift_px_s
        return crop.to_image(at)

    def range_ratio(self, old: KeptPicture, new: KeptPicture) -> float:
        return 1.0 + self.expansion_per_s * (new.time_s - old.time_s)

    def register(self, reference: Float32, sampled: Float32, cell_px: int) -> Float64 | None:
        found = measure_affine(reference, sampled, cell_px)
        if found is None:
            return None
        matrix, age_s, middle = self._matrix(), self._age_s, self._middle_px
        shift = found[:2, :2] @ middle + found[:2, 2] - middle
        zoom = np.sqrt(np.linalg.det(found) * np.linalg.det(matrix))
        self.expansion_per_s = float(1 / zoom - 1) / age_s
        self._turn_rad_s += float(np.arctan2(found[1, 0] - found[0, 1], found[0, 0] + found[1, 1])) / age_s
        self._drift_px_s = self._drift_px_s + matrix @ shift / age_s
        return found

    def _matrix(self) -> Float64:
        """(2, 2) about the middle, from a place in the newest picture to that in the last one sampled."""
        angle = self._age_s * self._turn_rad_s
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return turn / (1.0 + self._age_s * self.expansion_per_s)


def crop_corners(size: tuple[int, int]) -> Float64:
    """Network px (4, 2) of the outermost pixels of a network's image (width, height), clockwise."""
    width, height = size
    return np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)


def plane_homography(
    old: KeptPicture, new: KeptPicture, plane_z_m: float, velocity_m_s: Float64
) -> NDArray[np.float64] | None:
    """Matrix (3, 3) from rays of a new picture to those of an old one, for points of a horizontal plane that moves.

    A point on the ray r of the new camera lies at c_n + R_n r h / (R_n r)_z, h the plane's depth below the camera; the
    old camera saw it at that place less the plane's way since. None without poses, and where the new camera is not
    above the plane.
    Source: Hartley and Zisserman, "Multiple view geometry", 2004, section 13.1.
    """
    if old.world_from_camera is None or new.world_from_camera is None:
        return None
    height_m = plane_z_m - new.world_from_camera.translation[2]
    if height_m < MIN_HEIGHT_M:
        return None
    moved = new.world_from_camera.translation - old.world_from_camera.translation
    moved[:2] -= (new.time_s - old.time_s) * velocity_m_s
    world_from_new = rotation_matrix(new.world_from_camera)
    in_plane = np.eye(3) + np.outer(moved, [0.0, 0.0, 1.0]) / height_m
    return np.asarray(rotation_matrix(old.world_from_camera).T @ in_plane @ world_from_new)
