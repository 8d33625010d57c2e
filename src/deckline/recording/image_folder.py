"""Folders of images, with depth/<stem>.pfm; poses by the images' names, or by their times."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.files import is_there
from deckline.geometry import camera_mount
from deckline.recording.camera_file import MountedCamera
from deckline.recording.exif import camera_from_exif
from deckline.recording.images import DEPTH_PLANAR, IMAGE_SUFFIXES, read_depth, read_image
from deckline.recording.poses import TIMES_FILE, Poses, drop_unknown_place
from deckline.recording.read_options import ReadOptions
from deckline.recording.source import FrameError, Recording, check_index, check_number, is_inside
from deckline.types import Frame

if TYPE_CHECKING:
    from deckline.recording.pose_track import PoseTrack

DEPTH_FOLDER = "depth"  # PFM files, metres along the optical axis


class ImageFolder(Recording):
    """Images in natural order of their names. Without any times they are taken to be one second apart.

    Args:
        mounted: None: no camera is stated: images may have any sizes, and those with EXIF have its camera.
        poses: rows by the images' names, or a track by time.
        times_s: when each image was taken, by name; needed for a track.
        files: names of images in the folder; None: all that are there or have a row in `poses`.

    Attributes:
        files: names of the images, in order.
    """

    def __init__(
        self,
        folder: Path,
        mounted: MountedCamera | None,
        poses: "Poses | PoseTrack | None",
        times_s: Mapping[str, float] | None,
        options: ReadOptions,
        files: Sequence[str] | None = None,
    ) -> None:
        self.folder = folder
        self.name = str(folder if files is None else folder / files[0])
        self._mounted = mounted
        self._poses = poses
        self.pose_track = None if isinstance(poses, Poses) else poses
        self._times = times_s
        self._heights = options.deck_z_m, options.sea_z_m
        self._depth_options = (DEPTH_PLANAR, options.pfm_rows, options.far_m)
        named = poses.rows if isinstance(poses, Poses) else times_s or ()
        self.files = sorted({*list_images(folder), *named} if files is None else files, key=make_natural_key)
        apart = ", and the images are taken to be 1 s apart" if times_s is None else ""
        self.notes = (f"{folder}: no poses.csv: the pictures alone say where the aircraft is{apart}",)
        if poses is not None:
            self.notes = poses.notes if isinstance(poses, Poses) else poses.notes_on(self.times())

    def __len__(self) -> int:
        return len(self.files)

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        file = self.files[index]
        try:
            return self._frame(index, file)
        except ValueError as error:
            raise FrameError(file, str(error)) from None

    def times(self) -> NDArray[np.float64]:
        if isinstance(self._poses, Poses):
            return self._poses.times(self.files)
        if self._times is None:
            return np.arange(float(len(self)))
        return np.array([self._times.get(file, np.nan) for file in self.files])

    def _place(self, index: int) -> tuple[float, RigidTransform | None]:
        """Time in s and world_from_body of an image."""
        file = self.files[index]
        if isinstance(self._poses, Poses):
            return self._poses.at(file)
        if self._times is None:
            return float(index), None
        if file not in self._times:
            raise ValueError(f"{TIMES_FILE} has no row for it; add one, or take the image away")
        time_s = check_number(self._times[file], f"time_s in {TIMES_FILE}")
        return (time_s, None) if self._poses is None else (time_s + self._poses.offset_s, self._poses.at(time_s))

    def _frame(self, index: int, file: str) -> Frame:
        if not is_inside(file):
            raise ValueError("poses.csv must name files inside the folder")
        time_s, world_from_body = self._place(index)
        image = read_image(self.folder / file)
        mounted = self._camera(file, image.shape[1], image.shape[0])
        if mounted is None:
            return Frame(file, time_s, image)
        depth, name = None, f"{DEPTH_FOLDER}/{Path(file).stem}.pfm"
        if is_there(self.folder / name):
            depth = read_depth(self.folder / name, name, mounted.camera, *self._depth_options)
        frame = mounted.frame(file, time_s, image, world_from_body=world_from_body, depth_m=depth)
        return drop_unknown_place(frame, self._poses)

    def _camera(self, file: str, width: int, height: int) -> MountedCamera | None:
        """The camera of an image: stated, or of its EXIF; None without one."""
        if self._mounted is not None:
            return self._mounted.fit(width, height)
        camera, _ = camera_from_exif(self.folder / file, width, height)
        return None if camera is None else MountedCamera(camera, camera_mount(), *self._heights)


def list_images(folder: Path) -> list[str]:
    """Names of the image files right in a folder; hidden ones are left out."""
    return [
        child.name
        for child in folder.iterdir()
        if child.suffix.lower() in IMAGE_SUFFIXES and not child.name.startswith(".") and child.is_file()
    ]


def find_first_image(path: Path) -> tuple[Path, tuple[int, int]] | tuple[None, None]:
    """An image, or the first one in a folder that can be read, with its width and height, px; None without one."""
    files = sorted(list_images(path), key=make_natural_key) if path.is_dir() else [""]
    for file in files:
        with suppress(ValueError):
            height, width = read_image(path / file).shape[:2]
            return path / file, (width, height)
    return None, None


def make_natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts frame_2 before frame_10."""
    parts = re.split(r"([0-9]+)", name.lower())
    numbers = (part.lstrip("0") for part in parts[1::2])  # compared by their length first: int() has a longest text
    keys = [(0, 0, part) for part in parts]
    keys[1::2] = [(1, len(number), number) for number in numbers]
    return [*keys, (0, 0, name)]
