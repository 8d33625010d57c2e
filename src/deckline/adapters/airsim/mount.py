"""Where a camera sits on its vehicle, measured over the protocol.

AirSim tells the poses of camera and vehicle in the world, each of the instant at which it is asked. So the camera's is
asked for between two of the vehicle's: what these differ bounds the error.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.adapters.airsim.client import Connection, camera_info, vehicle_pose
from deckline.geometry import camera_mount

STILL_M = 0.01  # a vehicle that moves less during a look stands still
STILL_RAD = 1e-3  # a vehicle that turns less: 0.06 deg, half of which is the error
TRIES = 20


@dataclass(frozen=True, eq=False)
class Look:
    """One measurement of a camera on its vehicle."""

    body_from_camera: RigidTransform  # optical frame
    fov_rad: float  # horizontal
    moved_m: float  # what the vehicle did meanwhile
    turned_rad: float


def look(connection: Connection, camera: str, vehicle: str) -> Look:
    """Measure once; the vehicle is taken to be half way.

    Raises:
        Refused, Lost, Stopped: as Connection.call.
        ValueError: answers that are no poses.
    """
    before = vehicle_pose(connection, vehicle)
    world_from_mount, fov_rad = camera_info(connection, camera, vehicle)
    after = vehicle_pose(connection, vehicle)
    moved = before.inv() * after
    mount = middle(before, after).inv() * world_from_mount * camera_mount()
    return Look(mount, fov_rad, float(np.linalg.norm(moved.translation)), float(moved.rotation.magnitude()))


def best_look(connection: Connection, camera: str, vehicle: str) -> Look:
    """The measurement of several during which the vehicle moved least.

    Raises:
        Refused, Lost, Stopped: as Connection.call.
        ValueError: answers that are no poses.
    """
    best = look(connection, camera, vehicle)
    for _ in range(TRIES - 1):
        if best.moved_m <= STILL_M and best.turned_rad <= STILL_RAD:
            break
        best = min(best, look(connection, camera, vehicle), key=lambda one: one.moved_m)
    return best


def followed(mount: RigidTransform, now: Look) -> RigidTransform:
    """The mount known so far, brought up to date with what of a new measurement is sharp enough.

    So a camera that is turned on its vehicle is followed, and a fast vehicle does not blur where it sits.
    """
    if now.turned_rad > STILL_RAD:
        return mount
    place = now.body_from_camera.translation if now.moved_m <= STILL_M else mount.translation
    return RigidTransform.from_components(place, now.body_from_camera.rotation)


def middle(first: RigidTransform, second: RigidTransform) -> RigidTransform:
    """The pose half way between two that are near each other."""
    turn = Rotation.concatenate([first.rotation, second.rotation]).mean()
    return RigidTransform.from_components(np.add(first.translation, second.translation) / 2, turn)
