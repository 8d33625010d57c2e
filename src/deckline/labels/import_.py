"""`deckline labels import`: labels of other tools into images with labels.json and camera.toml beside them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from deckline.atomic import write_atomic
from deckline.geometry import Camera, camera_mount
from deckline.labels import LABELS_FILE, LabelledImage, LabelSet, read_coco, read_culane, read_tusimple, write_labels
from deckline.labels.export import Format, check_new
from deckline.progress import progress
from deckline.recording.camera_file import CAMERA_FILE, MountedCamera, camera_text, read_camera_file
from deckline.recording.images import read_bytes, read_image
from deckline.recording.source import is_inside

READERS: dict[Format, Callable[[Path], LabelSet]] = {
    "tusimple": read_tusimple,
    "culane": read_culane,
    "coco": read_coco,
}


def import_labels(
    source: Path, form: Format, out: Path, images: Path | None, camera: Path | None, fov_deg: float | None
) -> list[LabelledImage]:
    """Copy labelled images into one folder and write labels.json and camera.toml beside them, labels.json last.

    Args:
        source: label file, or the data set's folder.
        form: its format.
        out: new folder.
        images: folder that the images' names are relative to; None: where the labels lie.
        camera: camera.toml; None: the one beside the labels, if there is one.
        fov_deg: horizontal field of view of a pinhole, where there is no camera file.

    Returns:
        what was imported, with the images' new names.

    Raises:
        ValueError: labels that cannot be read, an image that is missing or damaged, or no camera.
    """
    found = READERS[form](source)
    root = images or found.root
    mounted = _camera_file(camera, [root / CAMERA_FILE, found.root / CAMERA_FILE])
    names = _flat_names([image.file for image in found.images], source)
    check_new(out, {*names, CAMERA_FILE})
    out.mkdir(parents=True, exist_ok=True)
    imported = []
    with progress("importing", len(names)) as advance:
        for image, name in zip(found.images, names, strict=True):
            picture = _picture(root, image.file, source)
            height, width = picture.shape[:2]
            mounted = mounted or _pinhole(width, height, fov_deg, root)
            _check_size(image, (width, height), mounted.camera)
            write_atomic(out / name, read_bytes(root / image.file, "image"))
            imported.append(replace(image, file=name, size_px=(width, height)))
            advance()
    if mounted is not None:
        write_atomic(out / CAMERA_FILE, camera_text(mounted.camera, mounted.body_from_camera).encode())
    write_labels(out / LABELS_FILE, imported)
    return imported


def _camera_file(given: Path | None, candidates: list[Path]) -> MountedCamera | None:
    for path in [given] if given is not None else candidates:
        if path == given or path.exists():
            return read_camera_file(path)
    return None


def _pinhole(width: int, height: int, fov_deg: float | None, root: Path) -> MountedCamera:
    if fov_deg is None:
        raise ValueError(f"{root}: no {CAMERA_FILE}: give --camera FILE, or --fov-deg of a camera without distortion")
    return MountedCamera(Camera.from_fov(width, height, np.deg2rad(fov_deg)), camera_mount())


def _flat_names(files: list[str], source: Path) -> list[str]:
    """Names in one folder: the images' own where no two are the same, else with their folders in front."""
    for file in files:
        if not is_inside(file):
            raise ValueError(f"{source}: image {file!r} must be a path inside the data set; or give --images FOLDER")
    own = [Path(file).name for file in files]
    if len(set(own)) < len(own):
        own = ["_".join(Path(file).parts) for file in files]
    twice = sorted({name for name in own if own.count(name) > 1})
    if twice:
        raise ValueError(f"{source}: image {twice[0]} is labelled more than once")
    return own


def _picture(root: Path, file: str, source: Path) -> np.ndarray:
    if not (root / file).is_file():
        raise ValueError(f"{source}: image {file} is not in {root}; give --images FOLDER where it is")
    try:
        return read_image(root / file)
    except ValueError as error:
        raise ValueError(f"{root / file}: {error}") from None


def _check_size(image: LabelledImage, size: tuple[int, int], camera: Camera) -> None:
    if size != (camera.width, camera.height):
        raise ValueError(
            f"{image.file} is {size[0]}x{size[1]} px, the camera {camera.width}x{camera.height}: "
            f"import images of each size into a folder of their own"
        )
    for side, line in image.lines.items():
        if line is not None and not np.all((line >= -0.5) & (line <= np.array(size) - 0.5), axis=1).any():
            raise ValueError(f"{image.file}: its {side} line lies outside of its {size[0]}x{size[1]} px")
