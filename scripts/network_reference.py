"""Write the reference of docs/how/network.md: a crop of the shipped approach, what the network makes of it, the points.

python scripts/network_reference.py
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from deckline.atomic import write_atomic
from deckline.cli.run import unpack_sample
from deckline.detect import OnnxDetector
from deckline.detect.anchors import decode, decode_region
from deckline.detect.crop import crop_around, normalise, sample_crop
from deckline.flight import Flight

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
FRAME = 60  # of the shipped approach
SHOWN = 6  # numbers of every array


def main() -> None:
    crop_rgb, detector = view_runway()
    write_atomic(FIGURES / "network_reference.png", cv2.imencode(".png", crop_rgb[..., ::-1])[1].tobytes())
    text = json.dumps(describe(crop_rgb, detector), indent=1)
    write_atomic(FIGURES / "network_reference.json", (text + "\n").encode())


def view_runway() -> tuple[NDArray[np.uint8], OnnxDetector]:
    """What the close view of a frame shows, (288, 512, 3) whole grey levels, and the shipped detector."""
    with TemporaryDirectory() as folder:
        source = unpack_sample(Path(folder) / "approach")
        flight = Flight.from_config(source.base_config)
        frame = list(source)[FRAME]
    detector = flight.detector
    if not isinstance(detector, OnnxDetector):
        raise SystemExit("the shipped detector is no network")
    found = detector(frame.image_rgb)
    points, config = np.vstack([found.left.points_px, found.right.points_px]), detector.config
    box = (*points.min(axis=0), *points.max(axis=0))
    size = frame.camera.width, frame.camera.height
    crop = crop_around(box, size, config.grid.size, config.fill, config.min_width_px)
    return np.rint(sample_crop(frame.image_rgb, crop, config.grid.size)).astype(np.uint8), detector


def describe(crop_rgb: NDArray[np.uint8], detector: OnnxDetector) -> dict[str, Any]:
    """Some input values and logits, and all points of the row anchors, in crop px."""
    config = detector.config
    view = normalise(crop_rgb.astype(np.float32))
    output = detector.infer(view)
    record: dict[str, Any] = {"model": "hybrid.onnx", "crop": "network_reference.png"}
    row = config.grid.rows // 2
    record[f"image[0, :, {row}, 256]"] = view[:, row, 256].tolist()
    record["region_logits[0, -6:]"] = output.region[-SHOWN:].tolist()
    record["runway_probability"] = decode_region(output.region, output.box).probability
    for side, logits, line in zip(
        ("left", "right"), output.rows, decode(output.rows, config.grid, config.decode), strict=False
    ):
        best = logits[row].argsort()[: -SHOWN - 1 : -1]
        record[f"{side}: likeliest cells of row {row}"] = best.tolist()
        record[f"{side}: their logits"] = logits[row, best].tolist()
        is_line = np.isfinite(line.x_px) & (line.confidence >= config.min_confidence)
        columns = np.column_stack([line.x_px, config.grid.row_y, line.confidence, line.sigma_px])
        record[f"{side}: x, y, confidence, sigma"] = columns[is_line].round(4).tolist()
    return record


if __name__ == "__main__":
    main()
