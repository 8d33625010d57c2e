"""The frames that evaluations measure: recordings, labelled folders, the simulator; and the loop over them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from deckline.checks import check_numbers
from deckline.config import RunConfig
from deckline.files import print_line
from deckline.recording import FrameError, open_recording
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.scene_file import SCENE_FILE, read_scene
from deckline.types import Frame
from deckline_lab.evaluation.detection_truth import ExpectedLines, expected_from_labels, expected_from_truth
from deckline_lab.evaluation.store import Store
from deckline_lab.labels import LABELS_FILE, Labels, read_labels
from deckline_sim.config import SimConfig
from deckline_sim.progress import progress
from deckline_sim.visibility import parse_visibility

FRAMES, DECKLESS = 200, 100  # rendered when no source is given
NAMED = 6  # sets whose names are all printed
SKIPPED_SHOWN = 5
RANDOM_SHIPS = "random ships"


@dataclass(frozen=True, eq=False)
class FrameSample:
    """A frame and what is known of it."""

    frame: Frame
    source: str  # name of its set
    index: int  # in it
    ship: str  # or view, for people
    labels: Labels | None = None  # None: the frame carries truth

    @cached_property
    def expected(self) -> ExpectedLines:
        """What should be found in it; a FrameError with neither labels nor truth, or true lines without a pose."""
        if self.labels is not None:
            return expected_from_labels(self.labels, self.frame.image_rgb)
        try:
            return expected_from_truth(self.frame)
        except ValueError as error:
            raise FrameError(self.frame.file, str(error)) from None


class Task(NamedTuple):
    """One measurement of every frame."""

    out: Path | None  # folder of the rows; None: in memory alone
    file: str  # of the rows in that folder
    settings: Mapping[str, Any]  # what decides the numbers, beside the frames
    score: Callable[[FrameSample], dict[str, Any]]  # makes the row of a frame
    in_order: bool = False  # a set that lacks a row is scored from its first frame on, as a flight must be


class FrameSet(ABC):
    """Frames that can be loaded in any order."""

    name: str  # what tables and files call it
    settings: dict[str, Any]  # plain values; a stopped evaluation resumes only with the same
    base_config: RunConfig | None = None  # what the files state of the runway, as `deckline run` reads it

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def load(self, index: int) -> FrameSample | None:
        """Frame `index`; None where nobody labelled it.

        Raises:
            FrameError: this frame cannot be used.
        """

    def close(self) -> None:  # noqa: B027 (files need no closing)
        """Let go of what it holds."""


class Recorded(FrameSet):
    """A recording with truth, or images with labels.json; `deck_z_m` overrides the files' deck plane.

    Raises:
        ValueError: it cannot be opened, or has neither truth nor labels.
    """

    def __init__(self, path: Path, deck_z_m: float | None = None) -> None:
        self.name = str(path)
        self._recording = open_recording(path, deck_z_m=deck_z_m)
        self.base_config = self._recording.base_config
        labelled = not (path / RECORD_FILE).exists() and (path / LABELS_FILE).exists()
        self._labels = read_labels(path / LABELS_FILE) if labelled else None
        scene = path / SCENE_FILE
        if self._labels is None and not scene.exists():
            raise ValueError(f"{path}: neither truth ({SCENE_FILE}) nor {LABELS_FILE}: nothing to compare with")
        preset = "labelled" if labelled else str(read_scene(scene).extra.get("preset", "unknown"))
        self._ship = RANDOM_SHIPS if preset == "train" else preset
        self.settings = {"source": str(path.resolve()), "frames": len(self), "deck_z_m": deck_z_m}

    def __len__(self) -> int:
        return len(self._recording)

    def load(self, index: int) -> FrameSample | None:
        frame = self._recording.load(index)
        if self._labels is None:
            return FrameSample(frame, self.name, index, self._ship)
        if frame.file not in self._labels:
            return None
        return FrameSample(frame, self.name, index, self._ship, self._labels[frame.file])


class Rendered(FrameSet):
    """Fresh frames of the simulator: random views, or views without a runway."""

    def __init__(self, config: SimConfig) -> None:
        from deckline_sim.record import frame_settings  # needs OpenGL

        self._config, self._deckless = config, config.trajectory == "deckless"
        self._simulator: Any = None
        self.name = "no runway" if self._deckless else f"rendered {config.preset}"
        self.settings = frame_settings(config)

    def __len__(self) -> int:
        return int(self._config.frames)

    def load(self, index: int) -> FrameSample:
        if self._simulator is None:
            from deckline_sim import open_simulator

            self._simulator = open_simulator(self._config)
        frame = self._simulator.frame(index)
        ship = RANDOM_SHIPS if self._config.preset == "train" else self._config.preset
        ship = f"no runway: {frame.truth.conditions['deckless']}" if self._deckless else ship
        return FrameSample(frame, self.name, index, ship)

    def close(self) -> None:
        if self._simulator is not None:
            self._simulator.close()
            self._simulator = None


def open_recorded(paths: Sequence[Path]) -> list[FrameSet]:
    """Every source, a dataset's folder standing for the recordings in it.

    Raises:
        ValueError: a source that cannot be evaluated, or one that is given twice.
    """
    sets: list[FrameSet] = []
    for path in paths:
        inside = []
        with suppress(OSError):
            inside = [child for child in sorted(path.iterdir()) if (child / RECORD_FILE).exists()]
        direct = (path / RECORD_FILE).exists() or (path / LABELS_FILE).exists()
        sets += [Recorded(child) for child in (inside if inside and not direct else [path])]
    names = [item.name for item in sets]
    if len(set(names)) < len(names):
        raise ValueError(f"a source is given twice: {', '.join(names)}")
    return sets


@dataclass(frozen=True)
class RenderOptions:
    """Which frames are rendered.

    Args:
        frames: of each preset, from random viewpoints; 200 when no source is given.
        deckless: without a runway in the image; 100 when no source is given.
        preset: ships: paper, cvn, axial, small, runway, train.
        seed: of the simulator; the shipped weights never saw seeds from 1000 on.
        visibility: metres at 2 % contrast, LOW..HIGH or clear.
        range_m: distance from the ramp; 60 to 800 m, 30 to 1500 m for preset train.
        fov_deg: horizontal field of view; preset train draws its own.
    """

    frames: int | None = None
    deckless: int | None = None
    preset: tuple[str, ...] = ("paper",)
    seed: int = 1000
    visibility: str = "500..3000"
    range_m: tuple[float, float] | None = None
    fov_deg: float = 90.0

    def open_sets(self, sources: Sequence[Path] = (), keep_clear: bool = False) -> list[FrameSet]:
        """Recorded frames, and rendered ones where they are asked for or nothing is recorded.

        Raises:
            ValueError: a source that cannot be evaluated, or a value that the simulator refuses.
            ImportError: the sim extra is not installed.
        """
        check_numbers(self, "", "frames", "deckless", least=0)
        frames = self.frames if self.frames is not None else 0 if sources else FRAMES
        deckless = self.deckless if self.deckless is not None else 0 if sources else DECKLESS
        sets = open_recorded(sources)
        if not frames and not deckless:
            return sets
        shared: dict[str, Any] = {
            "visibility_m": parse_visibility(self.visibility),
            "keep_clear": keep_clear,
            **{name: getattr(self, name) for name in ("seed", "fov_deg", "range_m")},
        }
        if frames:
            random = shared | {"trajectory": "random", "frames": frames}
            sets += [Rendered(SimConfig(**random, preset=preset)) for preset in dict.fromkeys(self.preset)]  # type: ignore[arg-type]
        if deckless:
            views = shared | {"trajectory": "deckless", "frames": deckless, "frames_per_ship": 1}
            sets.append(Rendered(SimConfig(**views, preset="train")))
        return sets


def name_sets(sets: Sequence[FrameSet]) -> str:
    """The sets' names; of many the first and the last."""
    names = [item.name for item in sets]
    return ", ".join(names) if len(names) <= NAMED else f"{len(names)} sources, {names[0]} to {names[-1]}"


def score_frames(sets: Sequence[FrameSet], tasks: Sequence[Task]) -> list[list[dict[str, Any]]]:
    """Score every frame by every task that has no row of it; load each frame once.

    A frame that cannot be used is skipped, counted and named on stderr. Returns the rows of each task.
    """
    frames = [item.settings for item in sets]
    stores = [Store(task.out, task.file, {**task.settings, "frames": frames}) for task in tasks]
    places = [(item, index) for item in sets for index in range(len(item))]
    lacking: list[list[tuple[Store, Callable[[FrameSample], dict[str, Any]]]]] = [[] for _ in places]
    for store, task in zip(stores, tasks, strict=True):
        incomplete = {item.name for item, index in places if (item.name, index) not in store.rows}
        for missing, (item, index) in zip(lacking, places, strict=True):
            if item.name in incomplete and (task.in_order or (item.name, index) not in store.rows):
                missing.append((store, task.score))
    with ExitStack() as stack:
        for store in stores:
            stack.enter_context(store)
        advance = stack.enter_context(progress("evaluating", len(places), sum(not missing for missing in lacking)))
        for item in sets:
            stack.callback(item.close)
        for (item, index), missing in zip(places, lacking, strict=True):
            if missing:
                _score_frame(item, index, missing)
                advance()
            if index + 1 == len(item):
                item.close()
    rows = [[store.rows[item.name, index] for item, index in places] for store in stores]
    _report_skipped([row["skipped"] for row in rows[0] if row.get("skipped")])
    return [[row for row in each if "skipped" not in row] for each in rows]


def _score_frame(
    item: FrameSet, index: int, pairs: Sequence[tuple[Store, Callable[[FrameSample], dict[str, Any]]]]
) -> None:
    reason = ""  # of a frame without labels, which is left out silently
    sample = None
    try:
        sample = item.load(index)
        rows = [] if sample is None else [score(sample) for _, score in pairs]
    except FrameError as error:
        sample, reason = None, str(error)
    for k, (store, _) in enumerate(pairs):
        store.add((item.name, index), {"skipped": reason} if sample is None else rows[k])


def _report_skipped(reasons: Sequence[str]) -> None:
    for reason in reasons[:SKIPPED_SHOWN]:
        print_line(f"skipped {reason}")
    if len(reasons) > SKIPPED_SHOWN:
        print_line(f"skipped {len(reasons)} frames in all")
