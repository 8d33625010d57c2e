"""`deckline labels export` and `import`: runway lines in the formats of other tools, with their images."""

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from deckline.atomic import write_atomic
from deckline.files import is_there
from deckline.geometry import Camera
from deckline.recording import BadFrame, Recording
from deckline.recording.camera_file import CAMERA_FILE, format_camera, read_camera_file
from deckline.recording.images import IMAGE_SUFFIXES, encode_image, read_bytes
from deckline.recording.source import is_inside
from deckline.types import Frame
from deckline_lab.labels.coco import read_coco, write_coco
from deckline_lab.labels.labelme import read_labelme, write_labelme
from deckline_lab.labels.lanes import (
    MASK_FOLDER,
    get_mask_name,
    read_culane,
    read_tusimple,
    write_culane,
    write_tusimple,
)
from deckline_lab.labels.lines import (
    LABELS_FILE,
    LabelledImage,
    LabelSet,
    is_in_picture,
    read_labels,
    read_size,
    write_labels,
)
from deckline_lab.labels.of_frame import label_frame
from deckline_lab.labels.yolo_pose import read_yolo_pose, write_yolo_pose
from deckline_sim.progress import progress

Format = Literal["tusimple", "culane", "coco", "yolo-pose", "labelme"]
TUSIMPLE_FILE, COCO_FILE = "label_data.json", "annotations.json"
READERS: dict[Format, Callable[[Path], LabelSet]] = {
    "tusimple": read_tusimple,
    "culane": read_culane,
    "coco": read_coco,
    "yolo-pose": read_yolo_pose,
    "labelme": read_labelme,
}
WRITERS: dict[Format, Callable[[Path, list[LabelledImage], int, int], None]] = {
    "tusimple": lambda out, images, row_step_px, _: write_tusimple(out / TUSIMPLE_FILE, images, row_step_px),
    "culane": lambda out, images, row_step_px, _: write_culane(out, images, row_step_px),
    "coco": lambda out, images, _, line_points: write_coco(out / COCO_FILE, images, line_points),
    "yolo-pose": lambda out, images, _, line_points: write_yolo_pose(out, images, line_points),
    "labelme": lambda out, images, _, line_points: write_labelme(out, images, line_points),
}
MASK_PX = 16.0 / 1640.0  # width of a line in a mask over the image's width: CULane's laneseg_label_w16


def export_labels(
    source: Recording, folder: Path, out: Path, form: Format, row_step_px: int, line_points: int
) -> tuple[list[LabelledImage], list[str]]:
    """Write images and labels below `out`, a new folder; the labels' file comes last.

    Args:
        source: frames with truth, or those of a folder with labels.json.
        folder: where labels.json lies, if there is one.
        row_step_px: rows between points, of formats with rows.
        line_points: points of a line, of formats with points.

    Returns:
        what was written; what is odd about it, one line each, for people.

    Raises:
        ValueError: `out` holds files already, or no frame can be labelled.
    """
    image_folder = "clips" if form == "tusimple" else "images"
    _check_new(out, (image_folder, MASK_FOLDER, CAMERA_FILE))
    labels = read_labels(folder / LABELS_FILE) if is_there(folder / LABELS_FILE) else None
    images, notes, cameras = [], [], set()
    with progress("exporting", len(source)) as advance:
        for item in source.items():
            advance()
            if isinstance(item, BadFrame):
                notes.append(f"skipped {item.file}: {item.reason}")
            elif labels is None or item.file in labels:
                stem = re.sub(r"[^\w.-]+", "_", item.file.rpartition(".")[0] or item.file)  # list files hold no spaces
                name = f"{image_folder}/{stem}.png"
                if labels is None:
                    image = label_frame(item, name)
                else:
                    left, right = labels[item.file].values()
                    image = LabelledImage(name, left, right, (item.camera.width, item.camera.height))
                _write_picture(out, item, image, form)
                images.append(image)
                if item.camera.known:
                    cameras.add(format_camera(item.camera, item.body_from_camera))
    if not images:
        raise ValueError(f"{folder}: no frame that could be labelled")
    _check_unique([image.file for image in images], f"{folder}: several frames would be called")
    if len(cameras) == 1:
        write_atomic(out / CAMERA_FILE, cameras.pop().encode())
    elif cameras:
        notes.append(f"{len(cameras)} different cameras: no {CAMERA_FILE} was written; give one when importing")
    WRITERS[form](out, images, row_step_px, line_points)
    return images, notes


def _write_picture(out: Path, frame: Frame, image: LabelledImage, form: Format) -> None:
    (out / image.file).parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out / image.file, encode_image(frame.image_rgb, "png"))
    if form == "culane":
        width, height = image.size
        mask = np.zeros((height, width), dtype=np.uint8)
        for value, line in enumerate(image.lines.values(), 1):
            if line is not None:
                cv2.polylines(mask, [np.rint(line).astype(np.int32)], False, value, max(round(MASK_PX * width), 1))
        (out / get_mask_name(image.file)).parent.mkdir(parents=True, exist_ok=True)
        write_atomic(out / get_mask_name(image.file), cv2.imencode(".png", mask)[1].tobytes())


def import_labels(
    source: Path,
    form: Format,
    out: Path,
    images: Path | None = None,
    camera: Path | None = None,
    keypoints: Sequence[str] = (),
) -> list[LabelledImage]:
    """Copy labelled images into a new folder and write labels.json beside them, at last.

    Args:
        source: label file, or the data set's folder.
        images: folder that the images' names are relative to; None: where the labels lie.
        camera: camera.toml, copied too; None: the one beside the labels, if there is one.
        keypoints: their names in order, of YOLO-pose; see `read_yolo_pose`.

    Returns:
        what was imported, with the images' new names.

    Raises:
        ValueError: labels that cannot be read, an image that is missing, damaged, or of another size than the camera's.
    """
    if keypoints and form != "yolo-pose":
        raise ValueError(f"--keypoints names those of yolo-pose; the format is {form}")
    label_root, labelled = read_yolo_pose(source, keypoints) if keypoints else READERS[form](source)
    root = images or label_root
    beside = (path for path in (root / CAMERA_FILE, label_root / CAMERA_FILE) if is_there(path))
    camera = camera or next(beside, None)
    mounted = None if camera is None else read_camera_file(camera)
    names = _flatten_names([image.file for image in labelled], source)
    _check_new(out, {*names, CAMERA_FILE})
    out.mkdir(parents=True, exist_ok=True)
    imported = []
    with progress("importing", len(names)) as advance:
        for image, name in zip(labelled, names, strict=True):
            if not (root / image.file).is_file():
                raise ValueError(f"{source}: image {image.file} is not in {root}; give --images FOLDER where it is")
            size = read_size(root / image.file)
            _check_size(image, size, None if mounted is None else mounted.camera)
            write_atomic(out / name, read_bytes(root / image.file, "image"))
            imported.append(replace(image, file=name, size_px=size))
            advance()
    if mounted is not None:
        write_atomic(out / CAMERA_FILE, format_camera(mounted.camera, mounted.body_from_camera).encode())
    write_labels(out / LABELS_FILE, imported)
    return imported


def _flatten_names(files: list[str], source: Path) -> list[str]:
    """Names in one folder: the images' own where no two are the same, else with their folders in front."""
    for file in files:
        if not is_inside(file):
            raise ValueError(f"{source}: image {file!r} must be a path inside the data set; or give --images FOLDER")
        if Path(file).suffix.lower() not in IMAGE_SUFFIXES:  # nor may it take the place of labels.json
            raise ValueError(f"{source}: image {file!r} must be named as one: {' '.join(IMAGE_SUFFIXES)}")
    names = [Path(file).name for file in files]
    if len(set(names)) < len(names):
        names = ["_".join(Path(file).parts) for file in files]
    _check_unique(names, f"{source}: several images would be called")
    return names


def _check_unique(names: list[str], what: str) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{what} {twice[0]}; give each a name of its own")


def _check_new(out: Path, unfinished: Collection[str]) -> None:
    """Refuse a folder that holds more than what a command leaves when it is stopped."""
    others = sorted(path.name for path in out.iterdir() if path.name not in unfinished) if out.exists() else []
    if others:
        raise ValueError(f"{out} holds {others[0]} already: choose a new folder")


def _check_size(image: LabelledImage, size: tuple[int, int], camera: Camera | None) -> None:
    if camera is not None and size != (camera.width, camera.height):
        raise ValueError(
            f"{image.file} is {size[0]}x{size[1]} px, the camera {camera.width}x{camera.height}: "
            f"import images of each size into a folder of their own"
        )
    if image.size_px not in (None, size):
        raise ValueError(f"{image.file} is {size[0]}x{size[1]} px, its labels are for {image.size_px}")
    for side, line in image.lines.items():
        if line is not None and not is_in_picture(line, size).any():
            raise ValueError(f"{image.file}: its {side} line lies outside of its {size[0]}x{size[1]} px")
