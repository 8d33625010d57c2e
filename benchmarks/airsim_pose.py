"""How much later than its picture a vehicle's pose is asked for, as AirSim's own recordings do, and what that costs.

    python benchmarks/airsim_pose.py airsim://HOST:PORT [--frames 50] [--speed-m-s 65]

A second client moves the vehicle along its nose without a pause. Each picture carries the camera's pose of its own
instant; the vehicle's pose, asked for when the picture has come, is farther on. A ping in the same run is the peer.
"""

import os
import platform
import statistics
import threading
import time
from datetime import date

import numpy as np
import tyro
from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.client import Connection, get_images, get_vehicle_pose, parse_address
from deckline.adapters.airsim.source import measure_still_mount, read_image_pose
from deckline.geometry import camera_mount
from deckline_sim.airsim_server.structs import pose_struct

STEP_S = 0.002  # between two poses of the moving vehicle
CAMERA = "0"


def main(address: tyro.conf.Positional[str], frames: int = 50, speed_m_s: float = 65.0) -> None:
    host, port, vehicle = parse_address(address)
    with Connection(host, port) as mover, Connection(host, port) as watcher:
        mount = measure_still_mount(watcher, CAMERA, vehicle).body_from_camera
        start, stop = get_vehicle_pose(watcher, vehicle), threading.Event()
        moving = threading.Thread(target=fly, args=(mover, vehicle, start, speed_m_s, stop))
        moving.start()
        try:
            delays_m, ping_s, size = measure(watcher, vehicle, mount, start, frames)
        finally:
            stop.set()
            moving.join()
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, {date.today()}, {size} px"
    )
    late_s = np.percentile(delays_m, [50, 95]) / speed_m_s
    print(f"at {speed_m_s:g} m/s the vehicle's pose lies {statistics.median(delays_m):.2f} m ahead of the picture's")
    print(f"which is {1e3 * late_s[0]:.1f} ms (95 %: {1e3 * late_s[1]:.1f} ms), {late_s[0] / ping_s:.0f} pings")


def measure(
    watcher: Connection, vehicle: str, mount: RigidTransform, start: RigidTransform, frames: int
) -> tuple[list[float], float, str]:
    """Metres ahead for each picture, the median ping in s, and the picture's size."""
    delays_m, pings_s, size = [], [], ""
    for _ in range(frames):
        scene, _ = get_images(watcher, CAMERA, vehicle)
        after = get_vehicle_pose(watcher, vehicle)
        image = read_image_pose(scene, "Scene") * camera_mount() * mount.inv()
        delays_m.append(float((start.inv() * after).translation[0] - (start.inv() * image).translation[0]))
        size = f"{scene['width']}x{scene['height']}"
        start_s = time.perf_counter()
        watcher.call("ping")
        pings_s.append(time.perf_counter() - start_s)
    return delays_m, statistics.median(pings_s), size


def fly(mover: Connection, vehicle: str, start: RigidTransform, speed_m_s: float, stop: threading.Event) -> None:
    """Set the vehicle forward in time with the clock until it is stop, then back to its start."""
    start_s = time.perf_counter()
    while not stop.wait(STEP_S):
        set_pose(mover, vehicle, start, (time.perf_counter() - start_s) * speed_m_s)
    set_pose(mover, vehicle, start, 0.0)


def set_pose(mover: Connection, vehicle: str, start: RigidTransform, ahead_m: float) -> None:
    pose = start * RigidTransform.from_translation([ahead_m, 0.0, 0.0])
    mover.call("simSetVehiclePose", pose_struct(pose), True, vehicle)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
