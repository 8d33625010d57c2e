"""`deckline convert`."""

from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import tyro

from deckline.extras import needs_extra
from deckline.files import print_notes
from deckline.geometry import attitude, camera_mount
from deckline.live.recorder import FrameFolder
from deckline.recording import Recording, open_recording
from deckline.recording.bag import is_bag
from deckline.recording.camera_file import read_camera_file
from deckline.recording.convert import add_scene, drop_scene
from deckline.recording.images import encode_image
from deckline.recording.read_options import ReadOptions
from deckline.types import Frame

NO_TURN = (0.0, 0.0, 0.0)


def convert(
    recording: tyro.conf.Positional[Path],
    out: Path,
    plain: bool = False,
    camera: Path | None = None,
    fov_deg: float | None = None,
    mount_m: tuple[float, float, float] = NO_TURN,
    mount_deg: tuple[float, float, float] = NO_TURN,
    deck_z_m: float | None = None,
    topic: tuple[str, ...] = (),
) -> int:
    """Copy an AirSim recording into deckline's layout with scene.json, or back with --plain; or to and from ROS bags.

    Args:
        recording: folder with airsim_rec.txt and images; a ROS bag, whose pictures, poses and depth make a folder of
            images; with an `out` that ends with .mcap any recording.
        out: new folder, or new .mcap file of the ROS 2 profile.
        plain: leave scene.json and the clear images out, for AirSim's own tools.
        camera: camera.toml with intrinsics and mount; goes before the options below.
        fov_deg: horizontal field of view, where no file has the camera; of AirSim's recordings 90 when not given.
        mount_m: where the camera sits on the vehicle: forward, right, down of its centre.
        mount_deg: how the camera is turned on the vehicle: roll, pitch (up is positive), yaw.
        deck_z_m: world z (down, metres) of the deck plane.
        topic: of a ROS bag, the topics to take where several are there.
    """
    mounted = (mount_m, mount_deg) != (NO_TURN, NO_TURN)
    if out.suffix == ".mcap" or is_bag(recording):
        if plain or mounted:
            raise ValueError("--plain, --mount-m and --mount-deg are for AirSim recordings: leave them out")
        source = open_recording(recording, camera_file=camera, fov_deg=fov_deg, deck_z_m=deck_z_m, topics=topic)
        return _copy_frames(source, out)
    if plain:
        if camera is not None or mounted or deck_z_m is not None:
            raise ValueError("--plain drops what is known of camera and deck: leave their options out")
        rows, files, notes = drop_scene(recording, out)
    else:
        if camera is not None and mounted:
            raise ValueError(f"{camera} states the camera's mount: leave --mount-m and --mount-deg out")
        if not np.isfinite((*mount_m, *mount_deg)).all():
            raise ValueError("--mount-m and --mount-deg must be finite numbers")
        given = None if camera is None else read_camera_file(camera)
        mount = None if camera else camera_mount(mount_m, attitude(*np.deg2rad(mount_deg)))
        rows, files, notes = add_scene(recording, out, ReadOptions(fov_deg, given, deck_z_m), mount)
    print_notes(notes)
    print(f"{out}: {rows} rows, {files} image files")
    return 0


def _copy_frames(source: Recording, out: Path) -> int:
    """Write frames into a bag, or a folder of images; damaged ones are named and left out."""
    print_notes(source.notes)
    count = 0
    with ExitStack() as stack:
        if out.suffix == ".mcap":
            with needs_extra("foxglove"):
                from deckline.adapters.foxglove.publisher import Publisher
                from deckline.adapters.ros.messages import depth_message, frame_messages
            bag = stack.enter_context(closing(Publisher(out, None)))

            def add(frame: Frame) -> None:
                picture = encode_image(frame.image_rgb, "png")
                bag.send(frame_messages(frame, picture, "png") + depth_message(frame), frame.time_s)
        else:
            if out.exists():
                raise ValueError(f"{out} is there already: choose another folder")
            add = stack.enter_context(closing(FrameFolder(out))).add
        for frame in source:
            add(frame)
            count += 1
    print(f"{out}: {count} frames")
    return 0


COMMANDS = {"convert": convert}
