"""Horizon, roll, visibility and dehazing without a pose against the truth of simulated recordings.

    python benchmarks/horizon.py RECORDING... [--every N]

The recordings need poses, the sea's height and, for the last columns, clear pictures (`deckline sim`). Poses serve as
truth only. Rows are scaled to pictures 720 px high; visibility is compared in heights of the camera above the water.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from deckline.dehaze import HorizonDehazer, VeilDehazer
from deckline.dehaze.by_horizon import find_horizon_of
from deckline.dehaze.horizon import Horizon
from deckline.monitors.attitude import expect_horizon
from deckline.types import Frame
from deckline_lab.evaluation.frames import open_recorded
from deckline_lab.evaluation.metrics import psnr_db

HEIGHT_PX = 720


def true_row(frame: Frame) -> float:
    """Row of the flat sea's horizon in the image's middle column, NaN where it is not in view."""
    camera, pose = frame.camera, frame.world_from_camera
    if pose is None:
        return np.nan
    down = pose.rotation.as_matrix()[2]
    x = ((camera.width - 1) / 2 - camera.cx) / camera.fx
    row = float(camera.project([[x, -(down[2] + down[0] * x) / down[1], 1.0]])[0, 1])
    return row if 0 < row < camera.height - 1 else np.nan


def measure(frame: Frame) -> dict[str, float]:
    """Estimates from one frame without its pose, and their errors; NaN for what has no estimate."""
    alone = replace(frame, world_from_body=None, deck_z_m=None, sea_z_m=None, depth_m=None, truth=None)
    row, scale, truth = true_row(frame), HEIGHT_PX / frame.camera.height, frame.truth
    others = ("error", "sigma", "roll", "roll_sigma", "ratio", "ratio_sigma")
    values = {"row": row} | dict.fromkeys(others, np.nan)
    horizon = find_horizon_of(alone)
    if isinstance(horizon, Horizon):
        values |= {"error": (horizon.middle_px - row) * scale, "sigma": horizon.middle_sigma_px * scale}
        if (expected := expect_horizon(frame)) is not None:
            roll_deg = np.rad2deg(np.arctan(horizon.slope)) - expected.roll_deg
            values |= {"roll": abs(roll_deg), "roll_sigma": np.rad2deg(horizon.slope_sigma)}
    heights = HorizonDehazer().restore(alone).visibility_heights
    height = frame.sea_z_m - frame.world_from_camera.translation[2]
    if heights is not None and np.isfinite(truth.visibility_m):
        values |= {
            "ratio": np.log(heights.value * height / truth.visibility_m),
            "ratio_sigma": heights.sigma / heights.value,
        }
    if truth.clear_rgb is not None:
        for name, dehazer in (("veil", VeilDehazer()), ("horizon", HorizonDehazer())):
            values[name] = psnr_db(dehazer.restore(alone).image_rgb, truth.clear_rgb)
        values["none"] = psnr_db(frame.image_rgb, truth.clear_rgb)
    return values


def print_row(name: str, rows: list[dict[str, float]]) -> None:
    keys = ("row", "error", "sigma", "roll", "roll_sigma", "ratio", "ratio_sigma")
    row, error, sigma, roll, roll_sigma, ratio, ratio_sigma = (np.array([item[key] for item in rows]) for key in keys)
    seen, stated, found = np.isfinite(row), np.isfinite(sigma), np.isfinite(error)
    size, known = np.abs(error[found]), np.isfinite(ratio)
    psnr = " ".join(
        f"{np.mean([item[key] for item in rows]):.1f}" for key in ("none", "veil", "horizon") if key in rows[0]
    )
    print(
        f"| {name} | {found.sum()} of {seen.sum()} | {(stated & ~seen).sum()} of {(~seen).sum()} "
        f"| {np.median(size):.1f} / {np.percentile(size, 90):.1f} | {np.mean(size < 2 * sigma[found]):.0%} "
        f"| {np.nanmedian(roll):.2f} / {np.nanmax(roll):.2f} | {np.nanmax(roll / roll_sigma):.1f} "
        f"| {known.sum()} | {np.exp(np.median(np.abs(ratio[known]))):.2f} "
        f"| {np.mean(np.abs(ratio[known]) < 2 * ratio_sigma[known]):.0%} | {psnr} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every N-th frame")
    options = parser.parse_args()
    print("| recording | found | found where none is in view | error, median / 90 %, px | within 2 sigma ", end="")
    print("| roll, median / most, deg | in its sigma, most ", end="")
    print("| visibility measured | off by a factor, median | within 2 sigma | PSNR of input, veil, horizon, dB |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for frames in open_recorded(options.recordings):
        samples = (frames.load(index) for index in range(0, len(frames), options.every))
        print_row(Path(frames.name).name, [measure(sample.frame) for sample in samples if sample is not None])


if __name__ == "__main__":
    main()
