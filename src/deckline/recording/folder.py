"""A folder of images with camera.toml, optional poses.csv, and optional depth/<stem>.pfm."""

import re
from pathlib import Path

from deckline.recording.camera_file import MountedCamera
from deckline.recording.depth import DEPTH_PLANAR, along_axis, check_depth_size, check_size
from deckline.recording.images import IMAGE_SUFFIXES, read_depth_pfm, read_image
from deckline.recording.netpbm import PfmRows
from deckline.recording.poses_file import Poses
from deckline.recording.source import FrameError, Source, check_index, is_inside
from deckline.types import Frame

DEPTH_FOLDER = "depth"  # PFM files, metres along the optical axis


class ImageFolder(Source):
    """Images in natural order of their names. Without poses.csv they are taken to be one second apart.

    Attributes:
        files: names of the images, in order.
    """

    def __init__(
        self,
        folder: Path,
        mounted: MountedCamera,
        poses: Poses | None,
        pfm_rows: PfmRows,
        far_m: float,
    ) -> None:
        self.folder = folder
        self.name = str(folder)
        self._mounted = mounted
        self._poses = poses
        self._pfm_rows: PfmRows = pfm_rows
        self._far_m = far_m
        found = list_images(folder)
        self.files = sorted({*found, *(poses.rows if poses else ())}, key=natural_key)
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
        camera = self._mounted.camera
        check_size(camera, image.shape[:2])
        depth = None
        depth_path = self.folder / DEPTH_FOLDER / f"{Path(file).stem}.pfm"
        if depth_path.exists():
            stored = read_depth_pfm(depth_path, self._pfm_rows)
            check_depth_size(stored.shape, camera, f"{DEPTH_FOLDER}/{depth_path.name}")
            depth = along_axis(stored, camera, DEPTH_PLANAR, self._far_m)
        return Frame(
            file=file,
            time_s=time_s,
            image_rgb=image,
            camera=camera,
            body_from_camera=self._mounted.body_from_camera,
            depth_m=depth,
            world_from_body=world_from_body,
            deck_z_m=self._mounted.deck_z_m,
            sea_z_m=self._mounted.sea_z_m,
        )


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
