"""The trained dehazing network as an ONNX file: inference, and its blend with the geometry dehazer's result.

The network mistakes an overcast sea for a hazy one. So the blend goes by what pose and image show:
- Clear air by the fit: the image stays as it is, whatever the network's output.
- Haze by the fit: geometry's result is moved towards the network's where both agree. Where they differ, the network has
  the larger error more often.
- A pose without a fit: the network's change is made in full only where haze is certain.
- No pose: a change as small as the network makes in clear images is not made. On photographs of haze the network's
  change does harm, so that the shipped networks leave images without a pose to another dehazer.

With a pose, only a gain and offsets for each angle below the horizontal are taken from the network, as haze over a sea
has them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from deckline.checks import check_image
from deckline.config import CPU, Engine
from deckline.dehaze.base import Dehazer, DehazeResult, linear_step, mix, restore
from deckline.dehaze.by_pose import USUAL_HEIGHT_M, GeometryDehazer, GeometrySolution, downscale_frame
from deckline.dehaze.filters import max_channel
from deckline.dehaze.haze_fit import NoFit, NotFitted
from deckline.dehaze.pixel_map import PixelMap
from deckline.dehaze.tensors import (
    MIN_SIDE_PX,
    Image,
    Tensor,
    average_down,
    image_to_tensor,
    pad,
    reduction_factor,
    tensor_to_image,
    upsample_guided,
)
from deckline.runtime import load_session
from deckline.types import Frame

# Chosen on nine random sets of 150 m to 20 km and clear air: docs/experiments/2026-11-dehazing-blend.md
CLEAR_M = (6000.0, 7500.0)  # fitted visibility: from here on less is removed, and from here on nothing
NETWORK_SHARE = 0.3  # where both agree
AGREE_LEVELS = 20.0  # a difference at which its share is half, so that it never moves geometry by more than 3 levels
ANGLE_BANDS = 12  # of equally many pixels
BAND_STEP = 3  # every so many-th pixel, along rows and columns, is read
BAND_RIDGE = 9.0  # squared levels: a band that shows no more than that determines no gain
MAX_BAND_GAIN = 4.0
CHANGE_PX = 320  # longer side of the image that the network changes
CHANGE_LEVELS = (6.0, 9.0)  # rms: so little is not done; so much is done in full. Clear views change by 7, hazy by 28
# Without a fit. Chosen on 60 clear and 39 hazy views: docs/experiments/2026-11-dehazing-blend.md
DARKEST = (0.3, 0.45)  # of the brightest detail: darker ones show clear air, brighter ones do not
VEILED = (0.75, 0.85)  # brighter ones show that there is haze
DETAILS = (0.5, 99.5)  # percentiles that count as the darkest and the brightest detail
DETAIL_SIZE = (320, 180)  # width and height of the image that they are taken in
MIN_DETAIL_LEVELS = 3.0  # between them; a uniform image has nothing to show
CHANGE_STEP = 4  # every so many-th pixel, along rows and columns, is compared for the change


class OnnxDehazer:
    """Runs an exported network on images of any size.

    Every network gets an image averaged down to about the size that it was trained on. A coarse network gets both sizes
    and upsamples its result itself; another network's result is upsampled along the image's edges. A network with a
    prior starts from the geometry dehazer's result of a frame with a pose, and from the image itself without one.

    Args:
        path: file made by `deckline train dehaze`, or another with the metadata of docs/how/network.md.
        name: for reports; the file's name when not given.
        engine: what computes the network.
        network_only: return the network's result as it is. Otherwise the result of a network with a prior is blended
            with geometry's, and changes too small to be haze are not made.
        without_pose: dehazes images alone and frames without a pose; None: the network does.

    Raises:
        ValueError: no ONNX file, one that is no dehazing network of deckline, or an engine that is not there.
    """

    def __init__(
        self,
        path: Path,
        name: str | None = None,
        engine: Engine = CPU,
        network_only: bool = False,
        without_pose: Dehazer | None = None,
    ) -> None:
        self.name = name or Path(path).name
        self.session = load_session(path, engine)
        config = self.session.config
        if config.get("kind") != "dehaze":
            raise ValueError(
                f"{path} is no dehazing network: its metadata have kind {config.get('kind')!r}, expected 'dehaze'"
            )
        try:
            network = dict(config["network"])
            self.working_long_side_px = int(config["working_long_side_px"])
            self.grid_px = int(network["unshuffle"])
            self.min_side_px = int(network.get("min_side_px", MIN_SIDE_PX))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: its metadata have no usable network or working size: {error!r}") from error
        self.coarse = "working" in self.session.input_names
        self.geometry = GeometryDehazer() if network.get("prior") else None
        self.network_only = network_only or self.geometry is None
        self.without_pose = without_pose

    @property
    def cost(self) -> tuple[int, int] | None:
        """Parameters, and multiply-accumulates at 256x256; None for a file without them."""
        config = self.session.config
        return (config["parameters"], config["macs_256"]) if "macs_256" in config else None

    def __call__(self, image_rgb: Image) -> Image:
        if self.without_pose is not None:
            return self.without_pose(image_rgb)
        return self._restore_alone(image_rgb)

    def _restore_alone(self, image_rgb: Image) -> Image:
        check_image(image_rgb)
        clear = self._run(image_rgb, image_rgb)
        return clear if self.network_only else mix(image_rgb, clear, change_share(image_rgb, clear))

    def restore(self, frame: Frame) -> DehazeResult:
        if self.without_pose is not None and frame.world_from_camera is None:
            return restore(self.without_pose, frame)
        solution = None if self.geometry is None else self.geometry.solve(frame)
        if not isinstance(solution, GeometrySolution):
            return self._restore_without_fit(frame, solution)
        air = 0.0 if self.network_only else linear_step(float(np.log(solution.haze.visibility_m)), *np.log(CLEAR_M))
        if air == 1:
            heights = f"{CLEAR_M[1] / USUAL_HEIGHT_M:g} heights of the camera"
            reach = f"{CLEAR_M[1] / 1e3:g} km" if solution.has_height else heights
            return solution.restored(frame.image_rgb.copy(), f"not dehazed: the air is clear for {reach} or more")
        if self.network_only:
            return solution.restored(self._run(frame.image_rgb, solution.remove(frame.image_rgb)))
        small = downscale_frame(frame, min(CHANGE_PX, self.working_long_side_px)).image_rgb
        prior = replace(solution.remove, noise=0.0)(small)  # averaged already
        change = limit_change(prior, fit_to_angles(prior, self._run(small, prior), solution.down)(prior))
        return solution.restored(solution.remove.add(change).fade(air)(frame.image_rgb))

    def _restore_without_fit(self, frame: Frame, why: NotFitted | None) -> DehazeResult:
        if why is None or self.network_only or frame.world_from_camera is None:
            return DehazeResult(self._restore_alone(frame.image_rgb))
        if why.down is None or why.cause is NoFit.FAR_SEEN:
            return DehazeResult(frame.image_rgb.copy(), f"not dehazed: {why.reason}")
        darkest = darkest_detail(frame.image_rgb)
        if darkest <= DARKEST[0]:
            return DehazeResult(frame.image_rgb.copy(), f"not dehazed: {why.reason}, and dark details show no haze")
        small = downscale_frame(frame, min(CHANGE_PX, self.working_long_side_px)).image_rgb
        clear = fit_to_angles(small, self._run(small, small), why.down)(frame.image_rgb)
        done = change_share(frame.image_rgb, clear, max(why.hidden, linear_step(darkest, *VEILED)))
        return DehazeResult(mix(frame.image_rgb, clear, done * linear_step(darkest, *DARKEST)))

    def _run(self, image_rgb: Image, prior_rgb: Image) -> Image:
        height, width = image_rgb.shape[:2]
        factor = reduction_factor(height, width, self.working_long_side_px)
        image = self._tensor(image_rgb, factor)
        working = average_down(image, factor)
        if not self.coarse:
            (clear,) = self.session(image=working)
            clear = upsample_guided(image, working, clear, factor)
        elif self.geometry is None:
            (clear,) = self.session(image=image, working=working)
        else:
            prior = image if prior_rgb is image_rgb else self._tensor(prior_rgb, factor)
            both = np.concatenate([working, average_down(prior, factor)], axis=1)
            (clear,) = self.session(image=prior, working=both)
        return tensor_to_image(clear[:, :, :height, :width])

    def _tensor(self, image_rgb: Image, factor: int) -> Tensor:
        return image_to_tensor(pad(image_rgb, factor * self.grid_px, factor * self.min_side_px))


def fit_to_angles(image_rgb: Image, network_rgb: Image, down: Tensor) -> PixelMap:
    """The map nearest to the network's whose gain and offsets depend on the angle below the horizontal alone.

    Haze over a sea has such a map; a gain and an offset for every cell would draw clouds, wakes and halos. A gain is at
    least 1, so that no contrast is lost.

    Args:
        image_rgb: (H, W, 3) the network's input.
        network_rgb: (H, W, 3) its result.
        down: sines of the angle below the horizontal, of any resolution.
    """
    import cv2

    height, width = image_rgb.shape[:2]
    part = tuple(slice(min(BAND_STEP // 2, side - 1), None, BAND_STEP) for side in (height, width))  # blocks' middles
    seen_rgb, made_rgb = image_rgb[part], network_rgb[part]
    down = np.asarray(cv2.resize(down, seen_rgb.shape[1::-1]))
    angles, gains, offsets = [], [], []
    for band in np.array_split(np.argsort(down, axis=None), min(ANGLE_BANDS, down.size)):
        seen, wanted = (image.reshape(-1, 3)[band].astype(np.float32) for image in (seen_rgb, made_rgb))
        off, wanted_off = seen - seen.mean(axis=0), wanted - wanted.mean(axis=0)
        gain = ((off * wanted_off).mean() + BAND_RIDGE) / ((off * off).mean() + BAND_RIDGE)
        angles.append(down.ravel()[band].mean())
        gains.append(np.clip(gain, 1, MAX_BAND_GAIN))
        offsets.append(wanted.mean(axis=0) - gains[-1] * seen.mean(axis=0))
    gain = np.interp(down, angles, gains).astype(np.float32)
    offset = np.stack([np.interp(down, angles, channel) for channel in np.transpose(offsets)]).astype(np.float32)
    return PixelMap(gain, gain, offset)


def limit_change(image_rgb: Image, held_rgb: Image) -> Tensor:
    """Levels (H, W, 3) that the network's fitted result adds to geometry's image; fewer where both differ."""
    import cv2

    change = cv2.subtract(held_rgb, image_rgb, dtype=cv2.CV_32F)
    share = NETWORK_SHARE / (1 + np.square(max_channel(np.moveaxis(np.abs(change), 2, 0)) / np.float32(AGREE_LEVELS)))
    return np.asarray(change * share[..., None], dtype=np.float32)


def darkest_detail(image_rgb: Image) -> float:
    """The darkest detail of an image (H, W, 3) as a share of the brightest; 0 for a uniform image."""
    import cv2

    grey = cv2.resize(image_rgb, DETAIL_SIZE, interpolation=cv2.INTER_AREA).mean(axis=2)
    dark, bright = np.percentile(grey, DETAILS)
    return float(dark / bright) if bright - dark > MIN_DETAIL_LEVELS else 0.0


def change_share(image_rgb: Image, network_rgb: Image, certainty: float = 1.0) -> float:
    """Share of the network's change that is made, 0 to 1: little where its image hardly differs from its input.

    At a certainty of haze below 1 the change has at most CHANGE_LEVELS[0] (rms), so that a clear image retains 32 dB.
    """
    step = np.s_[::CHANGE_STEP, ::CHANGE_STEP]
    change = float(np.sqrt(np.mean(np.square(network_rgb[step].astype(np.float32) - image_rgb[step]))))
    return linear_step(change, *CHANGE_LEVELS) * max(certainty, min(1.0, CHANGE_LEVELS[0] / max(change, 1.0)))
