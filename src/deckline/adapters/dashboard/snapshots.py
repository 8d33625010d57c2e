"""What the dashboard remembers: what to show of each snapshot, and two small pictures; the oldest are dropped."""

import json
import threading
from collections import deque
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import cv2
import numpy as np

from deckline.config import Models
from deckline.dehaze import Dehazer, dehaze_for_display, downscale_frame
from deckline.flight import FrameResult
from deckline.recording.images import encode_image
from deckline.report.advice import advise
from deckline.report.annotators import Window, crop_around, find_window, match_contrast, project_centre_line, resize
from deckline.report.draw import Image
from deckline.report.instrument import METRES, WIDTHS
from deckline.report.records import Record, lookup
from deckline.types import SIDES, Frame

WHOLE_PX = 960  # longer side of a snapshot's picture
DECK_PX = (480, 270)  # width, height of the magnified deck
ANY_SCALE = 1e-6  # a deck is magnified however large it is in the picture
QUALITY = 90  # of the JPEGs
MEMORY = 192 << 20  # bytes: 1,500 snapshots of 720p and more, two minutes at 10 a second
PLOTTED = {  # value and protection level by the unit of lengths; the glideslope's aim point has no place in widths
    METRES: (("lateral_deviation_m", "lateral_m"), ("vertical_deviation_m", "vertical_m")),
    WIDTHS: (("lateral_deviation_widths", ""), ("height_above_deck_widths", "")),
}


@dataclass(frozen=True, eq=False)
class SnapshotPictures:
    """A snapshot's frame, small."""

    frame: Frame
    """The frame without its image: every pixel is black."""
    whole: bytes
    """JPEG of the image."""
    deck: bytes | None
    """JPEG of the magnified deck; None: there is none to magnify."""
    window: Window | None
    """Part of the camera's image that `deck` shows, px."""
    width_px: int
    """Width of the camera's image, px."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """An answer, or that there was none."""

    number: int
    """One higher than that of the snapshot before."""
    shown: str
    """JSON: what the browser shows."""
    row: list[Any]
    """For the plots: number, time, value and protection level of each of `PLOTTED`, status, unit of lengths."""
    pictures: SnapshotPictures | None
    """Pictures of the frame; None: no new picture."""

    @property
    def size(self) -> int:
        """Bytes, about."""
        pictures = self.pictures
        return 2000 + len(self.shown) + (0 if pictures is None else len(pictures.whole) + len(pictures.deck or b""))


class Memory:
    """The last snapshots; for any thread.

    Args:
        limit: bytes, about; the newest snapshot always stays.
    """

    def __init__(self, limit: int = MEMORY) -> None:
        self._limit = limit
        self._snapshots: deque[Snapshot] = deque()
        self._size = 0
        self._lock = threading.Lock()

    def add(self, snapshot: Snapshot) -> None:
        """Append the next snapshot, numbered one higher than the last one."""
        with self._lock:
            self._snapshots.append(snapshot)
            self._size += snapshot.size
            while self._size > self._limit and len(self._snapshots) > 1:
                self._size -= self._snapshots.popleft().size

    def get(self, number: int) -> Snapshot | None:
        """The snapshot of this number; None: forgotten, or not there yet."""
        with self._lock:
            index = number - self._snapshots[0].number if self._snapshots else -1
            return self._snapshots[index] if 0 <= index < len(self._snapshots) else None

    def after(self, number: int) -> list[Snapshot]:
        """The snapshots that came after this number, oldest first."""
        with self._lock:
            first = self._snapshots[0].number if self._snapshots else 0
            return list(islice(self._snapshots, max(number + 1 - first, 0), None))

    @property
    def oldest(self) -> int:
        """Its number; -1: nothing is remembered."""
        with self._lock:
            return self._snapshots[0].number if self._snapshots else -1


def make_snapshot(number: int, result: FrameResult | None, record: Record, pictured: int | None) -> Snapshot:
    """What the dashboard remembers of a result and its record.

    Args:
        number: one higher than the last snapshot's.
        result: of the frame; None: an answer without a frame.
        record: of guidance.jsonl, or a live message.
        pictured: number of the last snapshot with a picture.
    """
    live: Record = record.get("live") or {}
    time_s = live["sent_s"] if live else record["time_s"]  # live values are predicted to the time of sending
    values = live.get("now") or record["guidance"]
    levels = (live.get("now_protection") if live.get("now") else record["protection"]) or {}
    pictures = None if result is None else take_pictures(result)
    shown: Record = {name: record[name] for name in ("file", "status", "seen", "reason")}
    shown |= {"number": number, "time_s": time_s, "picture": pictured if result is None else number}
    shown |= {"values": values, "levels": levels, "advice": advise(record), "lines": None}
    unit = METRES if lookup(values, ("height_above_deck_widths",)) is None else WIDTHS
    shown |= {"flagged": bool(record["flags"]), "unit": unit, "pose_source": record.get("pose_source")}
    if result is not None and pictures is not None:
        camera = result.frame.camera
        shown |= {"lines": find_marks(result), "size": (camera.width, camera.height), "window": pictures.window}
    plotted = [(lookup(values, (value, "value")), levels.get(level)) for value, level in PLOTTED[unit]]
    row = [number, time_s, *(size for pair in plotted for size in pair), record["status"], unit]
    return Snapshot(number, json.dumps(shown, separators=(",", ":"), allow_nan=False), row, pictures)


def take_pictures(result: FrameResult) -> SnapshotPictures:
    """The frame's picture and its magnified deck as JPEG."""
    frame = result.frame
    small = downscale_frame(replace(frame, depth_m=None, truth=None), WHOLE_PX)
    window, deck = find_window(result, ANY_SCALE, DECK_PX), None
    if window is not None:
        u0, v0, u1, v1 = window
        deck = _to_jpeg(resize(frame.image_rgb[v0:v1, u0:u1], DECK_PX))
    black = np.broadcast_to(np.uint8(0), small.image_rgb.shape)  # takes no memory
    whole = _to_jpeg(small.image_rgb)
    return SnapshotPictures(replace(small, image_rgb=black), whole, deck, window, frame.camera.width)


def dehaze(pictures: SnapshotPictures, dehazer: Dehazer, models: Models) -> tuple[bytes, bytes | None, str]:
    """Both pictures dehazed, JPEG, and why they are as the camera saw them; empty: they are not."""
    hazy = _from_jpeg(pictures.whole)
    dehazed = dehaze_for_display(replace(pictures.frame, image_rgb=hazy), dehazer, models, WHOLE_PX)
    if dehazed.note:
        return pictures.whole, pictures.deck, dehazed.note
    clear, deck = dehazed.image_rgb, pictures.deck
    if deck is not None and pictures.window is not None:
        around = [crop_around(image, pictures.window, pictures.width_px) for image in (hazy, clear)]
        deck = _to_jpeg(match_contrast(_from_jpeg(deck), *around))
    return _to_jpeg(clear), deck, ""


def find_marks(result: FrameResult) -> Record:
    """Ends of the lines and detected points in the picture, px: lists of u, v."""
    lines = {side: line.ends_px for side, line in result.estimate.pixel_lines.items()}
    centre = project_centre_line(result.frame, result.estimate)
    ends = lines if centre is None else lines | {"centre": centre}
    marks: Record = {name: np.round(px, 1).tolist() for name, px in ends.items() if np.isfinite(px).all()}
    return marks | {"points": {side: np.round(getattr(result.detection, side).points_px, 1).tolist() for side in SIDES}}


def _to_jpeg(image: Image) -> bytes:
    return encode_image(image, "jpg", QUALITY)


def _from_jpeg(data: bytes) -> Image:
    image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
