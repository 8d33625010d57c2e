"""What goes out: the records of guidance.jsonl with how late they are and what the track says of the present."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from deckline.config import Approach
from deckline.flight import FrameResult
from deckline.guide import guidance
from deckline.report.records import GUIDANCE, Record, frame_record, guidance_record, protection_record
from deckline.track.forecast import Forecast
from deckline.types import DepthMode, Guidance, Notice, Reason, RunwayEstimate, Seen, Status, Value

NO_FRAME = "without a frame"  # what is counted of messages that carry none
LIVE_COLUMNS = {
    name: ("live", name) for name in ("captured_s", "sent_s", "age_s", "frames", "dropped", "damaged", "unsent")
}
NOTHING = RunwayEstimate(Seen.NONE, DepthMode.NONE, {}, {})


@dataclass(frozen=True)
class Progress:
    """How far a session has come; every message carries it."""

    frames: int = 0  # that came whole
    dropped: int = 0  # of these, those that a newer one replaced before it was looked at
    damaged: int = 0  # frames that could not be used
    unsent: int = 0  # answers that a newer one replaced because the output is slow


@dataclass(frozen=True, eq=False)
class Answer:
    """A frame's result, and what it takes to speak about later times."""

    result: FrameResult
    forecast: Forecast | None  # None: no track
    at_s: float  # capture, monotonic clock


def answer_record(
    answer: Answer, progress: Progress, now_s: float, offset_s: float, stale_s: float, approach: Approach
) -> Record:
    """The message about a frame.

    Args:
        answer: of the frame.
        progress: counts so far.
        now_s: time of sending, monotonic clock.
        offset_s: Unix time minus the monotonic clock.
        stale_s: an older answer is flagged.
        approach: the wanted one.
    """
    result, age_s = answer.result, now_s - answer.at_s
    if age_s > stale_s:
        late = Notice(Reason.STALE, f"the answer is {age_s:.2f} s old")
        flags = (*result.guidance.flags, late)
        result = replace(result, guidance=replace(result.guidance, status=Status.STALE, flags=flags))
    return frame_record(result, approach) | {"live": _live(answer, progress, now_s, offset_s, approach)}


def stale_record(
    answer: Answer | None, progress: Progress, now_s: float, offset_s: float, reason: str, approach: Approach
) -> Record:
    """The message when there is no new frame; `answer` is the last one."""
    return {
        "file": None,
        "time_s": None,
        "status": str(Status.STALE),
        "seen": str(Seen.NONE),
        "scale_from": [],
        "mode": str(DepthMode.NONE),
        "reason": reason,
        "reasons": [str(Reason.STALE)],
        "guidance": dict.fromkeys(GUIDANCE),
        "protection": None,
        "flags": [{"name": str(Reason.STALE), "reason": reason}],
        "live": _live(answer, progress, now_s, offset_s, approach),
    }


def _live(answer: Answer | None, progress: Progress, now_s: float, offset_s: float, approach: Approach) -> Record:
    moment = None if answer is None else predict_guidance(answer, now_s, approach)
    return {
        "captured_s": None if answer is None else round(answer.at_s + offset_s, 6),
        "sent_s": round(now_s + offset_s, 6),
        "age_s": None if answer is None else round(now_s - answer.at_s, 6),
        **asdict(progress),
        "now": None if moment is None else guidance_record(moment),
        "now_protection": None if moment is None or moment.protection is None else protection_record(moment.protection),
    }


def predict_guidance(answer: Answer, now_s: float, approach: Approach) -> Guidance | None:
    """The last answer's track and aircraft carried forward to a time of the monotonic clock.

    None without a track or a pose, and when no line was seen for too long.
    """
    frame, age_s = answer.result.frame, now_s - answer.at_s
    moment = None if answer.forecast is None else answer.forecast.at(frame.time_s + age_s)
    if moment is None:
        return None
    track, world_from_body, turn_rad = moment
    if answer.result.track is not None:
        track = replace(track, flags=answer.result.track.flags)  # with those of the search beside the track
    shown = answer.result.estimate
    estimate = replace(NOTHING, seen=shown.seen, mode=shown.mode, flags=shown.flags)
    later = replace(frame, time_s=track.time_s, world_from_body=world_from_body)
    found = guidance(later, estimate, track, approach)
    heading = found.heading_error_rad
    if heading is None:
        return found
    return replace(found, heading_error_rad=Value(heading.value, float(np.hypot(heading.sigma, turn_rad))))
