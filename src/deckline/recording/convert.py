"""Recordings in AirSim's own layout to ours with scene.json, and back to what AirSim's tools expect.

Rows and image files are copied byte for byte: both ways together give back the same recording.
"""

import shutil
from contextlib import suppress
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from deckline.files import MOST_CONFIG_BYTES, is_beneath, is_there
from deckline.recording.airsim import (
    IMAGE_FOLDER,
    RECORD_FILE,
    AirSimRecording,
    choose_images,
    list_row_images,
    read_rows,
)
from deckline.recording.camera_file import camera_to_mapping
from deckline.recording.read_options import ReadOptions
from deckline.recording.runway_file import RUNWAY_FILE
from deckline.recording.scene_file import SCENE_FILE, format_entry, format_scene, get_heights, read_scene
from deckline.recording.source import BadFrame, RecordingError, is_inside, read_data
from deckline.recording.text_table import TextTable

GENERATOR = "deckline convert"


Copied = tuple[int, int, list[str]]  # rows; files; what is odd, one line each, for people


def add_scene(
    recording: Path, out: Path, options: ReadOptions, body_from_camera: RigidTransform | None = None
) -> Copied:
    """Copy a plain AirSim recording and lay scene.json with its camera and deck height beside it.

    Args:
        options: camera with its mount, or fov_deg; deck height.
        body_from_camera: mount of a camera that is known by fov_deg; by default forward from the vehicle's middle.

    Returns:
        numbers of rows and of copied files; what is odd, one line each, for people.

    Raises:
        RecordingError: no recording, one that has scene.json, no usable frame, or `out` cannot be written.
    """
    if is_there(recording / SCENE_FILE):
        raise RecordingError(f"{recording} has {SCENE_FILE} already: nothing to add")
    rows, notes = read_rows(recording / RECORD_FILE)
    source, skipped = AirSimRecording(recording, options), list[BadFrame]()
    source.on_skip = skipped.append
    frame = next(iter(source), None)
    if frame is None:
        raise RecordingError(f"{recording}: zero usable frames; {skipped[0].file}: {skipped[0].reason}")
    mount = frame.body_from_camera if body_from_camera is None else body_from_camera
    entry = format_entry(get_heights(frame))
    entries = {}
    for _, cells in rows:
        with suppress(ValueError):  # a row without a picture
            entries[choose_images(list_row_images(cells))[0]] = entry
    scene = format_scene(camera_to_mapping(frame.camera, mount), entries, {"generator": GENERATOR})
    return _copy(recording, out, rows, notes, scene)


def drop_scene(recording: Path, out: Path) -> Copied:
    """Copy a recording without scene.json and the clear images: AirSim's layout and nothing else; as `add_scene`."""
    if not is_there(recording / SCENE_FILE):
        raise RecordingError(f"{recording} has no {SCENE_FILE}: it is in AirSim's own layout already")
    read_scene(recording / SCENE_FILE)
    rows, notes = read_rows(recording / RECORD_FILE)
    return _copy(recording, out, rows, notes, None)


def _copy(recording: Path, out: Path, rows: TextTable, notes: list[str], scene: str | None) -> Copied:
    """Under a temporary name, renamed when whole."""
    work = out.with_name(f".{out.name}.unfinished")
    files, missing = 0, []
    named = dict.fromkeys(name for _, cells in rows for name in list_row_images(cells))
    names = [name for name in named if is_inside(name)]
    _check_links(recording, [RECORD_FILE, RUNWAY_FILE, *(f"{IMAGE_FOLDER}/{name}" for name in names)])
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise RecordingError(f"{out} is there already: choose another folder")
        if work.exists():
            shutil.rmtree(work)
        (work / IMAGE_FOLDER).mkdir(parents=True)
        for name in names:
            if (recording / IMAGE_FOLDER / name).is_file():
                (work / IMAGE_FOLDER / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(recording / IMAGE_FOLDER / name, work / IMAGE_FOLDER / name)
                files += 1
            else:
                missing.append(name)
        shutil.copyfile(recording / RECORD_FILE, work / RECORD_FILE)
        if scene is not None:
            (work / SCENE_FILE).write_text(scene, encoding="utf-8")
            if is_there(recording / RUNWAY_FILE):
                (work / RUNWAY_FILE).write_bytes(read_data(recording / RUNWAY_FILE, MOST_CONFIG_BYTES))
        work.replace(out)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be written: {error.strerror or error}") from None
    if missing:
        notes = [*notes, f"{len(missing)} files named in {RECORD_FILE} are missing, such as {missing[0]}"]
    return len(rows), files, notes


def _check_links(recording: Path, names: list[str]) -> None:
    """Refuse to copy what a link brings in from elsewhere: the copy may go to people who must not see it."""
    if outside := next((name for name in names if not is_beneath(recording / name, recording)), None):
        raise RecordingError(f"{recording / outside}: a link out of the recording; put the file itself there")
