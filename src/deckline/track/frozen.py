"""A camera that shows the same picture while the aircraft moves on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import intersect_plane
from deckline.types import Frame, RunwayEstimate

SAMPLE_PX = 37  # every so many rows and columns of the picture are compared
SHARPEST = 1e-3  # rad; movement that every camera shows
MOVED_PX = 0.5  # by which lines should have moved in the image, at least, before their rest means anything
RESTED = 0.02  # of that, by which they have moved in fact
LOOKS = 3  # pictures in a row whose lines rest


@dataclass(frozen=True, eq=False)
class Look:
    """What is kept of a picture."""

    sample: NDArray[np.uint8]
    frame: Frame
    estimate: RunwayEstimate
    resting: int = 0  # pictures in a row in which lines rested though they should have moved


def looked(before: Look | None, frame: Frame, estimate: RunwayEstimate) -> tuple[Look, bool]:
    """What to keep of this picture, and whether it is an old one shown again.

    Equal pixels decide where a picture has any contrast; lines that stay where they are in the image although the pose
    says they must move are the other sign.
    """
    bare = _without_pictures(frame)
    now = Look(frame.image_rgb[::SAMPLE_PX, ::SAMPLE_PX].copy(), bare, estimate)
    if before is None or before.sample.shape != now.sample.shape:
        return now, False
    same = bool(np.ptp(now.sample)) and bool(np.array_equal(before.sample, now.sample)) and _moved(before.frame, frame)
    resting = before.resting + 1 if _rests(before, frame, estimate) else 0
    return Look(now.sample, bare, estimate, resting), same or resting >= LOOKS


def _without_pictures(frame: Frame) -> Frame:
    """The frame's pose and camera; the pictures would keep memory."""
    height, width = frame.camera.height, frame.camera.width
    black = np.broadcast_to(np.zeros((1, 1, 3), dtype=np.uint8), (height, width, 3))
    return Frame(
        frame.file, frame.time_s, black, frame.camera, frame.body_from_camera, world_from_body=frame.world_from_body
    )


def _moved(before: Frame, now: Frame) -> bool:
    """Whether the aircraft turned, or moved by a tenth of a metre."""
    first, second = before.world_from_camera, now.world_from_camera
    if first is None or second is None:
        return False
    turned = (first.rotation.inv() * second.rotation).magnitude()
    return bool(turned > SHARPEST or np.linalg.norm(second.translation - first.translation) > 0.1)


def _rests(before: Look, frame: Frame, estimate: RunwayEstimate) -> bool:
    """Whether all lines lie where they lay although they should have moved."""
    pose, now = before.frame.world_from_camera, frame.world_from_camera
    sides = set(before.estimate.pixel_lines) & set(estimate.pixel_lines) & set(before.estimate.lines)
    if pose is None or now is None or not sides:
        return False
    should, did = 0.0, 0.0
    for side in sides:
        ends = before.estimate.pixel_lines[side].ends_px
        rays = pose.rotation.apply(frame.camera.rays(ends))
        on_deck = intersect_plane(pose.translation, rays, before.estimate.lines[side].height_m)
        optical = now.inv().apply(np.where(np.isfinite(on_deck), on_deck, now.translation))
        a, b, c = before.estimate.pixel_lines[side].coefficients
        expected = frame.camera.project(optical) @ [a, b] + c
        a, b, c = estimate.pixel_lines[side].coefficients
        if np.isfinite(expected).any():
            should = max(should, float(np.nanmax(np.abs(expected))))
        did = max(did, float(np.max(np.abs(ends @ [a, b] + c))))
    return should > MOVED_PX and did < RESTED * should
