"""A small clear recording to train dehazers on, a quick recipe, and a person who presses Ctrl-C."""

import json
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.haze import add_haze, beta_from_visibility
from deckline.recording import RecordingWriter
from deckline.report.draw import write_picture
from deckline.types import Frame, Truth
from deckline_lab.train.dehaze import DehazeTrainConfig

CAMERA = Camera.from_fov(96, 64, 1.2)
QUICK = DehazeTrainConfig(
    steps=12, batch=2, crop_height=48, crop_width=64, held_out=0.25, lr=3e-3, threads=1, device="cpu"
)


def clear_frame(index: int, camera: Camera = CAMERA) -> Frame:
    """Sky over a dark sea that comes nearer downwards, with a bright block on it."""
    rng = np.random.default_rng(index)
    height, width = camera.height, camera.width
    image = rng.normal((40, 60, 75), 6, (height, width, 3))
    image[: height // 4] = (150, 170, 200)
    column = rng.integers(0, width - 20)
    image[height // 2 :, column : column + 20] = rng.uniform(60, 220)
    depth = np.full((height, width), np.nan, dtype=np.float32)
    depth[height // 4 :] = np.geomspace(1500, 60, height - height // 4)[:, None]
    truth = Truth(visibility_m=float("inf"))
    image, pose = image.clip(0, 255).astype(np.uint8), RigidTransform.identity()
    return Frame(f"{index:03d}.png", float(index), image, camera, depth_m=depth, world_from_body=pose, truth=truth)


def hazy_frame(index: int) -> Frame:
    """The same through haze, with its clear picture."""
    frame = clear_frame(index)
    assert frame.depth_m is not None
    ranges = frame.depth_m * frame.camera.ray_lengths()
    hazy = add_haze(frame.image_rgb, ranges, beta_from_visibility(700.0), (150, 170, 200))
    return replace(frame, image_rgb=hazy, truth=Truth(visibility_m=700.0, clear_rgb=frame.image_rgb))


def clear_recording(folder: Path, frames: int, make: Callable[[int], Frame] = clear_frame) -> Path:
    """`folder`, with a recording of so many frames written into it."""
    with RecordingWriter(folder, "ppm", {"preset": "test"}) as writer:
        for index in range(frames):
            writer.add(make(index))
    return folder


hazy_recording = partial(clear_recording, make=hazy_frame)


def pair_folder(folder: Path, pairs: int) -> Path:
    """`folder`, with so many hazy and clear pictures and the labels.json that pairs them."""
    frames = []
    for index in range(pairs):
        for name, frame in (("clear", clear_frame(index)), ("hazy", hazy_frame(index))):
            write_picture(folder / f"{index}_{name}.png", frame.image_rgb)
        frames.append({"file": f"{index}_hazy.png", "pair_of": f"{index}_clear.png"})
    (folder / "labels.json").write_text(json.dumps({"frames": frames}))
    return folder


def striped_deck(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Dark sea and a striped deck, (height, width, 3) uint8 under haze and without it."""
    rng = np.random.default_rng(0)
    clear = rng.normal(60, 15, (height, width, 3)).clip(0, 255).astype(np.uint8)
    clear[height // 2 :, width // 3 : width // 2] = 90
    clear[height // 2 :, width // 3 : width // 3 + 4] = 230
    ranges = np.linspace(2000, 50, height)[:, None] + np.zeros((1, width))
    return add_haze(clear, ranges, beta_from_visibility(800.0), (180, 190, 200)), clear


def interrupting(step: Callable[..., object], at: int) -> Callable[..., object]:
    """`step` during whose call number `at` a person presses Ctrl-C."""
    calls = []

    def wrapped(*args: object) -> object:
        calls.append(1)
        if len(calls) == at:
            signal.raise_signal(signal.SIGINT)
        return step(*args)

    return wrapped
