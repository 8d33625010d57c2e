"""The overlay film: written in pieces that survive a kill, joined into one file that browsers play.

A piece is a fragmented MP4: what was flushed can be read even if the program never closed it. Joining copies the coded
pictures of all pieces (one per start of the program) into an MP4 whose index comes first.
"""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

TIME_BASE = Fraction(1, 90_000)  # the usual clock of video, s
CODEC = "libx264"
ENCODER = {"preset": "veryfast", "crf": "21", "bf": "0", "rc-lookahead": "0", "sc_threshold": "0"}
KEY_EVERY = 12  # frames: what is lost at most when the program is killed
FRAGMENTS = {"movflags": "frag_keyframe+empty_moov+default_base_moof", "flush_packets": "1"}
FASTSTART = {"movflags": "+faststart"}
MIN_STEP_S, MAX_STEP_S = 1 / 120, 0.5  # a picture is shown in real time, but neither shorter nor longer than this
FIRST_STEP_S = 0.1  # how long the last picture is shown


class VideoPiece:
    """Writes RGB pictures (H, W, 3) uint8, all of one even size, with their times, until `close`."""

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        """Args: path: file to write, anew; size: width and height, px."""
        self._container = av.open(str(path), "w", format="mp4", options=FRAGMENTS)
        stream: Any = self._container.add_stream(CODEC, rate=30, options=ENCODER)
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.gop_size = KEY_EVERY
        stream.time_base = stream.codec_context.time_base = TIME_BASE
        self._stream = stream
        self._pts = 0
        self._last_s: float | None = None

    def add(self, image_rgb: NDArray[np.uint8], time_s: float) -> None:
        """Append one picture; long pauses before it are cut to half a second."""
        if self._last_s is not None:
            step_s = float(np.clip(time_s - self._last_s, MIN_STEP_S, MAX_STEP_S))
            self._pts += round(step_s / TIME_BASE)
        self._last_s = time_s
        picture = av.VideoFrame.from_ndarray(image_rgb, format="rgb24")
        picture.pts, picture.time_base = self._pts, TIME_BASE
        self._container.mux(self._stream.encode(picture))

    def close(self) -> None:
        """Write what the encoder still holds. A second call does nothing."""
        if self._stream is not None:
            self._container.mux(self._stream.encode(None))
            self._container.close()
            self._stream = None


def count_pictures(piece: Path) -> int:
    """Number of whole pictures in a piece, also in one whose writer was killed."""
    return sum(1 for _ in _packets(piece))


def join(pieces: list[Path], path: Path) -> int:
    """Copy the pictures of all pieces into one MP4 at `path`; returns their number.

    No file is written when there is none.
    """
    readable = [piece for piece in pieces if count_pictures(piece)]
    if not readable:
        return 0
    count = 0
    with av.open(str(readable[0])) as first, av.open(str(path), "w", format="mp4", options=FASTSTART) as output:
        stream: Any = output.add_stream_from_template(first.streams.video[0])
        offset, step = 0, round(FIRST_STEP_S / TIME_BASE)
        for piece in readable:
            last = 0
            for packet in _packets(piece):
                last = round(packet.pts * packet.time_base / TIME_BASE)
                packet.time_base = TIME_BASE
                packet.pts = packet.dts = offset + last
                packet.stream = stream
                output.mux(packet)
                count += 1
            offset += last + step
    return count


def _packets(piece: Path) -> Iterator[Any]:
    """Coded pictures up to where the file ends or breaks off."""
    try:
        with av.open(str(piece)) as container:
            for packet in container.demux(container.streams.video[0]):
                if packet.size and packet.pts is not None:
                    yield packet
    except (av.error.FFmpegError, IndexError):
        return  # a piece that was cut short ends here
