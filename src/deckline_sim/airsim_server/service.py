"""The objects that the server's calls act on."""

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
    """The objects that calls act on."""

    world: World
    render: Callable[..., Awaitable[Any]]  # run a function on the world's thread, after the work queued there
    recorder: Recorder
    sensors: SimulatedSensors
    log: Callable[[str], None]


def read_near_pose(value: Any, default: RigidTransform) -> RigidTransform:
    """A pose near enough to render; a position or orientation with NaN is that of `default`."""
    pose = read_pose(value, "pose", default)
    if np.abs(pose.translation).max() > FARTHEST_M:
        position = pose.translation.tolist()
        raise ValueError(f"pose: position {position} is farther than {FARTHEST_M:g} m from the origin")
    return pose
