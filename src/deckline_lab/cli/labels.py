"""`deckline labels`: runway lines in the formats that people label in."""

from pathlib import Path

import tyro

from deckline.files import print_line
from deckline.recording import open_recording
from deckline_lab.labels import LABELS_FILE, LabelledImage
from deckline_lab.labels.exchange import Format, export_labels, import_labels


def export(
    source: tyro.conf.Positional[Path],
    out: Path,
    format: Format,
    camera: Path | None = None,
    fov_deg: float | None = None,
    row_step_px: int = 1,
    line_points: int = 9,
) -> int:
    """Write images and their runway lines in a format of labelling tools and trainers.

    Args:
        source: recording with truth (scene.json), or a folder of images with labels.json.
        out: new folder.
        format: tusimple, culane, coco keypoints, yolo-pose or labelme.
        camera: camera.toml, when it does not lie beside the images.
        fov_deg: horizontal field of view, where no file has the camera.
        row_step_px: rows between points, of TuSimple and CULane; TuSimple's own is 10, too coarse for a far runway.
        line_points: points of a line, of COCO, YOLO-pose and labelme.
    """
    if row_step_px < 1:
        raise ValueError(f"--row-step-px must be at least 1, got {row_step_px}")
    opened = open_recording(source, camera_file=camera, fov_deg=fov_deg)
    images, notes = export_labels(opened, source, out, format, row_step_px, line_points)
    for note in notes:
        print_line(f"note: {note}")
    print(f"{out}: {_format_counts(images)}")
    return 0


def import_(
    source: tyro.conf.Positional[Path],
    out: Path,
    format: Format,
    images: Path | None = None,
    camera: Path | None = None,
    keypoints: tuple[str, ...] = (),
) -> int:
    """Bring labels of other tools into a folder that deckline evaluates and trains on.

    Args:
        source: label file, or the data set's folder.
        out: new folder: the images, labels.json, and camera.toml where there is one.
        format: tusimple, culane, coco, yolo-pose or labelme.
        images: folder that the images' names are relative to, when it is not the labels' own.
        camera: camera.toml of the camera that took the images, when it does not lie beside the labels.
        keypoints: of YOLO-pose, the side of each in order, such as left left right right; any other word leaves one
            out. By default kpt_names of data.yaml, else the first half is left and the second right.
    """
    imported = import_labels(source, format, out, images, camera, keypoints)
    if ignored := sorted({label for image in imported for label in image.ignored}):
        print_line(f"note: left out, as they name no side (left or right): {', '.join(ignored)}")
    print(f"{out / LABELS_FILE}: {_format_counts(imported)}")
    return 0


def _format_counts(images: list[LabelledImage]) -> str:
    both = sum(all(line is not None for line in image.lines.values()) for image in images)
    none = sum(all(line is None for line in image.lines.values()) for image in images)
    return f"{len(images)} images: {both} with both lines, {len(images) - both - none} with one, {none} with none"


COMMANDS = {"export": export, "import": import_}
