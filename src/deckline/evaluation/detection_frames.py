"""Where the frames of `deckline eval detection` come from: recordings, labelled folders, the simulator."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deckline.evaluation.detection_measure import Expected, expected_from_labels, expected_from_truth
from deckline.labels import LABELS_FILE, read_labels
from deckline.recording import open_recording
from deckline.recording.airsim import RECORD_FILE
from deckline.recording.scene import SCENE_FILE, read_scene
from deckline.recording.source import FrameError, RecordingError
from deckline.types import Frame

UNKNOWN = "unknown"
LABELLED = "labelled"
NAMED = 6  # sets whose names are all printed


@dataclass(frozen=True, eq=False)
class Question:
    """A frame, what should be found in it, and which ship or view it shows."""

    frame: Frame
    expected: Expected
    ship: str


class FrameSet(ABC):
    """Frames that any can be asked for again.

    Attributes:
        name: what tables and files call it.
        settings: plain values; a stopped evaluation goes on only with the same.
    """

    name: str
    settings: dict[str, Any]

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def load(self, index: int) -> Question | None:
        """Frame `index`; None where nobody said what is in it.

        Raises:
            FrameError: this frame cannot be used.
        """

    def close(self) -> None:  # noqa: B027 (files need no closing)
        """Let go of what it holds."""


class Recorded(FrameSet):
    """A recording with truth, or images with labels.json.

    Raises:
        ValueError: it cannot be opened, or has neither truth nor labels.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._source = open_recording(path)
        labelled = not (path / RECORD_FILE).exists() and (path / LABELS_FILE).exists()
        self._labels = read_labels(path / LABELS_FILE) if labelled else None
        scene = path / SCENE_FILE
        if self._labels is None and not scene.exists():
            raise ValueError(f"{path}: neither truth ({SCENE_FILE}) nor {LABELS_FILE}: nothing to compare with")
        self._ship = LABELLED if labelled else str(read_scene(scene).extra.get("preset", UNKNOWN))
        if self._ship == "train":
            self._ship = "random ships"
        self.settings = {"source": str(path.resolve()), "frames": len(self._source)}

    def __len__(self) -> int:
        return len(self._source)

    def load(self, index: int) -> Question | None:
        frame = self._source.load(index)
        if self._labels is None:
            try:
                return Question(frame, expected_from_truth(frame), self._ship)
            except ValueError as error:
                raise FrameError(frame.file, str(error)) from None
        if frame.file not in self._labels:
            return None
        return Question(frame, expected_from_labels(self._labels[frame.file], frame.image_rgb), self._ship)


class Rendered(FrameSet):
    """Fresh frames of the simulator.

    Args:
        config: a `deckline.sim.SimConfig` of random views, or of views without a runway.
    """

    def __init__(self, config: Any) -> None:
        from deckline.sim.record import what_decides_a_frame

        self._config, self._deckless = config, config.trajectory == "deckless"
        self._simulator: Any = None
        self.name = "no runway" if self._deckless else f"rendered {config.preset}"
        self.settings = what_decides_a_frame(config)

    def __len__(self) -> int:
        return int(self._config.frames)

    def load(self, index: int) -> Question:
        frame = self._open().frame(index)
        ship = "random ships" if self._config.preset == "train" else self._config.preset
        if self._deckless:
            ship = f"no runway: {frame.truth.conditions['deckless']}"
        return Question(frame, expected_from_truth(frame), ship)

    def close(self) -> None:
        if self._simulator is not None:
            self._simulator.__exit__(None, None, None)
            self._simulator = None

    def _open(self) -> Any:
        if self._simulator is None:
            from deckline.sim import open_simulator

            self._simulator = open_simulator(self._config)
        return self._simulator


def open_recorded(paths: tuple[Path, ...]) -> list[FrameSet]:
    """Every source, a dataset's folder standing for the recordings in it.

    Raises:
        ValueError: a source that cannot be evaluated.
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
        raise RecordingError(f"a source is given twice: {', '.join(names)}")
    return sets


def named(sets: Sequence[FrameSet]) -> str:
    """The sets' names; of many the first and the last."""
    names = [item.name for item in sets]
    return ", ".join(names) if len(names) <= NAMED else f"{len(names)} sources, {names[0]} to {names[-1]}"
