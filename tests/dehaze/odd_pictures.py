"""Pictures that no dehazer is made for, drawn."""

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
HEIGHT, WIDTH = 180, 320


def draw(rng: np.random.Generator) -> dict[str, Image]:
    """Name -> image (H, W, 3)."""
    sea_and_sky = _sea_and_sky(rng)
    sun = _disc((90, 60), 9)[..., None]
    night = np.full((HEIGHT, WIDTH, 3), (6, 8, 14), float) + rng.normal(0, 2, (HEIGHT, WIDTH, 1))
    night[120, 40:280:24] = (255, 214, 150)  # deck lights
    snow = np.full((HEIGHT, WIDTH, 3), 238.0) + rng.normal(0, 4, (HEIGHT, WIDTH, 1))
    snow[60:90, 100:220:15] = 60  # trees
    indoor = np.full((HEIGHT, WIDTH, 3), (186, 164, 128), float)
    indoor[100:, :] = (92, 70, 52)
    indoor[30:90, 60:120] = (30, 34, 40)
    window = np.full((HEIGHT, WIDTH, 3), 245.0)  # a screenshot: flat areas, a title bar, rows of text
    window[:14] = (40, 90, 200)
    window[30:170:8, 20:300:3] = 20
    edge = _disc((160, 90), 88)[..., None] > 0  # black beyond a fisheye's circle
    grey = sea_and_sky.mean(axis=2, keepdims=True).repeat(3, axis=2)
    pictures = {
        "black": np.zeros_like(night),
        "white": np.full_like(night, 255),
        "grey": np.full_like(night, 128),
        "night": night,
        "sun in the picture": sea_and_sky + sun * (np.array([255, 250, 235]) - sea_and_sky),
        "snow": snow,
        "indoor": indoor,
        "screenshot": window,
        "portrait": sea_and_sky[:, 100:200],
        "fisheye": np.where(edge, sea_and_sky, 0),
        "infrared in grey": grey,
        "tiny": sea_and_sky[80:96, 100:116],
    }
    return {name: np.clip(np.rint(picture), 0, 255).astype(np.uint8) for name, picture in pictures.items()}


def _sea_and_sky(rng: np.random.Generator) -> NDArray[np.float64]:
    picture = np.empty((HEIGHT, WIDTH, 3))
    picture[:80] = np.linspace((120, 160, 215), (185, 205, 225), 80)[:, None]
    picture[80:] = np.linspace((70, 100, 120), (20, 45, 65), HEIGHT - 80)[:, None]
    picture[80:] += rng.normal(0, 6, (HEIGHT - 80, WIDTH, 1))
    picture[70:100, 140:190] = (50, 52, 55)  # a ship
    return picture


def _disc(middle: tuple[int, int], radius: float) -> NDArray[np.float64]:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.clip(radius - np.hypot(x - middle[0], y - middle[1]), 0, 1)
