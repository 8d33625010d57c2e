"""`deckline dataset`: clear and hazy pairs with depth, split and cut into tiles as the paper did.

OUT/manifest.json                         settings, versions, counts, SHA-256 of every file; written last
OUT/{train,test}/                         each an AirSim-layout recording: images/ (hazy, depth), clear/, scene.json
OUT/{train,test}/tiles/{hazy,clear}/<frame>_<tile>.png
OUT/{train,test}/tiles/depth/<frame>_<tile>.npy    half precision, metres along the optical axis, NaN: nothing seen
"""

import json
import platform
from collections.abc import Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from io import BytesIO
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from deckline import __version__
from deckline.atomic import write_atomic
from deckline.checks import check_numbers
from deckline.config_file import settings_to_json
from deckline.recording import RecordingWriter
from deckline.recording.images import encode_image
from deckline.recording.writer import EncodedFrame, encode_frame
from deckline.runtime import sha256_of
from deckline.types import Frame
from deckline_lab.datasets.tiles import tile_corners
from deckline_sim.config import DepthConfig, SimConfig, Trajectory, WeatherConfig
from deckline_sim.processes import Jobs, map_ordered
from deckline_sim.record import Item, map_frames, show_progress
from deckline_sim.scene.gl import open_context
from deckline_sim.visibility import parse_visibility

MANIFEST = "manifest.json"
# A pair as its files hold it; a tile: folder and suffix with {} for the frame's number, and the file.
EncodedPair = tuple[EncodedFrame, list[tuple[str, bytes]]]
FORMAT, VERSION = "deckline-dataset", 1
NAMED = 3  # damaged files that an error names
MEND = "remove it and give the command that made it again"
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "moderngl")
SPLITS = ("train", "test")
FLIGHT_FRAMES = 25  # of one flight; each has its own weather and visibility
LANDING_ENDS_M = (12.0, 16.0)  # distance to the ramp; drawn, so that no two landings have frames at the same distances
FLIGHT_GAP_S = 3600.0  # between the starts of two flights, so that a recording's time never runs back
RANDOM_SHARE = 0.5  # of mixed frames: unrelated views around the glide path; the others are from flights
FLOWN: dict[str, tuple[Trajectory, ...]] = {"mixed": ("approach", "profile"), "landing": ("landing",)}
SEEDS = 100  # simulator seeds that one dataset may use: seed * SEEDS and following


@dataclass(frozen=True)
class DatasetConfig:
    """The paper's dataset. A value out of its range is a ValueError that names the setting and the value."""

    frames: int = 600  # clear and hazy pairs, training and test together
    test: int = 179  # how many of them are for testing, drawn by frame
    seed: int = 0  # the same seed makes the same files
    visibility: str = "300..3000"  # metres at 2 % contrast, one value or LOW..HIGH: of a random view, of a whole flight
    width: int = 1280  # of the images, px
    height: int = 720  # of the images, px
    fov_deg: float = 90.0  # horizontal field of view
    depth_range_m: float = inf  # reach of the depth camera; inf records depth everywhere, as training a dehazer needs
    # mixed: half random views, half flights; landing: the paper's flight from its holding track, again and again
    views: Literal["mixed", "landing"] = "mixed"
    one_scene: bool = False  # the same light, sky and sea everywhere; else drawn anew for each flight and random view
    tiles: bool = True  # also cut every image into 8 overlapping squares
    tile_px: int = 512  # their side

    def __post_init__(self) -> None:
        if not 0 < self.test < self.frames:
            raise ValueError(f"test must lie between 1 and frames - 1 = {self.frames - 1}, got {self.test}")
        check_numbers(self, "", "seed", least=0)
        if self.views not in FLOWN:
            raise ValueError(f"views must be one of {', '.join(FLOWN)}, got {self.views!r}")
        if parse_visibility(self.visibility)[1] == inf:
            raise ValueError(f"visibility must be finite, as a pair needs haze, got {self.visibility!r}")
        if self.tiles and not 1 <= self.tile_px <= min(self.width, self.height):
            raise ValueError(f"tile_px must lie between 1 and the image's smaller side, got {self.tile_px}")


def write_dataset(config: DatasetConfig, out: Path, jobs: Jobs = 1) -> None:
    """Render the dataset into `out`, going on where an earlier call stopped.

    Args:
        jobs: who renders; the files are the same whoever does. Without a cluster they also read the finished files.

    Raises:
        ValueError: `out` holds a dataset made with other settings.
        OSError: the disk refuses, or rendering stopped.
    """
    members = split_frames(config)
    with ExitStack() as opened:
        writers = {
            split: opened.enter_context(RecordingWriter(out / split, scene={**_origin(config), "split": split}))
            for split in SPLITS
        }
        left = sorted(k for split in SPLITS for k in members[split][writers[split].count :])
        if left:
            (out / MANIFEST).unlink(missing_ok=True)
            _render(config, writers, left, jobs)
    if not (out / MANIFEST).exists():
        write_manifest(out, {**_origin(config), "frames": members}, jobs if isinstance(jobs, int) else 1)
    print(out / MANIFEST)


def _render(config: DatasetConfig, writers: dict[str, RecordingWriter], left: list[int], jobs: Jobs) -> None:
    items, test = dataset_items(config), set(split_frames(config)["test"])
    samples = map_frames(partial(encode_pair, config=config), [items[k] for k in left], jobs, config.frames)
    with closing(samples):
        for k, (encoded, tiles) in zip(left, samples, strict=True):
            writer = writers["test" if k in test else "train"]
            for name, data in tiles:  # first: a frame with a row in its recording is whole
                path = writer.out / "tiles" / name.format(f"{k:05d}")
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, data)
            flight = items[k][0].seed - SEEDS * config.seed
            writer.append(replace(encoded, time_s=encoded.time_s + flight * FLIGHT_GAP_S))


def dataset_items(config: DatasetConfig) -> list[Item]:
    """The dataset's frames in order: random views first, where there are any, then flights."""
    base = SimConfig(
        preset="paper",
        trajectory="random",
        frames=round(RANDOM_SHARE * config.frames),
        visibility_m=parse_visibility(config.visibility),
        seed=SEEDS * config.seed,
        width=config.width,
        height=config.height,
        fov_deg=config.fov_deg,
        depth=DepthConfig(range_m=config.depth_range_m),
        weather=WeatherConfig(seed=config.seed if config.one_scene else None),
    )
    recordings = [base] if config.views == "mixed" else []
    left = config.frames - sum(recording.frames for recording in recordings)
    length = max(FLIGHT_FRAMES, -(-left // (SEEDS - 1)))
    ends_m = np.random.default_rng([config.seed, 6]).uniform(*LANDING_ENDS_M, SEEDS)
    for k in range(1, SEEDS):
        if left > 0:
            kind, end_m = FLOWN[config.views][(k - 1) % len(FLOWN[config.views])], base.end_m
            if kind == "landing":
                end_m = float(ends_m[k])
            frames = min(length, left)
            recordings.append(replace(base, trajectory=kind, frames=frames, seed=base.seed + k, end_m=end_m))
            left -= frames
    return [(recording, index) for recording in recordings for index in range(recording.frames)]


def split_frames(config: DatasetConfig) -> dict[str, list[int]]:
    """Numbers of the frames in each split, rising."""
    order = np.random.default_rng([config.seed, 5]).permutation(config.frames).tolist()
    return {"train": sorted(order[config.test :]), "test": sorted(order[: config.test])}


def encode_pair(frame: Frame, config: DatasetConfig) -> EncodedPair:
    """Encode a frame and its tiles.

    Raises:
        ValueError: a frame without its clear view or depth.
    """
    clear = None if frame.truth is None else frame.truth.clear_rgb
    if clear is None or frame.depth_m is None:
        raise ValueError(f"{frame.file}: a pair needs the view without haze and its depth")
    tiles: list[tuple[str, bytes]] = []
    if config.tiles:
        corners = tile_corners(config.width, config.height, config.tile_px)
        for k, (left, top) in enumerate(corners):
            part = np.s_[top : top + config.tile_px, left : left + config.tile_px]
            tiles.append((f"hazy/{{}}_{k}.png", encode_image(frame.image_rgb[part], "png")))
            tiles.append((f"clear/{{}}_{k}.png", encode_image(clear[part], "png")))
            tiles.append((f"depth/{{}}_{k}.npy", _encode_half(frame.depth_m[part])))
    return encode_frame(frame), tiles


def _encode_half(depth_m: NDArray[np.float32]) -> bytes:
    file = BytesIO()
    with np.errstate(over="ignore"):  # beyond 65504 m nothing is seen
        half = depth_m.astype(np.float16)
    half[np.isinf(half)] = np.nan
    np.save(file, half)
    return file.getvalue()


def _origin(config: DatasetConfig) -> dict[str, Any]:
    values = {item.name: getattr(config, item.name) for item in fields(config)}
    words = ["deckline", "dataset", "OUT"]
    for name, value in values.items():
        option = name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        else:
            words += [f"--{option}", str(value)]
    return {"generator": f"deckline {__version__}", "command": " ".join(words), "dataset": settings_to_json(values)}


def write_manifest(out: Path, values: Mapping[str, Any], jobs: int = 1) -> None:
    """Write manifest.json of a complete dataset: the given values, versions, counts and hashes; no dates, no paths.

    Args:
        jobs: processes that read files; 0: one for every core.
    """
    files = file_hashes(out, jobs)
    content = {"format": FORMAT, "version": VERSION, **values, "versions": versions()}
    content |= {"counts": count_files(files), "files": files}
    write_atomic(out / MANIFEST, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def file_hashes(out: Path, jobs: int = 1) -> dict[str, str]:
    """SHA-256 of every file below `out` but the manifest, by relative path in order."""
    names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    names = [name for name in names if name != MANIFEST]
    digests = map_ordered(sha256_of, [out / name for name in names], jobs)
    return dict(zip(names, show_progress("hashing", digests, len(names)), strict=True))


def count_files(files: Mapping[str, str]) -> dict[str, dict[str, int]]:
    """Frames and tiles of each split."""
    of = {"frames": "clear/", "tiles": "tiles/hazy/"}
    return {
        split: {what: sum(name.startswith(f"{split}/{folder}") for name in files) for what, folder in of.items()}
        for split in sorted(SPLITS)
    }


def versions() -> dict[str, str]:
    """What the bytes of a rendered file depend on besides the settings."""
    context = open_context()
    renderer = str(context.info["GL_RENDERER"])
    context.release()
    return {"python": platform.python_version(), "opengl": renderer} | {name: version(name) for name in PACKAGES}


def check_dataset(out: Path, jobs: int = 1) -> int:
    """Compare every file with the manifest; returns their number.

    Raises:
        ValueError: no manifest or a damaged one, or files that are missing, changed or not in it; names the first few.
    """
    try:
        manifest = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{out} holds no {MANIFEST}: give the command that made it again to finish it") from None
    except ValueError as error:  # neither JSON nor text
        raise ValueError(f"{out / MANIFEST} is damaged: {error}; {MEND}") from None
    if not isinstance(manifest, dict) or (manifest.get("format"), manifest.get("version")) != (FORMAT, VERSION):
        raise ValueError(f"{out / MANIFEST}: not a {FORMAT} manifest of version {VERSION}")
    if not isinstance(manifest.get("files"), dict):
        raise ValueError(f"{out / MANIFEST} is damaged: it lists no files; {MEND}")
    expected, found = manifest["files"], file_hashes(out, jobs)
    wrong = [f"{name} is missing" for name in expected if name not in found]
    wrong += [f"{name} has changed" for name, digest in found.items() if expected.get(name, digest) != digest]
    wrong += [f"{name} is not in the manifest" for name in found if name not in expected]
    if wrong:
        more = f" and {len(wrong) - NAMED} more" if len(wrong) > NAMED else ""
        raise ValueError(f"{out}: {', '.join(wrong[:NAMED])}{more}; make the dataset again in another folder")
    return len(expected)
