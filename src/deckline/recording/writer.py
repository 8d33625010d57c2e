"""Writes recordings in AirSim's layout with scene.json beside them; a killed writer can be resumed."""

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, TextIO

import numpy as np

from deckline.atomic import write_atomic
from deckline.checks import check_choice
from deckline.files import lock_folder
from deckline.recording.airsim import HEADER, IMAGE_FOLDER, MS_PER_S, RECORD_FILE, SCENE, choose_images
from deckline.recording.camera_file import camera_to_mapping
from deckline.recording.images import DEPTH_PLANAR, encode_depth, encode_image
from deckline.recording.scene_file import (
    RESERVED,
    SCENE_FILE,
    format_entry,
    format_scene,
    get_heights,
    read_scene,
    truth_to_mapping,
)
from deckline.recording.source import RecordingError, read_text
from deckline.types import Frame

ImageFormat = Literal["png", "ppm", "jpg"]
CLEAR_FOLDER = "clear"
SCENE_EVERY = 25  # frames between two writings of scene.json; a killed writer loses fewer than these ...
LONG = 1000  # ... for each so many frames of a recording, so that long ones do not write it all the time
MAY_CHANGE = ("command", "generator")  # free scene keys that may differ when a recording is resumed


@dataclass(frozen=True, eq=False)
class EncodedFrame:
    """A frame as its files hold it, without their names: small to hand from one process to another."""

    time_s: float
    image: bytes  # file of the image, `image_format`
    image_format: ImageFormat
    depth: bytes | None  # PFM file of the depth
    clear: bytes | None  # file of the view without haze, `image_format`
    pose: tuple[float, ...]  # world_from_body: x, y, z in metres, then w, x, y, z of the quaternion
    camera: dict[str, Any]  # as scene.json holds it
    entry: dict[str, Any]  # the rest of the frame's entry in scene.json; its clear image has no name yet


def encode_frame(frame: Frame, image_format: ImageFormat = "png") -> EncodedFrame:
    """Encode a frame's image, its depth and its view without haze; a ValueError without a finite pose."""
    if frame.world_from_body is None:
        raise ValueError(f"{frame.file}: a recording needs the pose world_from_body of every frame")
    translation, rotation = frame.world_from_body.as_components()
    pose = (*np.asarray(translation).tolist(), *rotation.as_quat(scalar_first=True).tolist())
    if not np.all(np.isfinite(pose)):
        raise ValueError(f"{frame.file}: pose is not finite: {list(pose)}")
    entry: dict[str, Any] = dict(get_heights(frame))
    depth, clear = None if frame.depth_m is None else encode_depth(frame.depth_m), None
    if frame.truth is not None:
        entry["truth"] = truth_to_mapping(frame.truth, None if frame.truth.clear_rgb is None else CLEAR_FOLDER)
        if frame.truth.clear_rgb is not None:
            clear = encode_image(frame.truth.clear_rgb, image_format)
    image = encode_image(frame.image_rgb, image_format)
    camera = camera_to_mapping(frame.camera, frame.body_from_camera)
    return EncodedFrame(float(frame.time_s), image, image_format, depth, clear, pose, camera, entry)


class RecordingWriter:
    """Appends frames to a recording folder.

    Every file is written under a temporary name and renamed; a row is appended to airsim_rec.txt and flushed after the
    files that it names. Opening a folder that an earlier writer left goes on after its last whole frame.

    Args:
        out: folder, made when missing.
        image_format: "png", "ppm" (large, but quick to write) or "jpg" (small, with a camera's losses).
        scene: free keys of scene.json (preset, seed, ...), plain JSON values.
        vehicle, camera_name: parts of the image files' names.

    Raises:
        RecordingError: the folder cannot be written, or holds another recording.
        ValueError: another image format.
    """

    def __init__(
        self,
        out: Path,
        image_format: ImageFormat = "png",
        scene: dict[str, Any] | None = None,
        *,
        vehicle: str = "deckline",
        camera_name: str = "0",
    ) -> None:
        check_choice("image_format", image_format, ImageFormat)
        self.out = Path(out)
        self.written_bytes = 0  # of pictures and depth, by this writer
        self._format: ImageFormat = image_format
        self._extra = dict(scene or {})
        self._prefix = f"img_{vehicle}_{camera_name}"
        self._vehicle = vehicle
        self._camera: dict[str, Any] | None = None
        self._frames: dict[str, str] = {}  # entries of scene.json as text: small, and written often
        self._last_ns = -1
        self._rows: TextIO | None = None
        reserved = sorted(set(self._extra) & set(RESERVED))
        if reserved:
            raise RecordingError(f"scene keys {', '.join(reserved)} are the writer's own")
        self._stack = ExitStack()
        try:
            self._stack.enter_context(lock_folder(self.out))
        except ValueError as error:
            raise RecordingError(str(error)) from None
        try:
            (self.out / IMAGE_FOLDER).mkdir(parents=True, exist_ok=True)
            rows = self._read_whole_rows() if (self.out / RECORD_FILE).exists() else []
            self._write_scene()
            write_atomic(self.out / RECORD_FILE, ("\t".join(HEADER) + "\n" + "".join(rows)).encode())
            self._rows = (self.out / RECORD_FILE).open("a", encoding="utf-8", newline="\n")
        except OSError as error:
            raise RecordingError(f"{self.out}: cannot be written: {error.strerror or error}") from None

    @property
    def count(self) -> int:
        """Frames that are whole in the folder."""
        return len(self._frames)

    def add(self, frame: Frame) -> None:
        """Write one frame: image, depth and clear image when it has them, pose, truth.

        Raises:
            ValueError: a frame without pose, or a writer that is closed.
            OSError: the disk refuses.
        """
        self.append(encode_frame(frame, self._format))

    def append(self, encoded: EncodedFrame) -> None:
        """Write the files of a frame that `encode_frame` made; errors as `add`."""
        if self._rows is None:
            raise ValueError(f"the writer of {self.out} is closed")
        if encoded.image_format != self._format:
            raise ValueError(f"the writer of {self.out} takes {self._format} files, got {encoded.image_format}")
        ns = max(round(encoded.time_s * 1e9), self._last_ns + 1)
        name = f"{self._prefix}_{SCENE}_{ns}.{self._format}"
        names = [name]
        write_atomic(self.out / IMAGE_FOLDER / name, encoded.image)
        if encoded.depth is not None:
            names.append(f"{self._prefix}_{DEPTH_PLANAR}_{ns}.pfm")
            write_atomic(self.out / IMAGE_FOLDER / names[-1], encoded.depth)
        if encoded.clear is not None:
            (self.out / CLEAR_FOLDER).mkdir(exist_ok=True)
            write_atomic(self.out / CLEAR_FOLDER / name, encoded.clear)
        self._frames[name] = format_entry(self._make_entry(encoded, name))
        self.written_bytes += sum(len(data) for data in (encoded.image, encoded.depth, encoded.clear) if data)
        self._last_ns = ns
        time_ms = f"{encoded.time_s * MS_PER_S:.3f}".rstrip("0").rstrip(".")  # AirSim writes whole ms; we write us
        cells = (self._vehicle, time_ms, *map(repr, encoded.pose), ";".join(names))
        self._rows.write("\t".join(cells) + "\n")
        self._rows.flush()
        if self.count % (SCENE_EVERY * max(1, self.count // LONG)) == 0:
            self._write_scene()

    def close(self) -> None:
        """Write scene.json a last time. A second call does nothing."""
        if self._rows is not None:
            self._rows.close()
            self._rows = None
            self._write_scene()
            self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _read_whole_rows(self) -> list[str]:
        """Rows of an earlier writer up to the first that is not whole; takes over their scene entries."""
        if not (self.out / SCENE_FILE).exists():
            raise RecordingError(
                f"{self.out} holds a recording without {SCENE_FILE}, which is not deckline's: choose another folder"
            )
        scene = read_scene(self.out / SCENE_FILE)
        self._check_same(scene.extra)
        entries = scene.frames or {}
        rows = []
        for line in read_text(self.out / RECORD_FILE).splitlines(keepends=True)[1:]:
            cells = line.rstrip("\n").split("\t")
            if not line.endswith("\n") or len(cells) != len(HEADER):
                break
            names = tuple(cells[-1].split(";"))
            if names[0] not in entries or not all((self.out / IMAGE_FOLDER / name).is_file() for name in names):
                break
            rows.append(line)
            name = choose_images(names)[0]
            self._frames[name] = format_entry(entries[name])
            self._last_ns = int(Path(name).stem.rpartition("_")[2])
        if scene.camera is not None:
            self._camera = camera_to_mapping(scene.camera.camera, scene.camera.body_from_camera)
        return rows

    def _check_same(self, before: dict[str, Any]) -> None:
        now = json.loads(json.dumps(self._extra))
        for key in sorted({*before, *now} - set(MAY_CHANGE)):
            if before.get(key) != now.get(key):
                raise RecordingError(
                    f"{self.out} holds a recording made with {key} = {before.get(key)!r}, not {now.get(key)!r}: "
                    f"choose another folder, or the same settings to go on with it"
                )

    def _make_entry(self, encoded: EncodedFrame, name: str) -> dict[str, Any]:
        if self._camera is None:
            self._camera = encoded.camera
        entry: dict[str, Any] = {"time_s": encoded.time_s}
        if encoded.camera != self._camera:
            entry["camera"] = encoded.camera
        entry |= encoded.entry
        if encoded.clear is not None:
            entry["truth"] = {**entry["truth"], "clear_image": f"{CLEAR_FOLDER}/{name}"}
        return entry

    def _write_scene(self) -> None:
        write_atomic(self.out / SCENE_FILE, format_scene(self._camera, self._frames, self._extra).encode())
