"""`deckline convert`."""

from pathlib import Path

import numpy as np
import tyro

from deckline.files import print_line
from deckline.geometry import attitude, camera_mount
from deckline.recording.airsim import ReadOptions
from deckline.recording.camera_file import read_camera_file
from deckline.recording.convert import add_scene, drop_scene

NO_TURN = (0.0, 0.0, 0.0)


def convert(
    recording: tyro.conf.Positional[Path],
    out: Path,
    plain: bool = False,
    camera: Path | None = None,
    fov_deg: float = 90.0,
    mount_m: tuple[float, float, float] = NO_TURN,
    mount_deg: tuple[float, float, float] = NO_TURN,
    deck_z_m: float | None = None,
) -> int:
    """Copy an AirSim recording into deckline's layout with scene.json, or back with --plain.

    Args:
        recording: folder with airsim_rec.txt and images.
        out: new folder.
        plain: leave scene.json and the clear images out, for AirSim's own tools.
        camera: camera.toml with intrinsics and mount; goes before the options below.
        fov_deg: horizontal field of view.
        mount_m: where the camera sits on the vehicle: forward, right, down of its centre.
        mount_deg: how the camera is turned on the vehicle: roll, pitch (up is positive), yaw.
        deck_z_m: world z (down, metres) of the deck plane.
    """
    mounted = (mount_m, mount_deg) != (NO_TURN, NO_TURN)
    if plain:
        if camera is not None or mounted or deck_z_m is not None:
            raise ValueError("--plain drops what is known of camera and deck: leave their options out")
        rows, files, notes = drop_scene(recording, out)
    else:
        if camera is not None and mounted:
            raise ValueError(f"{camera} says how the camera is mounted: leave --mount-m and --mount-deg out")
        if not np.isfinite((*mount_m, *mount_deg)).all():
            raise ValueError("--mount-m and --mount-deg must be finite numbers")
        given = None if camera is None else read_camera_file(camera)
        mount = None if camera else camera_mount(mount_m, attitude(*np.deg2rad(mount_deg)))
        rows, files, notes = add_scene(recording, out, ReadOptions(fov_deg, given, deck_z_m), mount)
    for note in notes:
        print_line(f"note: {note}")
    print(f"{out}: {rows} rows, {files} image files")
    return 0
