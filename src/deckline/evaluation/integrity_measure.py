"""Is a fault noticed, harmless, or does it mislead? Outcomes of runs, and how sure their shares are."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import binomtest

CONFIDENCE = 0.95
ALERT_S = 1.0  # a misleading frame this much before the flag still counts as detected; our choice


class Outcome(StrEnum):
    """Of a run with a fault."""

    DETECTED = "detected"  # a flag, or no guidance any more, and nothing misled for longer than the time to alert
    HARMLESS = "harmless"  # no flag was needed: no error was ever beyond its protection level
    MISLEADING = "misleading"


@dataclass(frozen=True)
class Moment:
    """One frame of a run, as the pilot has it."""

    time_s: float
    faulty: bool  # the fault is there by now
    flagged: bool
    lateral_m: float | None  # error of the lateral deviation; None: no centre line was given
    height_m: float | None  # error of the height above the deck, at the touchdown point
    lateral_level_m: float | None  # protection levels; None: none was given
    height_level_m: float | None
    excluded: bool = False  # a measurement contradicted the track and was left out of it
    flags: tuple[str, ...] = ()  # names of what is flagged

    @property
    def protected(self) -> bool:
        """A line with a protection level, and no warning: what a pilot would follow."""
        given = (self.lateral_m, self.height_m, self.lateral_level_m, self.height_level_m)
        return not self.flagged and None not in given

    @property
    def misleading(self) -> bool:
        """Followed, and farther off than its protection level says."""
        if self.flagged or self.lateral_m is None or self.height_m is None:
            return False
        if self.lateral_level_m is None or self.height_level_m is None:
            return False
        return abs(self.lateral_m) > self.lateral_level_m or abs(self.height_m) > self.height_level_m


@dataclass(frozen=True)
class FaultRow:
    """All runs of one fault."""

    runs: int
    detected: int
    harmless: int
    misleading: int
    frames: int  # while the fault was there
    misleading_frames: int
    flagged_frames: int
    excluding_frames: int
    lost_frames: int  # without a protected line, flagged or not
    delay_s: float  # median from the fault's beginning to the first flag; NaN without one

    @property
    def good_share(self) -> float:
        return (self.detected + self.harmless) / self.runs


def outcome(run: Sequence[Moment], alert_s: float = ALERT_S) -> Outcome:
    """What a fault led to.

    A misleading frame is forgiven when a flag is up, or guidance gone, at most `alert_s` after it began to mislead.
    """
    since: float | None = None
    for moment in run:
        if not moment.faulty:
            continue
        if not moment.misleading:
            since = None
            continue
        since = moment.time_s if since is None else since
        if moment.time_s - since > alert_s:
            return Outcome.MISLEADING
    if since is not None:
        return Outcome.MISLEADING  # it misled to the end and no flag came
    warned = any(moment.faulty and moment.flagged for moment in run)
    if warned:
        return Outcome.DETECTED
    return Outcome.MISLEADING if any(m.faulty and m.misleading for m in run) else Outcome.HARMLESS


def fault_row(runs: Sequence[Sequence[Moment]], alert_s: float = ALERT_S) -> FaultRow:
    """Sum up the runs of one fault.

    Raises:
        ValueError: no run.
    """
    if not runs:
        raise ValueError("no run of this fault")
    outcomes = [outcome(run, alert_s) for run in runs]
    faulty = [moment for run in runs for moment in run if moment.faulty]
    delays = [delay for run in runs if (delay := detection_delay_s(run)) is not None]
    return FaultRow(
        runs=len(runs),
        detected=outcomes.count(Outcome.DETECTED),
        harmless=outcomes.count(Outcome.HARMLESS),
        misleading=outcomes.count(Outcome.MISLEADING),
        frames=len(faulty),
        misleading_frames=sum(moment.misleading for moment in faulty),
        flagged_frames=sum(moment.flagged for moment in faulty),
        excluding_frames=sum(moment.excluded for moment in faulty),
        lost_frames=sum(not moment.protected for moment in faulty),
        delay_s=float(np.median(delays)) if delays else float("nan"),
    )


def flags_raised(runs: Iterable[Sequence[Moment]]) -> dict[str, int]:
    """How many frames raised each flag, the most frequent first."""
    return dict(Counter(name for run in runs for moment in run for name in moment.flags).most_common())


def detection_delay_s(run: Sequence[Moment]) -> float | None:
    """From the first frame with the fault to the first flag after it; None where none came."""
    begun = next((moment.time_s for moment in run if moment.faulty), None)
    flag = next((moment.time_s for moment in run if moment.faulty and moment.flagged), None)
    return None if begun is None or flag is None else flag - begun


def share_interval(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of a share, Clopper and Pearson's: never too narrow for independent trials.

    Raises:
        ValueError: nothing tried, or more hits than trials.
    """
    if not 0 <= hits <= of or of < 1:
        raise ValueError(f"expected 0 <= hits <= trials and at least 1 trial, got {hits} of {of}")
    found = binomtest(hits, of).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)
