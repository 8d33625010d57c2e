"""Live messages: the records of guidance.jsonl with their age and the track predicted to the present."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import Approach
from deckline.flight import FrameResult
from deckline.guide import guidance
from deckline.picture_pose import PictureForecast
from deckline.report.records import GUIDANCE, Record, frame_record, guidance_record, protection_record
from deckline.track import Forecast
from deckline.types import (
    DepthMode,
    Diagnostic,
    Guidance,
    LineVisibility,
    PoseSource,
    Reason,
    RunwayEstimate,
    Status,
    Track,
    Value,
)

NO_FRAME = "without a frame"  # what is counted of messages that carry none
LIVE_COLUMNS = {
    name: ("live", name)
    for name in ("captured_s", "sent_s", "age_s", "frames", "dropped", "damaged", "unsent", "restarts")
}
VELOCITY_STEP_S = 0.1  # the deck's velocity is how far the touchdown point goes in this time
Prediction = tuple[Track, RigidTransform, float]  # track, world_from_body and 1-sigma of its heading, rad
NOTHING = RunwayEstimate(LineVisibility.NONE, DepthMode.NONE, {}, {})


@dataclass(frozen=True)
class FrameCounts:
    """Frames of a session by what became of them; every message carries it."""

    frames: int = 0
    """Frames that came whole."""
    dropped: int = 0
    """Of these, those that a newer one replaced before they were processed."""
    damaged: int = 0
    """Frames that could not be used."""
    unsent: int = 0
    """Answers that a newer one replaced because the output is slow."""
    restarts: int = 0
    """Times that the source came back after a failure."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A frame's result, and what predicts later times from it."""

    result: FrameResult
    """Of the frame."""
    forecast: Forecast | PictureForecast | None
    """Predicts its track; None: no track."""
    at_s: float
    """Time of capture, monotonic clock, s."""


def answer_record(
    answer: Answer, counts: FrameCounts, now_s: float, offset_s: float, stale_s: float, approach: Approach
) -> Record:
    """The message about a frame.

    Args:
        now_s: time of sending, monotonic clock.
        offset_s: Unix time minus the monotonic clock.
        stale_s: an older answer is flagged.
    """
    result, age_s = answer.result, now_s - answer.at_s
    if age_s > stale_s:
        late = Diagnostic(Reason.STALE, f"the answer is {age_s:.2f} s old")
        result = replace(result, guidance=replace(result.guidance.with_flag(late), status=Status.STALE))
    return frame_record(result, approach) | {"live": _live(answer, counts, now_s, offset_s, approach)}


def stale_record(
    answer: Answer | None, counts: FrameCounts, now_s: float, offset_s: float, reason: str, approach: Approach
) -> Record:
    """The message when there is no new frame; `answer` is the last one."""
    return {
        "file": None,
        "time_s": None,
        "status": str(Status.STALE),
        "seen": str(LineVisibility.NONE),
        "pose_source": None,
        "scale_sources": [],
        "mode": str(DepthMode.NONE),
        "reason": reason,
        "reasons": [str(Reason.STALE)],
        "guidance": dict.fromkeys(GUIDANCE),
        "protection": None,
        "flags": [{"name": str(Reason.STALE), "reason": reason}],
        "live": _live(answer, counts, now_s, offset_s, approach),
    }


def _live(answer: Answer | None, counts: FrameCounts, now_s: float, offset_s: float, approach: Approach) -> Record:
    moment = None if answer is None else _predict(answer, now_s)
    found = None if answer is None or moment is None else predict_guidance(answer, moment, approach)
    return {
        "captured_s": None if answer is None else round(answer.at_s + offset_s, 6),
        "sent_s": round(now_s + offset_s, 6),
        "age_s": None if answer is None else round(now_s - answer.at_s, 6),
        **asdict(counts),
        "now": None if found is None else guidance_record(found),
        "now_protection": None if found is None or found.protection is None else protection_record(found.protection),
        "touchdown": None if answer is None or moment is None else touchdown_record(answer, moment, now_s, approach),
    }


def touchdown_record(answer: Answer, moment: Prediction, now_s: float, approach: Approach) -> Record | None:
    """The touchdown point of a moment in world and body, m, its velocity, m/s, and the azimuth of the landing.

    None while no ramp is known, and without metres. The velocity is None where the track ends before it shows. A pose
    of the picture has no place in the navigation's world: only the point in the body is given.
    """
    frame = answer.result.frame
    if frame.in_widths:
        return None
    track, world_from_body, _ = moment
    point, later = _touchdown_point(track, approach), _predict(answer, now_s + VELOCITY_STEP_S)
    if point is None:
        return None
    ahead = None if later is None else _touchdown_point(later[0], approach)
    velocity = None if ahead is None else (ahead - point) / VELOCITY_STEP_S
    vectors = {"world_m": point, "body_m": world_from_body.inv().apply(point), "velocity_m_s": velocity}
    record: Record = {name: None if v is None else np.round(v, 6).tolist() for name, v in vectors.items()}
    record["azimuth_deg"] = round(float(np.rad2deg(track.lines["centre"].azimuth_rad)), 6)
    return (
        record if frame.pose_source is PoseSource.NAVIGATION else dict.fromkeys(record) | {"body_m": record["body_m"]}
    )


def _touchdown_point(track: Track, approach: Approach) -> NDArray[np.float64] | None:
    centre = track.lines.get("centre")
    if centre is None or track.ramp_m is None:
        return None
    ahead_m = (track.ramp_m - centre.point_m) @ centre.direction + approach.touchdown_m
    point: NDArray[np.float64] = centre.point_m + ahead_m * centre.direction
    return point


def predict_guidance(answer: Answer, moment: Prediction, approach: Approach) -> Guidance:
    """The last answer's guidance with track and aircraft of a later moment."""
    track, world_from_body, turn_rad = moment
    if answer.result.track is not None:
        track = replace(track, flags=answer.result.track.flags)  # with those of the search beside the track
    shown = answer.result.estimate
    estimate = replace(NOTHING, seen=shown.seen, mode=shown.mode, flags=shown.flags)
    later = replace(answer.result.frame, time_s=track.time_s, world_from_body=world_from_body)
    found = guidance(later, estimate, track, approach)
    heading = found.heading_error_rad
    if heading is None:
        return found
    return replace(found, heading_error_rad=Value(heading.value, float(np.hypot(heading.sigma, turn_rad))))


def _predict(answer: Answer, now_s: float) -> Prediction | None:
    """Track and aircraft at a time of the monotonic clock.

    None without a track or a pose, and when no line was seen for too long.
    """
    time_s = answer.result.frame.time_s + (now_s - answer.at_s)
    return None if answer.forecast is None else answer.forecast.at(time_s)
