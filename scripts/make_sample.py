"""Render the sample approach that ships with the package: src/deckline/sample/approach.zip.

    python scripts/make_sample.py

10 pictures a second of an approach to the paper's deck through haze, as JPEG, with poses, truth, the runway's width,
and depth for the last frames. Depth is rounded to 1/32 m, as ranging cameras do, and left out beyond the depth
camera's reach: that keeps the archive small.
"""

import argparse
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from deckline.recording import RecordingWriter
from deckline.truth import range_to_ramp_m
from deckline.types import Frame
from deckline_sim import SimConfig, frames
from deckline_sim.config import DepthConfig

CONFIG = SimConfig(
    preset="paper",
    trajectory="approach",
    frames=91,
    visibility_m=(700.0, 700.0),
    seed=17,
    depth=DepthConfig(range_m=45.0),
    keep_clear=False,
    start_m=610.0,
    end_m=25.0,
)
DEPTH_STEP_M = 1 / 32
RUNWAY = "[deck]\nwidth_m = 14.85  # between the middles of both edge lines at the ramp\n"
TARGET = Path(__file__).parent.parent / "src" / "deckline" / "sample" / "approach.zip"


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "approach"
        scene = {"command": "python scripts/make_sample.py", "seed": CONFIG.seed}
        with RecordingWriter(recording, image_format="jpg", scene=scene) as out:
            for frame in frames(CONFIG):
                out.add(_slim(frame))
        (recording / "runway.toml").write_text(RUNWAY, encoding="utf-8")
        _zip(recording, TARGET)
    print(f"{TARGET.name}: {TARGET.stat().st_size / 1e6:.1f} MB")


def _slim(frame: Frame) -> Frame:
    if frame.depth_m is None or range_to_ramp_m(frame) > CONFIG.depth.range_m:
        return replace(frame, depth_m=None)
    return replace(frame, depth_m=(np.rint(frame.depth_m / DEPTH_STEP_M) * DEPTH_STEP_M).astype(np.float32))


def _zip(folder: Path, target: Path) -> None:
    target.parent.mkdir(exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                name = zipfile.ZipInfo(path.relative_to(folder).as_posix(), (2026, 1, 1, 0, 0, 0))
                archive.writestr(name, path.read_bytes(), zipfile.ZIP_DEFLATED, 9)


if __name__ == "__main__":
    main()
