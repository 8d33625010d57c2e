"""Files written byte by byte from the formats' definitions, so that tests do not lean on deckline's own writer."""

import struct
import zlib
from pathlib import Path

import numpy as np

HEADER = "VehicleName\tTimeStamp\tPOS_X\tPOS_Y\tPOS_Z\tQ_W\tQ_X\tQ_Y\tQ_Z\tImageFile"
# 3 x 2 pixels: red, green, blue over black, white, grey
PIXELS = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255]], [[0, 0, 0], [255, 255, 255], [128, 128, 128]]], np.uint8)
CAMERA = "width = 3\nheight = 2\nfx = 4.0\nfy = 5.0\ncx = 1.0\ncy = 0.5\n"


def png(pixels: np.ndarray, colour_type: int = 2, bits: int = 8) -> bytes:
    """PNG of unfiltered rows; colour type 0 grey, 2 RGB, 4 grey + alpha, 6 RGBA."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    stored = pixels.astype(">u2" if bits == 16 else "u1")
    rows = b"".join(b"\0" + row.tobytes() for row in stored)
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], bits, colour_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def pfm(rows: list[list[float]], order: str = "<") -> bytes:
    """PFM with its rows as given: the first list comes first in the file."""
    head = b"Pf\n%d %d\n%s\n" % (len(rows[0]), len(rows), b"-1" if order == "<" else b"1")
    return head + b"".join(struct.pack(f"{order}{len(row)}f", *row) for row in rows)


def row(ns: int, *, types: str = "0", pose: str = "1\t2\t-3\t1\t0\t0\t0", ms: int | None = None) -> str:
    """One line of airsim_rec.txt with the images of some types ("01" is Scene and DepthPlanar)."""
    suffix = {"0": "png", "1": "pfm", "2": "pfm"}
    images = ";".join(f"img_Drone_0_{kind}_{ns}.{suffix[kind]}" for kind in types)
    return f"Drone\t{ns // 1_000_000 if ms is None else ms}\t{pose}\t{images}"


def recording(folder: Path, rows: list[str], files: dict[str, bytes], header: str = HEADER) -> Path:
    """An AirSim recording of these rows and files of images/."""
    (folder / "images").mkdir(parents=True)
    (folder / "airsim_rec.txt").write_text("\n".join([header, *rows]) + "\n")
    for name, data in files.items():
        (folder / "images" / name).write_bytes(data)
    return folder


def images(folder: Path, names: list[str], camera: str = CAMERA, **tables: str) -> Path:
    """A folder of these images with camera.toml, and poses.csv and times.csv where they are given."""
    for name in names:
        (folder / name).write_bytes(png(PIXELS))
    if camera:
        (folder / "camera.toml").write_text(camera)
    for stem, text in tables.items():
        (folder / f"{stem}.csv").write_text(text)
    return folder
