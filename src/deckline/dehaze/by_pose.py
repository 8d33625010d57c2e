"""Dehazing by a pose, without a network: the pose gives the sea's range, the image the air's extinction.

The haze is fitted to the sea (`haze_fit`), the transmission follows from ranges and details (`transmission`); a depth
camera replaces it where it has a depth. I = J t + A (1 - t) is then solved for the most likely J. Where haze leaves no
signal, that is the sea's own colour: plain sea in the result does not mean that nothing is there.

The image of a sea in haze depends on extinction times the camera's height. Where the height is not known, a usual one
is assumed, and the visibility comes in heights of the camera.

In every pixel the solution is linear in the image (`PixelMap`). It is found in an image of at most `analysis_px`; a
larger one only gets it applied.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.checks import check_image
from deckline.dehaze.base import DehazeResult
from deckline.dehaze.filters import estimate_noise
from deckline.dehaze.haze_fit import HazeFit, NoFit, NotFitted, fit_haze, hidden_sea_certainty
from deckline.dehaze.pixel_map import Image, PixelMap, luma
from deckline.dehaze.sea_view import SeaView, ray_lengths, view_sea, view_water
from deckline.dehaze.transmission import GeometryConfig, find_objects, signal_gain, transmissions
from deckline.types import Frame, Value

ANALYSIS_PX = 400  # longer side of the image that air and objects are estimated in; 640 px are no better
USUAL_HEIGHT_M = 50.0  # of a camera above the water, where it is not known; the limits of `haze_fit` are metres
NOISE_ROWS = 30  # about so many are read for noise
BLOCK_PX = 8  # apart: compression makes the pixels of one block alike
NOISE_WEIGHT = 2.0  # best in [1, 3] on preset paper with noise of 3 and 8 levels added


@dataclass(frozen=True, eq=False)
class GeometrySolution:
    """How a frame's haze is removed."""

    haze: HazeFit
    """Air and sea."""
    remove: PixelMap
    """Removes the haze from the frame's image, at any resolution."""
    down: Image
    """(h, w) sines of the angle below the horizontal."""
    has_height: bool = True
    """Whether the camera's height above the water is known; else it is taken as USUAL_HEIGHT_M."""

    def restored(self, image_rgb: NDArray[np.uint8], note: str = "") -> DehazeResult:
        """The result with an image (H, W, 3) of this air, and the fit's visibility."""
        visibility = self.haze.visibility
        if self.has_height:
            return DehazeResult(image_rgb, note, visibility_m=visibility)
        heights = Value(visibility.value / USUAL_HEIGHT_M, visibility.sigma / USUAL_HEIGHT_M)
        return DehazeResult(image_rgb, note, visibility_heights=heights)


class GeometryDehazer:
    """Dehazes frames with a pose; others come out as they are, with a note of the reason.

    With the height of sea or deck the visibility is in metres, without it in heights of the camera.

    Args:
        config: how objects are found and what is left of the haze.
        analysis_px: longer side of the image that air and objects are estimated in.
    """

    name = "geometry"

    def __init__(self, config: GeometryConfig | None = None, analysis_px: int = ANALYSIS_PX) -> None:
        self.config = config or GeometryConfig()
        self.analysis_px = analysis_px

    def __call__(self, image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        check_image(image_rgb)
        return image_rgb.copy()  # an image alone has no ranges

    def restore(self, frame: Frame) -> DehazeResult:
        solution = self.solve(frame)
        if isinstance(solution, NotFitted):
            return DehazeResult(frame.image_rgb.copy(), f"not dehazed: {solution.reason}")
        return solution.restored(solution.remove(frame.image_rgb))

    def solve(self, frame: Frame) -> GeometrySolution | NotFitted:
        """How the frame's haze is removed, or why its air cannot be estimated."""
        pose = frame.world_from_camera
        if pose is None:
            return NotFitted(NoFit.NO_POSE)
        sea_z_m, deck_z_m = frame.sea_z_m, frame.deck_z_m
        if deck_z_m is None:
            deck_z_m = sea_z_m  # raises no bound
        elif sea_z_m is None:
            sea_z_m = deck_z_m + self.config.sea_below_deck_m
        if sea_z_m is None or deck_z_m is None:
            solution = self.solve(at_usual_height(frame, pose.rotation))
            return replace(solution, has_height=False) if isinstance(solution, GeometrySolution) else solution
        if sea_z_m < deck_z_m:
            return NotFitted(NoFit.SEA_ABOVE_DECK, f"z {sea_z_m:g} m over {deck_z_m:g} m; z points down")
        return self._solve_above(frame, pose, sea_z_m, deck_z_m)

    def _solve_above(
        self, frame: Frame, pose: RigidTransform, sea_z_m: float, deck_z_m: float
    ) -> GeometrySolution | NotFitted:
        """The solution of a frame above a sea and a deck of known heights; `pose` is world_from_camera."""
        import cv2

        small = downscale_frame(frame, self.analysis_px)
        view = view_sea(small.camera, pose, sea_z_m)
        if view.height_m <= 0:
            return NotFitted(NoFit.BELOW_SEA, f"{-view.height_m:.1f} m")
        planes = np.stack(cv2.split(small.image_rgb)).astype(np.float32)
        small_noise = measure_sky_noise(take_rows(small.image_rgb), view)
        noise = measure_sky_noise(take_rows(frame.image_rgb), view, BLOCK_PX)
        haze = fit_haze(small.image_rgb, view, noise_sigma=small_noise)
        if isinstance(haze, NotFitted):
            return replace(haze, hidden=hidden_sea_certainty(small.image_rgb, view), down=view.down)
        deck = view_water(view.down, view.height_m + deck_z_m - sea_z_m)
        objects, bound = find_objects(planes, view, deck, haze, with_noise(self.config, small_noise))
        range_m = None if small.depth_m is None else small.depth_m * ray_lengths(small.camera)
        behind, before = (
            invert_haze(view, t, clear_t, haze, with_noise(self.config, noise))
            for t, clear_t in transmissions(view, bound, range_m, haze, self.config)
        )
        return GeometrySolution(haze, behind.mix(before, objects), view.down)


def at_usual_height(frame: Frame, world_from_camera: Rotation) -> Frame:
    """A frame as from USUAL_HEIGHT_M above a sea at z = 0, without its depth, which is of true metres."""
    pose = RigidTransform.from_components([0.0, 0.0, -USUAL_HEIGHT_M], world_from_camera)
    body = pose * frame.body_from_camera.inv()
    return replace(frame, world_from_body=body, sea_z_m=0.0, deck_z_m=None, depth_m=None)


def downscale_frame(frame: Frame, long_side_px: int) -> Frame:
    """A frame averaged down to this longer side, camera and depth with it, without truth; small ones stay."""
    import cv2

    height, width = frame.image_rgb.shape[:2]
    scale = min(1.0, long_side_px / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if size == (width, height):
        return frame
    image = frame.image_rgb
    while image.shape[0] % 2 == image.shape[1] % 2 == 0 and image.shape[1] >= 2 * size[0]:  # halves are quick
        half = image.shape[1] // 2, image.shape[0] // 2
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    small = replace(frame, image_rgb=image, camera=frame.camera.resized(*size), depth_m=None, truth=None)
    if frame.depth_m is None:
        return small
    depth_m = cv2.resize(frame.depth_m, size, interpolation=cv2.INTER_NEAREST)
    return replace(small, depth_m=np.asarray(depth_m, dtype=np.float32))


def take_rows(image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """About NOISE_ROWS rows of an image (H, W, 3), evenly spread."""
    return image_rgb[:: 1 + len(image_rgb) // NOISE_ROWS]


def measure_sky_noise(rows: NDArray, view: SeaView, apart_px: int = 1) -> float:
    """1-sigma of a pixel's noise in the sky, levels.

    Args:
        rows: (R, W, 3) levels of some of the image's rows, evenly spread.
        view: the sea in the image, of any resolution.
        apart_px: between the pixels that are compared; noise that is alike over less counts in full.
    """
    import cv2

    size = (rows.shape[1], len(rows))
    sky = cv2.resize((~view.is_sea).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    levels, left, right = np.asarray(rows, np.float32), np.s_[:, :-apart_px], np.s_[:, apart_px:]
    differences = (levels[right] - levels[left])[sky[right] & sky[left]]
    slope = np.median(differences, axis=0) if len(differences) else 0
    return estimate_noise(differences - slope)


def with_noise(config: GeometryConfig, noise_sigma: float) -> GeometryConfig:
    """Settings for pixels with at least this noise, 1-sigma in levels."""
    return replace(config, level_sigma=max(config.level_sigma, NOISE_WEIGHT * noise_sigma))


def invert_haze(view: SeaView, t: Image, clear_t: Image, haze: HazeFit, config: GeometryConfig) -> PixelMap:
    """The map that thins haze of transmission t (H, W) to a clear day's air of transmission clear_t (H, W)."""
    airlight = haze.airlight.astype(np.float32)[:, None, None]
    usual = view.sea_share * (haze.clear_sea(view.down) - airlight)
    level, hazy = float(airlight.mean()), airlight + t * usual
    gain = clear_t * signal_gain(t, level, config.level_sigma, config.airlight_sigma, config.scene_sigma)
    chroma = clear_t * signal_gain(t, level, config.level_sigma, config.airlight_chroma_sigma, config.chroma_sigma)
    offset = airlight + clear_t * usual - chroma * hazy - (gain - chroma) * luma(hazy)
    gain, chroma = (np.where(t == 1, np.float32(1), part) for part in (gain, chroma))
    return PixelMap(gain, chroma, np.where(t == 1, np.float32(0), offset), config.level_sigma / NOISE_WEIGHT)
