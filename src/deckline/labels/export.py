"""`deckline labels export`: a recording's true lines, or labels.json, in a format that other tools read."""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from deckline.atomic import write_atomic
from deckline.labels import LABELS_FILE, LabelledImage, Labels, read_labels, write_coco, write_culane, write_tusimple
from deckline.labels.culane import MASK_FOLDER, mask_name
from deckline.labels.truth import label_frame
from deckline.progress import progress
from deckline.recording import BadFrame, Source
from deckline.recording.camera_file import CAMERA_FILE, camera_text
from deckline.recording.images import encode_image
from deckline.types import Frame

Format = Literal["tusimple", "culane", "coco"]
IMAGE_FOLDERS: dict[Format, str] = {"tusimple": "clips", "culane": "images", "coco": "images"}
TUSIMPLE_FILE, COCO_FILE = "label_data.json", "annotations.json"
MASK_PX = 16.0 / 1640.0  # width of a line in a mask over the image's width: CULane's laneseg_label_w16


def export_labels(
    source: Source, folder: Path, out: Path, form: Format, row_step_px: int, line_points: int
) -> tuple[list[LabelledImage], list[str]]:
    """Write images and labels below `out`; the labels' file comes last.

    Args:
        source: frames with truth, or those of a folder with labels.json.
        folder: where labels.json lies, if there is one.
        out: new folder.
        form: which format.
        row_step_px: rows between points, of formats that keep rows.
        line_points: keypoints of a line, of COCO.

    Returns:
        what was written; what is odd about it, one line each, for people.

    Raises:
        ValueError: `out` holds files already, or no frame can be labelled.
    """
    check_new(out, (IMAGE_FOLDERS[form], MASK_FOLDER, CAMERA_FILE))
    labels = read_labels(folder / LABELS_FILE) if (folder / LABELS_FILE).exists() else None
    images, notes, cameras = [], [], set()
    with progress("exporting", len(source)) as advance:
        for item in source.items():
            advance()
            if isinstance(item, BadFrame):
                notes.append(f"skipped {item.file}: {item.reason}")
            elif labels is None or item.file in labels:
                name = f"{IMAGE_FOLDERS[form]}/{_plain_name(item.file)}.png"
                image = label_frame(item, name) if labels is None else _labelled(item, name, labels[item.file])
                _write_picture(out, item, image, form)
                images.append(image)
                cameras.add(camera_text(item.camera, item.body_from_camera))
    _check(images, folder)
    if len(cameras) == 1:
        write_atomic(out / CAMERA_FILE, cameras.pop().encode())
    else:
        notes.append(f"{len(cameras)} different cameras: no {CAMERA_FILE} was written; give one when importing")
    _write_labels(out, images, form, row_step_px, line_points)
    return images, notes


def check_new(out: Path, unfinished: Collection[str]) -> None:
    """Refuse a folder that holds more than what a command leaves when it is stopped.

    Raises:
        ValueError: names what else is there.
    """
    others = sorted(path.name for path in out.iterdir() if path.name not in unfinished) if out.exists() else []
    if others:
        raise ValueError(f"{out} holds {others[0]} already: choose a new folder")


def _plain_name(file: str) -> str:
    """A file name's stem without spaces, slashes and what else a list file cannot hold."""
    return re.sub(r"[^\w.-]+", "_", file.rpartition(".")[0] or file)


def _labelled(frame: Frame, name: str, lines: Labels) -> LabelledImage:
    return LabelledImage(name, lines["left"], lines["right"], (frame.camera.width, frame.camera.height))


def _check(images: list[LabelledImage], folder: Path) -> None:
    if not images:
        raise ValueError(f"{folder}: no frame that could be labelled")
    names = [image.file for image in images]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{folder}: several frames would be called {twice[0]}; rename their files")


def _write_picture(out: Path, frame: Frame, image: LabelledImage, form: Format) -> None:
    (out / image.file).parent.mkdir(parents=True, exist_ok=True)
    write_atomic(out / image.file, encode_image(frame.image_rgb, "png"))
    if form == "culane":
        mask = _mask(image, frame.camera.width, frame.camera.height)
        (out / mask_name(image.file)).parent.mkdir(parents=True, exist_ok=True)
        write_atomic(out / mask_name(image.file), cv2.imencode(".png", mask)[1].tobytes())


def _mask(image: LabelledImage, width: int, height: int) -> np.ndarray:
    """The lines drawn into a picture (H, W) of 0: left 1, right 2."""
    mask = np.zeros((height, width), dtype=np.uint8)
    for value, line in enumerate(image.lines.values(), 1):
        if line is not None:
            cv2.polylines(mask, [np.rint(line).astype(np.int32)], False, value, max(round(MASK_PX * width), 1))
    return mask


def _write_labels(out: Path, images: list[LabelledImage], form: Format, row_step_px: int, line_points: int) -> None:
    if form == "tusimple":
        write_tusimple(out / TUSIMPLE_FILE, images, row_step_px)
    elif form == "culane":
        write_culane(out, images, row_step_px)
    else:
        write_coco(out / COCO_FILE, images, line_points)
