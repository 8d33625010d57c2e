"""One frame dehazed as the configuration states: for the detector, for its visibility, and for people."""

from dataclasses import replace

from deckline.config import Models
from deckline.dehaze.base import Dehazer, DehazeResult, restore
from deckline.dehaze.by_pose import downscale_frame
from deckline.geometry import UNKNOWN_FOCAL_SIGMA, Camera
from deckline.types import Frame, PoseSource, Value

DISPLAY_PX = 640  # longer side of a picture for people: what the film shows
DEFAULTS = Models()


def dehaze_frame(
    frame: Frame, dehazer: Dehazer, models: Models = DEFAULTS, long_side_px: int | None = None
) -> DehazeResult:
    """A frame dehazed with the configured strength; its visibility is in metres where the camera's height is stated.

    Args:
        frame: hazy.
        dehazer: of the configuration.
        models: strength, and height of the camera above the water.
        long_side_px: longer side of the picture, at most; None: as large as the frame.

    Raises:
        ValueError: the dehazer refuses the frame.
    """
    frame = _without_picture_pose(frame)
    small = frame if long_side_px is None else downscale_frame(frame, long_side_px)
    restored, height_m = restore(dehazer, small, models.strength), models.camera_height_m
    heights = restored.visibility_heights
    if heights is None or height_m is None or restored.visibility_m is not None:
        return restored
    return replace(restored, visibility_m=Value(heights.value * height_m, heights.sigma * height_m))


def dehaze_for_display(
    frame: Frame, dehazer: Dehazer, models: Models = DEFAULTS, long_side_px: int = DISPLAY_PX
) -> DehazeResult:
    """As `dehaze_frame`, for people: a frame that the dehazer refuses is shown as it is, with the reason as note."""
    try:
        return dehaze_frame(frame, dehazer, models, long_side_px)
    except ValueError as error:
        image = downscale_frame(frame, long_side_px).image_rgb
        return DehazeResult(image.copy(), f"not dehazed: {' '.join(str(error).split())}")


def _without_picture_pose(frame: Frame) -> Frame:
    """The frame as it came: a pose in the runway's frame knows nothing of the sea, and its camera may be assumed."""
    if frame.pose_source is not PoseSource.PICTURE:
        return frame
    camera = frame.camera
    if camera.focal_sigma is not None and camera.focal_sigma >= UNKNOWN_FOCAL_SIGMA:
        camera = Camera.unknown(camera.width, camera.height)
    return replace(
        frame, camera=camera, world_from_body=None, deck_z_m=None, pose_source=PoseSource.NAVIGATION, in_widths=False
    )
