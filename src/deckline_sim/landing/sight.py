"""What a landing aircraft sees: one moment in, guidance out."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.types import Guidance


@dataclass(frozen=True, eq=False)
class Moment:
    """The true state of the aircraft when a picture is exposed."""

    time_s: float
    """Of the exposure, from the landing's start, s."""
    world_from_body: RigidTransform
    """Pose of the body (forward, right, down) in the world (north, east, down), m."""
    velocity_m_s: NDArray[np.float64]
    """(3,) over the water, world, m/s."""
    angular_rate_rad_s: NDArray[np.float64]
    """(3,) about the body's axes, rad/s."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.time_s < np.inf:
            raise ValueError(f"Moment.time_s must be finite and not negative, got {self.time_s}")
        for name in ("velocity_m_s", "angular_rate_rad_s"):
            if np.shape(getattr(self, name)) != (3,):
                raise ValueError(f"Moment.{name} must have shape (3,), got {np.shape(getattr(self, name))}")


class Sight(Protocol):
    """The eyes of one landing: called with its moments in their order."""

    def see(self, moment: Moment) -> Guidance | None:
        """Where the aircraft is relative to the deck, as it knows it from this moment and those before.

        None: no answer came.
        """
        ...


@runtime_checkable
class Closing(Protocol):
    """A sight with threads or a renderer to end."""

    def close(self) -> None:
        """End them."""
        ...
