"""Settings of the geometry dehazer."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class GeometryConfig:
    """Lengths in pixels are meant for images 1280 px wide and scaled for others."""

    light: Literal["display", "linear"] = "display"  # what haze adds to: the picture's levels, or sRGB's light
    sea_below_deck_m: float = 20.0  # where the frame does not know the sea's height; Nimitz class
    clear_beta_per_m: float = 1e-4  # what is left in the picture: a clear day's air, visibility 39 km
    level_sigma: float = 2.0  # of a pixel's noise, levels 0..255, at least; a sky that shows more raises it
    airlight_sigma: float = 0.02  # of the airlight's share in a pixel, as a fraction of it
    scene_sigma: float = 40.0  # of ship and waves about the sea's mean colour, levels
    object_levels: tuple[float, float] = (12.0, 30.0)  # off the hazy sea or sky: surely not an object, surely one
    standing_out: tuple[float, float] = (1.1, 1.5)  # bound over the sea's transmission: surely sea, surely nearer
    window_px: int = 15  # over which one dark detail speaks for its neighbours
    object_range_m: float = 1500.0  # ships farther away count as being here; keeps clear pictures as they are
    darkest: float = 0.2  # of the airlight: what light a ship's darkest detail still sends
    min_object_t: float = 0.2  # above the horizon; fainter objects are left in the haze

    def __post_init__(self) -> None:
        if self.light not in ("display", "linear"):
            raise ValueError(f'light must be "display" or "linear", got {self.light!r}')
        for name in ("sea_below_deck_m", "level_sigma", "scene_sigma", "window_px", "object_range_m", "min_object_t"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("clear_beta_per_m", "airlight_sigma"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not 0 <= self.darkest < 1:
            raise ValueError(f"darkest must lie in [0, 1), got {self.darkest}")
        for name in ("object_levels", "standing_out"):
            low, high = getattr(self, name)
            if not 0 <= low < high:
                raise ValueError(f"{name} must rise from 0 or more, got {low} to {high}")
