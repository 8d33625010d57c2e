"""A track of pictures predicted to later times."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import RunConfig
from deckline.picture_pose.answer import track_of
from deckline.picture_pose.states import Belief, predict
from deckline.types import Track

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PictureForecast:
    """Predicts a track to later times. It never changes, so any thread may use it."""

    belief: Belief  # at the frame
    seen_s: float  # when lines were last used
    has_ramp: bool
    shared_sigma: Array
    track: Track
    config: RunConfig

    def at(self, time_s: float) -> tuple[Track, RigidTransform, float] | None:
        """Track, world_from_body and 1-sigma of its heading beside the track's, rad, at a time.

        None before the frame, and when no line was seen for longer than `tracking.coast_s`.
        """
        if not self.belief.time_s <= time_s <= self.seen_s + self.config.tracking.coast_s:
            return None
        belief = predict(self.belief, time_s, self.shared_sigma, self.config.sensors.drift_s)
        track = track_of(belief, self.track.state, self.has_ramp, self.shared_sigma, self.config)
        same = {name: getattr(self.track, name) for name in ("flags", "diagnostics", "doubts")}
        age_s = self.track.age_s + time_s - self.belief.time_s
        return replace(track, age_s=age_s, **same), belief.world_from_body, 0.0
