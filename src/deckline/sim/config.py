"""What to simulate."""

from dataclasses import dataclass
from typing import Literal, get_args

Preset = Literal["paper", "cvn", "train"]
Trajectory = Literal["approach", "random"]
CLEAR: tuple[float, float] = (float("inf"), float("inf"))


@dataclass(frozen=True)
class SimConfig:
    """One simulated recording.

    Args:
        preset: which ship. `paper`: the published edge lines; `cvn`: a large carrier of public dimensions;
            `train`: another random ship every `frames_per_ship` frames, some without a runway.
        trajectory: `approach`: one final approach; `random`: unrelated views around the glide path.
        frames: how many.
        visibility_m: lowest and highest visibility (2 % contrast), drawn uniformly for every random view and
            once for an approach; infinite is clear air.
        seed: everything random follows from it and from the frame's index.
        width, height: image size, px.
        fov_deg: horizontal field of view; preset `train` draws its own unless `fixed_fov`.
        depth_range_m: the recorded depth is NaN farther away than this (along the optical axis).
        keep_clear: also give a hazy view without its haze (Frame.truth.clear_rgb).
        range_m: nearest and farthest distance to the ramp of a random view; None: 60 to 800 m, and 30 to 1500 m
            for preset `train`.
        fixed_fov: keep `fov_deg` for preset `train`.
        start_m, end_m: distance to the ramp where an approach begins and ends.
        frames_per_ship: random views that share a ship, its paint and the sun's direction.

    Raises:
        ValueError: an unknown preset or trajectory, or a number out of its range.
    """

    preset: Preset = "paper"
    trajectory: Trajectory = "approach"
    frames: int = 100
    visibility_m: tuple[float, float] = CLEAR
    seed: int = 0
    width: int = 1280
    height: int = 720
    fov_deg: float = 90.0
    depth_range_m: float = 200.0
    keep_clear: bool = True
    range_m: tuple[float, float] | None = None
    fixed_fov: bool = False
    start_m: float = 800.0
    end_m: float = 12.0
    frames_per_ship: int = 4

    def __post_init__(self) -> None:
        for name, kinds in (("preset", Preset), ("trajectory", Trajectory)):
            if getattr(self, name) not in get_args(kinds):
                raise ValueError(f"{name} must be one of {get_args(kinds)}, got {getattr(self, name)!r}")
        for name in ("frames", "width", "height", "frames_per_ship"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if not 1.0 <= self.fov_deg <= 150.0:
            raise ValueError(f"fov_deg must lie between 1 and 150, got {self.fov_deg}")
        if not self.depth_range_m > 0:
            raise ValueError(f"depth_range_m must be positive, got {self.depth_range_m}")
        for name in ("visibility_m", "range_m"):
            limits = getattr(self, name)
            if limits is not None and not 0 < limits[0] <= limits[1]:
                raise ValueError(f"{name} must be (low, high) with 0 < low <= high, got {limits}")
        if not 0 < self.end_m < self.start_m:
            raise ValueError(f"start_m must exceed end_m > 0, got {self.start_m} and {self.end_m}")

    @property
    def ranges_m(self) -> tuple[float, float]:
        """Nearest and farthest distance to the ramp of a random view."""
        if self.range_m is not None:
            return self.range_m
        return (30.0, 1500.0) if self.preset == "train" else (60.0, 800.0)
