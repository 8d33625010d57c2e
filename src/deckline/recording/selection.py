"""Some frames of a source: every so many-th, from a time on, for so long."""

import numpy as np
from numpy.typing import NDArray

from deckline.recording.source import Recording, RecordingError, check_index
from deckline.types import Frame


class Selection(Recording):
    """The frames `indices` (N,), ascending, of a source, with the same names and times."""

    def __init__(self, source: Recording, indices: NDArray[np.intp]) -> None:
        self._source = source
        self._indices = indices
        self.name = f"{source.name} ({len(indices)} of {len(source)} frames, {indices[0]} to {indices[-1]})"
        self.notes, self.base_config, self.on_skip = source.notes, source.base_config, source.on_skip
        self.pose_track = source.pose_track

    def __len__(self) -> int:
        return len(self._indices)

    def times(self) -> NDArray[np.float64]:
        return self._source.times()[self._indices]

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        return self._source.load(int(self._indices[index]))


def select_frames(
    source: Recording, every: int = 1, start_s: float = 0.0, duration_s: float | None = None
) -> Recording:
    """Every `every`-th frame, beginning `start_s` after the first one, of `duration_s` seconds.

    A frame without a time is left out where a start or a duration is asked for.

    Raises:
        ValueError: an option out of its range.
        RecordingError: no frame is left.
    """
    if every < 1 or not 0.0 <= start_s < np.inf or (duration_s is not None and not 0.0 < duration_s < np.inf):
        asked = f"{every}, {start_s}, {duration_s}"
        raise ValueError(f"every must be at least 1, start_s at least 0, duration_s greater than 0; got {asked}")
    if every == 1 and start_s == 0 and duration_s is None:
        return source
    indices = np.arange(len(source))
    if start_s > 0 or duration_s is not None:
        since = source.times() - np.nanmin(source.times())
        indices = indices[(since >= start_s) & (since < start_s + (np.inf if duration_s is None else duration_s))]
        if not len(indices):
            raise RecordingError(
                f"{source.name}: no frame is left: it lasts {np.nanmax(since):.3f} s, asked for frames from "
                f"{start_s:g} s on" + ("" if duration_s is None else f" for {duration_s:g} s")
            )
    return Selection(source, indices[::every])
