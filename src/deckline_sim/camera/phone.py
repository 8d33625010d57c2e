"""Picture processing of phones and video: filters, colour coding, compression. Nothing moves by more than 1 px."""

from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline_sim.camera.sensor import falloff, jpeg

Levels = NDArray[Any]  # (H, W, 3) uint8, red, green, blue
Rng = np.random.Generator
Effect = tuple[Callable[[Levels, Rng], Levels], float]  # and the share of pictures that get it


def phone_picture(image: NDArray[Any], rng: Rng) -> NDArray[np.float32]:
    """A picture (H, W, 3), 0..255, as a phone or a video shows it; float32, 0..255. Now and then it is the same."""
    return apply_effects(np.clip(np.rint(image), 0, 255).astype(np.uint8), EFFECTS, rng).astype(np.float32)


def apply_effects(levels: NDArray[np.uint8], effects: Iterable[Effect], rng: Rng) -> NDArray[np.uint8]:
    """A picture (H, W, 3) after each effect that `rng` draws by its share."""
    for effect, share in effects:
        if rng.random() < share:
            levels = effect(levels, rng)
    return levels


def _vignette(levels: Levels, rng: Rng) -> Levels:
    shade = falloff(*levels.shape[:2], float(rng.integers(1, 5) / 4))  # steps, so that the shade is computed once
    return (levels * shade).astype(np.uint8)


def _raise_local_contrast(levels: Levels, rng: Rng) -> Levels:
    """Pictures joined from several exposures: high local contrast of shadows and clouds."""
    sigma = len(levels) * rng.uniform(0.01, 0.08)
    return _boost_detail(levels, sigma, rng.uniform(0.2, 1.0))


def _sharpen(levels: Levels, rng: Rng) -> Levels:
    """Unsharp masking that overshoots: bright and dark halos along edges."""
    return _boost_detail(levels, rng.uniform(0.5, 1.8), rng.uniform(0.4, 2.0))


def _boost_detail(levels: Levels, sigma_px: float, gain: float) -> Levels:
    """Brightness of which `gain` times the part finer than a Gaussian is added, on a grid as coarse as that allows."""
    colour = cv2.cvtColor(levels, cv2.COLOR_RGB2YCrCb)
    luma, step = colour[..., 0], max(1, int(sigma_px / 2))
    small = cv2.resize(luma, _scaled(levels, 1 / step), interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), sigma_px / step, borderType=cv2.BORDER_REPLICATE)
    base = cv2.resize(soft, luma.shape[::-1])
    colour[..., 0] = cv2.addWeighted(luma, 1 + gain, base, -gain, 0)
    return cv2.cvtColor(colour, cv2.COLOR_YCrCb2RGB)


def _expose(levels: Levels, rng: Rng) -> Levels:
    """Black and white point, often with a clipped sky, an S-curve, and another curve for each colour."""
    black, white, bend = rng.uniform([-0.15, 0.6, 0.0], [0.12, 1.1, 1.0])
    share = np.clip((np.arange(256) / 255 - black) / (white - black), 0, 1)
    share += bend * (share**2 * (3 - 2 * share) - share)
    table = share[:, None] ** np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.05, 3))
    return cv2.LUT(levels, np.rint(255 * np.clip(table, 0, 1)).astype(np.uint8)[None])


def _saturate(levels: Levels, rng: Rng) -> Levels:
    colour = cv2.cvtColor(levels, cv2.COLOR_RGB2YCrCb)
    gain = rng.uniform(1.1, 2.0)
    boosted = cv2.convertScaleAbs(colour, alpha=gain, beta=128 * (1 - gain))
    boosted[..., 0] = colour[..., 0]
    return cv2.cvtColor(boosted, cv2.COLOR_YCrCb2RGB)


def _add_grain(levels: Levels, rng: Rng) -> Levels:
    """Grain of several pixels, grey or coloured, as denoisers and photographic film have it."""
    width, height = _scaled(levels, 1 / rng.uniform(1.0, 3.0))
    noise = rng.integers(0, int(rng.integers(4, 26)), (height, width, rng.choice([1, 3])), dtype=np.uint8)
    grain = cv2.resize(noise, levels.shape[1::-1]).reshape(*levels.shape[:2], -1)
    full = cv2.merge([grain] * 3) if grain.shape[2] == 1 else grain
    return cv2.addWeighted(levels, 1, full, 1, -float(noise.mean()))


def _bleed_colour(levels: Levels, rng: Rng) -> Levels:
    """Colour stored on a coarser grid than brightness, coarser along the rows, and a little aside."""
    colour = cv2.cvtColor(levels, cv2.COLOR_RGB2YCrCb)
    across, down = rng.uniform([2.0, 1.0], [8.0, 3.0])
    size = max(1, round(levels.shape[1] / across)), max(1, round(len(levels) / down))
    coarse = cv2.resize(colour[..., 1:], size, interpolation=cv2.INTER_AREA)
    colour[..., 1:] = np.roll(cv2.resize(coarse, levels.shape[1::-1]), int(rng.integers(-1, 2)), axis=1)
    return cv2.cvtColor(colour, cv2.COLOR_YCrCb2RGB)


def _comb(levels: Levels, rng: Rng) -> Levels:
    """Interlaced video of a moving camera: every other row lies up to 1 px aside."""
    out, share = levels.copy(), rng.uniform(0.3, 1.0)
    rows = np.ascontiguousarray(levels[1::2])
    aside = np.roll(rows, rng.choice([-1, 1]), axis=1)
    out[1::2] = cv2.addWeighted(rows, 1 - share, aside, share, 0).reshape(rows.shape) if rows.size else rows
    return out


def _smear(levels: Levels, rng: Rng) -> Levels:
    """A phone's denoiser: removes fine texture, preserves edges."""
    return cv2.addWeighted(levels, 0.25, cv2.medianBlur(levels, 3), 0.75, 0)


def _enlarge_video(levels: Levels, rng: Rng) -> Levels:
    """Video at a low bit rate, coded small and shown large."""
    small: Levels = cv2.resize(levels, _scaled(levels, rng.uniform(0.4, 0.8)), interpolation=cv2.INTER_AREA)
    coded = jpeg(small, int(rng.integers(15, 70)))
    return cv2.resize(coded, levels.shape[1::-1], interpolation=int(rng.choice([cv2.INTER_LINEAR, cv2.INTER_CUBIC])))


def _compress(levels: Levels, rng: Rng) -> Levels:
    return jpeg(levels, int(rng.integers(20, 90)))


def _scaled(levels: Levels, factor: float) -> tuple[int, int]:
    """Width and height of a smaller picture."""
    return max(1, round(levels.shape[1] * factor)), max(1, round(len(levels) * factor))


EFFECTS: tuple[Effect, ...] = (  # in the order of a camera, with their shares
    (_vignette, 0.25),
    (_add_grain, 0.3),
    (_smear, 0.15),
    (_raise_local_contrast, 0.3),
    (_expose, 0.6),
    (_saturate, 0.3),
    (_sharpen, 0.4),
    (_bleed_colour, 0.3),
    (_comb, 0.08),
    (_enlarge_video, 0.3),
    (_compress, 0.35),
)
_TONES = (_vignette, _raise_local_contrast, _expose, _saturate)
TONE = tuple(effect for effect in EFFECTS if effect[0] in _TONES)  # what a camera makes of brightness and colour
WEAR = tuple(effect for effect in EFFECTS if effect[0] not in _TONES)  # what a picture loses by it
