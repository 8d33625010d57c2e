"""Writes the frames that were flown as a folder of images that `deckline run` answers in the same way."""

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.atomic import write_atomic
from deckline.geometry import Camera, pose
from deckline.recording.camera_file import CAMERA_FILE, format_camera
from deckline.recording.image_folder import DEPTH_FOLDER
from deckline.recording.images import encode_depth, encode_image
from deckline.recording.poses import COLUMNS, POSES_FILE
from deckline.recording.scene_file import get_heights
from deckline.types import Frame, PoseSource

POSITION_DIGITS, QUATERNION_DIGITS = 6, 12  # decimals of what is written: 1 um, 1e-12 rad
NO_NAME = r"[^\w.#-]"  # characters that names of files do without
ROUNDS = 20  # of rounding until nothing changes; a quaternion needs two or three


class FrameFolder:
    """Writes images, depth maps, the first frame's camera.toml, and poses.csv, whose rows of
    frames without a pose give the time only.

    Args:
        folder: made; must not exist.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        self._folder = folder
        self._camera: Camera | None = None
        self._rows = (folder / POSES_FILE).open("w", encoding="utf-8", newline="\n")
        self._rows.write(",".join(COLUMNS) + "\n")

    def add(self, frame: Frame) -> None:
        """Write a frame. Raises OSError, or ValueError for a frame of another camera than the first one's."""
        name = f"{re.sub(NO_NAME, '_', frame.file).removesuffix('.png')}.png"
        if self._camera is None:
            self._camera = frame.camera
            if frame.camera.known:
                text = format_camera(frame.camera, frame.body_from_camera, get_heights(frame))
                write_atomic(self._folder / CAMERA_FILE, text.encode())
        if frame.camera != self._camera:
            raise ValueError(f"{frame.file}: another camera than that of the recording's first frame")
        write_atomic(self._folder / name, encode_image(frame.image_rgb, "png"))
        if frame.depth_m is not None:
            (self._folder / DEPTH_FOLDER).mkdir(exist_ok=True)
            write_atomic(self._folder / DEPTH_FOLDER / f"{Path(name).stem}.pfm", encode_depth(frame.depth_m))
        cells = [name, repr(float(frame.time_s)), *_pose_cells(frame)]
        self._rows.write(",".join(cells) + "\n")
        self._rows.flush()

    def close(self) -> None:
        self._rows.close()


def round_pose(world_from_body: RigidTransform) -> RigidTransform:
    """The pose that its own written numbers give back bit by bit, so that a replay computes the same."""
    for _ in range(ROUNDS):
        before, numbers = world_from_body, _pose_numbers(world_from_body)
        world_from_body = pose(numbers[:3], numbers[3:])
        if np.array_equal(before.as_matrix(), world_from_body.as_matrix()):
            break
    return world_from_body


def _pose_numbers(world_from_body: RigidTransform) -> list[float]:
    """Position and quaternion as they are written."""
    translation, rotation = world_from_body.as_components()
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    return [*np.round(translation, POSITION_DIGITS).tolist(), *np.round(quaternion, QUATERNION_DIGITS).tolist()]


def _pose_cells(frame: Frame) -> list[str]:
    """Position and quaternion; empty cells without a pose, and for one that the picture gives again."""
    if frame.world_from_body is None or frame.pose_source is PoseSource.PICTURE:
        return [""] * len(COLUMNS[2:])
    return [repr(number) for number in _pose_numbers(frame.world_from_body)]
