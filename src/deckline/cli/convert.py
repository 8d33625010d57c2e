"""What `deckline convert` makes of its options."""

from pathlib import Path

import numpy as np

from deckline.geometry import attitude, camera_mount
from deckline.recording.airsim import AirSimOptions
from deckline.recording.camera_file import read_camera_file
from deckline.recording.convert import Converted, add_scene, drop_scene

NO_TURN = (0.0, 0.0, 0.0)


def convert_recording(
    recording: Path,
    out: Path,
    plain: bool,
    camera: Path | None,
    fov_deg: float,
    mount_m: tuple[float, float, float],
    mount_deg: tuple[float, float, float],
    deck_z_m: float | None,
) -> Converted:
    """Add scene.json, or drop it when `plain`; the other arguments as the command has them.

    Raises:
        ValueError: options that contradict each other, or a recording that cannot be converted.
    """
    mounted = (mount_m, mount_deg) != (NO_TURN, NO_TURN)
    if plain:
        if camera is not None or mounted or deck_z_m is not None:
            raise ValueError("--plain drops what is known of camera and deck: leave their options out")
        return drop_scene(recording, out)
    if camera is not None and mounted:
        raise ValueError(f"{camera} says how the camera is mounted: leave --mount-m and --mount-deg out")
    if not 0.0 < fov_deg < 180.0:
        raise ValueError(f"--fov-deg must lie between 0 and 180, got {fov_deg}")
    if not np.isfinite((*mount_m, *mount_deg, 0.0 if deck_z_m is None else deck_z_m)).all():
        raise ValueError("--mount-m, --mount-deg and --deck-z-m must be finite numbers")
    given = None if camera is None else read_camera_file(camera)
    options = AirSimOptions(fov_deg, given, None, deck_z_m)
    mount = camera_mount(mount_m, attitude(*np.deg2rad(mount_deg)))
    return add_scene(recording, out, options, None if camera is not None else mount)
