"""Capture, perceive and guide, each in its own thread; between them the newest item wins."""

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from deckline.config import RunConfig
from deckline.flight import Flight, FrameResult
from deckline.live.clock import WallClock
from deckline.live.mailbox import Mailbox
from deckline.live.messages import NO_FRAME, Answer, FrameCounts, answer_record, stale_record
from deckline.live.poses import PoseLookup
from deckline.live.recorder import round_pose
from deckline.live.source import Captured, LiveSource
from deckline.live.tally import Log, Tally
from deckline.recording import BadFrame
from deckline.report.records import FlightView, Record
from deckline.runtime import usable_cores
from deckline.types import Frame

STALE_S = 0.2
STALE_EVERY_S = 0.5  # between messages while there is no frame
TICK_S = 0.01  # between checks for staleness
WAIT_S = 0.1  # a wait for a frame notices a stop within this time
AGES = 10_000  # of the last answers, for the summary
LATE_S, LATE_ANSWERS = 0.15, 30  # median age of so many answers, above which a busy machine is named
BUSY = 1.5  # load for each core
END_S = 3.0  # for a thread to end; one that hangs in a driver is left behind


@dataclass(frozen=True)
class Outputs:
    """Where everything goes. The perceiving thread calls `record`, the guiding one the others."""

    send: Callable[[Record], None]
    """Takes each message."""
    log: Log
    """Takes lines for people."""
    record: Callable[[Frame], None] | None = None
    """Takes each frame that is flown; None: nothing does."""
    views: tuple[FlightView, ...] = ()
    """Watch the flight."""


@dataclass(frozen=True)
class LiveSummary:
    """What a session came to."""

    frames: FrameCounts
    """Frames by what became of them."""
    counts: dict[str, int]
    """Messages by status, and those without a frame."""
    ages_s: tuple[float, ...]
    """Of the last answers when they were sent, s."""

    def lines(self) -> list[str]:
        """For people."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items()) or "none"
        done = self.frames
        found = [
            f"{done.frames} frames, {done.dropped} dropped, {done.damaged} damaged, {done.unsent} answers unsent",
            f"messages: {counts}",
        ]
        if self.ages_s:
            middle, high = np.percentile(self.ages_s, [50, 99])
            found.append(f"age of the answers: {1e3 * middle:.0f} ms in the median, {1e3 * high:.0f} ms at 99 %")
        return found


class End:
    """Marks the end of a recording."""


def live_config(config: RunConfig) -> RunConfig:
    """The same, but no picture is searched whole at once: its answer would be a second old."""
    return replace(config, tracking=replace(config.tracking, first_at_once=False))


class LiveSession:
    """One flight from a live source; `run` it once.

    Args:
        source: of the frames.
        flight: answers them.
        outputs: where messages go.
        poses: of frames that come without one; None: none.
        wall: Unix time.
        stale_s: without a frame or an answer for so long, "stale" goes out, and older answers are flagged.
    """

    def __init__(
        self,
        source: LiveSource,
        flight: Flight,
        outputs: Outputs,
        *,
        poses: PoseLookup | None = None,
        wall: WallClock | None = None,
        stale_s: float = STALE_S,
    ) -> None:
        if not stale_s > 2 * TICK_S:
            raise ValueError(f"stale_s must be greater than {2 * TICK_S}, got {stale_s}")
        self.counts: dict[str, int] = {}
        self._source = source
        self._flight = flight
        self._out = outputs
        self._poses = poses
        self._offset_s = (wall or WallClock()).at(0.0)
        self._stale_s = stale_s
        self._stopped = threading.Event()
        self._errors: list[BaseException] = []
        self._frames: Mailbox[Captured | End] = Mailbox()
        self._answers: Mailbox[Answer | End] = Mailbox()
        self._whole = 0  # frames
        self._damaged = Tally("frames could not be used", outputs.log)
        self._damage = ""  # why the last frame could not be used; empty: it could
        self._captured_s = time.monotonic()  # capture of the last whole frame
        self._ages: deque[float] = deque(maxlen=AGES)
        self._is_warned = False  # of late answers

    def stop(self) -> None:
        """End `run`; for a signal handler or any thread."""
        self._stopped.set()
        self._source.stop()

    def run(self, duration_s: float | None = None) -> LiveSummary:
        """Fly until `stop`, the end of a recording, or so many seconds.

        Raises:
            Exception: what ended a thread that nothing should end.
        """
        end_s = np.inf if duration_s is None else time.monotonic() + duration_s
        steps = (self._capture, self._perceive, self._guide)
        threads = [threading.Thread(target=self._watch, args=(step,), daemon=True) for step in steps]
        for thread in threads:
            thread.start()
        while not self._stopped.is_set() and time.monotonic() < end_s:
            time.sleep(TICK_S)  # no wait for the event: a signal handler sets it
        self.stop()
        for thread in threads:
            thread.join(END_S)
        self._damaged.close()
        self._source.close()
        if self._errors:
            raise self._errors[0]
        return LiveSummary(self._count(), dict(self.counts), tuple(self._ages))

    def _watch(self, step: Callable[[], None]) -> None:
        try:
            step()
        except BaseException as error:
            self._errors.append(error)
            self.stop()

    def _count(self) -> FrameCounts:
        lost = self._frames.dropped, self._damaged.count, self._answers.dropped
        return FrameCounts(self._whole, *lost, self._source.restarts)

    def _capture(self) -> None:
        for item in self._source.captures():
            if isinstance(item, BadFrame):
                self._refuse(item)
            else:
                self._captured_s, self._damage = item.at_s, ""
                self._whole += 1
                self._frames.put(item)
            if self._stopped.is_set():
                return
        self._frames.put_last(End(), END_S)

    def _refuse(self, bad: BadFrame) -> None:
        """Count a frame that cannot be used; for two threads."""
        self._damage = bad.reason
        self._damaged.add(bad.reason)

    def _perceive(self) -> None:
        while not self._stopped.is_set():
            captured = self._frames.take(WAIT_S)
            if captured is None:
                continue
            if isinstance(captured, End):
                return self._answers.put_last(captured, END_S)
            frame = captured.frame
            if self._poses is not None and frame.camera.known:
                frame = replace(frame, world_from_body=self._poses(frame.time_s))
            if frame.world_from_body is not None:
                frame = replace(frame, world_from_body=round_pose(frame.world_from_body))
            if self._out.record is not None:
                self._out.record(frame)
            try:
                result = self._flight(frame)
                self._answers.put(Answer(result, self._flight.forecast(), captured.at_s))
                self._flight.search_on()
            except ValueError as error:
                self._refuse(BadFrame(frame.file, " ".join(str(error).split())))

    def _guide(self) -> None:
        last: Answer | None = None
        sent_s = time.monotonic()
        stale_sent_s = -np.inf
        approach = self._flight.config.approach
        while not self._stopped.is_set():
            answer = self._answers.take(TICK_S)
            now_s = time.monotonic()
            if isinstance(answer, End):
                return self.stop()
            if answer is not None:
                last, sent_s, stale_sent_s = answer, now_s, -np.inf
                record = answer_record(answer, self._count(), now_s, self._offset_s, self._stale_s, approach)
                self._ages.append(now_s - answer.at_s)
                self._warn_if_late()
                self._send(record, answer.result)
                continue
            silent_s = now_s - min(self._captured_s, sent_s)
            if silent_s > self._stale_s - 2 * TICK_S and now_s - stale_sent_s > STALE_EVERY_S:
                stale_sent_s = now_s
                reason = self._explain(now_s, last is None)
                self._send(stale_record(last, self._count(), now_s, self._offset_s, reason, approach), None)

    def _warn_if_late(self) -> None:
        """One line for the flight, where answers come late on a machine that has more to do than it can."""
        newest = tuple(islice(reversed(self._ages), LATE_ANSWERS))
        if self._is_warned or len(newest) < LATE_ANSWERS or (age_s := float(np.median(newest))) < LATE_S:
            return
        load, cores = os.getloadavg()[0], usable_cores()
        if load > BUSY * cores:
            self._is_warned = True
            remedy = "stop other programs, or use --device openvino, smaller pictures or a lower --rate"
            self._out.log(f"answers are {1e3 * age_s:.0f} ms old: a load of {load:.1f} on {cores} cores; {remedy}")

    def _explain(self, now_s: float, is_first: bool) -> str:
        """Why there is no answer; `is_first`: there was none before."""
        if now_s - self._captured_s <= self._stale_s - 2 * TICK_S:
            return "frames come, but answers take too long"
        why = f"; the last one: {self._damage}" if self._damage else ""
        return ("no frame yet" if is_first else f"no frame for {now_s - self._captured_s:.2f} s") + why

    def _send(self, record: Record, result: FrameResult | None) -> None:
        self._out.send(record)
        for view in self._out.views:
            view(result, record)
        kind = NO_FRAME if record["file"] is None else str(record["status"])
        self.counts[kind] = self.counts.get(kind, 0) + 1
