"""What the server's calls act on."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.protocol import read_pose
from deckline_sim.airsim_server.image_requests import Recorder
from deckline_sim.airsim_server.sensors import SimulatedSensors
from deckline_sim.airsim_server.vehicle import FARTHEST_M
from deckline_sim.airsim_server.world import World


@dataclass(frozen=True, eq=False)
class Service:
    """What calls act on."""

    world: World
    render: Callable[..., Awaitable[Any]]  # do something on the world's thread, behind the work that waits there
    recorder: Recorder
    sensors: SimulatedSensors
    log: Callable[[str], None]

    def change(self, **values: Any) -> None:
        """Set parts of the world's state."""
        self.world.change(**values)


def read_near_pose(value: Any, default: RigidTransform) -> RigidTransform:
    """A pose that can be rendered; parts with NaN are those of `default`."""
    pose = read_pose(value, "pose", default)
    if np.abs(pose.translation).max() > FARTHEST_M:
        position = pose.translation.tolist()
        raise ValueError(f"pose: position {position} is farther than {FARTHEST_M:g} m from the origin")
    return pose
