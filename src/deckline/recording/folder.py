"""A folder of images, or a single one, with camera.toml, optional poses.csv, and optional depth/<stem>.pfm."""

import re
from collections.abc import Sequence
from pathlib import Path

from deckline.recording.camera_file import MountedCamera
from deckline.recording.depth import DEPTH_PLANAR, FAR_DEPTH_M, PfmRows, read_depth
from deckline.recording.images import IMAGE_SUFFIXES, read_image
from deckline.recording.poses import Poses
from deckline.recording.source import FrameError, Source, check_index, is_inside
from deckline.types import Frame

DEPTH_FOLDER = "depth"  # PFM files, metres along the optical axis


class ImageFolder(Source):
    """Images in natural order of their names. Without poses.csv they are taken to be one second apart.

    Args:
        files: names of images in the folder; None: all that are there or have a row in `poses`.

    Attributes:
        files: names of the images, in order.
    """

    def __init__(
        self,
        folder: Path,
        mounted: MountedCamera,
        poses: Poses | None,
        pfm_rows: PfmRows = "top-to-bottom",
        far_m: float = FAR_DEPTH_M,
        files: Sequence[str] | None = None,
    ) -> None:
        self.folder = folder
        self.name = str(folder if files is None else folder / files[0])
        self._mounted = mounted
        self._poses = poses
        self._depth_options = (DEPTH_PLANAR, pfm_rows, far_m)
        found = {*list_images(folder), *(poses.rows if poses else ())} if files is None else files
        self.files = sorted(found, key=natural_key)
        no_poses = (f"{folder}: no poses.csv: no positions, and the images are taken to be 1 s apart",)
        self.notes = poses.notes if poses else no_poses

    def __len__(self) -> int:
        return len(self.files)

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        file = self.files[index]
        try:
            return self._frame(index, file)
        except ValueError as error:
            raise FrameError(file, str(error)) from None

    def _frame(self, index: int, file: str) -> Frame:
        if not is_inside(file):
            raise ValueError("poses.csv must name files inside the folder")
        time_s, world_from_body = (float(index), None) if self._poses is None else self._poses.at(file)
        image = read_image(self.folder / file)
        depth, name = None, f"{DEPTH_FOLDER}/{Path(file).stem}.pfm"
        if (self.folder / name).exists():
            depth = read_depth(self.folder / name, name, self._mounted.camera, *self._depth_options)
        return self._mounted.frame(file, time_s, image, world_from_body=world_from_body, depth_m=depth)


def list_images(folder: Path) -> list[str]:
    """Names of the image files right in a folder; hidden ones are left out."""
    return [
        child.name
        for child in folder.iterdir()
        if child.suffix.lower() in IMAGE_SUFFIXES and not child.name.startswith(".") and child.is_file()
    ]


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts frame_2 before frame_10."""
    parts = re.split(r"([0-9]+)", name.lower())
    return [*((1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts), (0, 0, name)]
