"""`deckline live`."""

import logging
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from deckline.cli.sources import SIMULATOR, SourceOptions
from deckline.cli.views import ViewOptions
from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import lock_folder, printable
from deckline.flight import Flight
from deckline.interrupts import on_first_signal
from deckline.live.clock import WallClock
from deckline.live.folder import FlightRecorder, open_output
from deckline.live.opening import SCHEMES, is_camera
from deckline.live.pipeline import STALE_S, LiveSession, Outputs, live_config
from deckline.live.poses import PoseLookup, UdpPoses
from deckline.live.source import LiveSource, Playback
from deckline.live.tally import Log
from deckline.options import RunOptions
from deckline.report.records import Record

if TYPE_CHECKING:
    from deckline.adapters.mavlink.link import Link

DEFAULTS, SOURCE, VIEWS = RunOptions(), SourceOptions(), ViewOptions()
FROM_AUTOPILOT = "mavlink"  # as the source of poses
Level = Literal["info", "warning", "error"]


def live(
    source: tyro.conf.Positional[str],
    to: str = "-",
    out: Path | None = None,
    record: bool = False,
    opening: Annotated[SourceOptions, tyro.conf.arg(name="")] = SOURCE,
    poses: str | None = None,
    mavlink: str | None = None,
    autopilot: str | None = None,
    watching: Annotated[ViewOptions, tyro.conf.arg(name="")] = VIEWS,
    latency_s: float = 0.0,
    stale_s: float = STALE_S,
    rate: float = 30.0,
    duration: float | None = None,
    log_level: Level = "info",
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
    overwrite: bool = False,
) -> int:
    """Guide from a camera, a network stream or a simulator: one JSON line for each answer, with its age.

    Runs until Ctrl-C, SIGTERM or --duration; a source that fails is waited for, and guidance is "stale".

    Args:
        source: camera:N, rtsp://..., udp://HOST:PORT (MPEG-TS), rtp://HOST:PORT (MPEG-TS in RTP), airsim://HOST:PORT,
            or a recording or video, which is played at its own pace.
        to: where the lines go: - for stdout, or udp://HOST:PORT.
        out: folder for guidance.jsonl, and at the end guidance.csv, report.html and run.toml.
        record: write the frames into `out`/recording, for `deckline run`.
        opening: of the source.
        poses: udp://HOST:PORT on which poses arrive as JSON lines, or mavlink: from the autopilot of --mavlink; of a
            recording as in `deckline run`.
        mavlink: udp:HOST:PORT to listen on for an autopilot that takes LANDING_TARGET, or udpout:HOST:PORT to send to.
        autopilot: px4 or ardupilot.
        watching: of the views.
        latency_s: of exposure, coding and network, between a scene and its picture's arrival.
        stale_s: guidance is stale so many seconds after the last frame.
        rate: frames a second that are taken from a simulator or asked of it, at most.
        duration: seconds to run.
        log_level: of the lines on stderr: info, warning or error, and above.
        options: of the configuration.
        overwrite: replace the results of an older run in `out`.
    """
    if record and out is None:
        raise ValueError("--record writes frames into the folder of --out: state it")
    if duration is not None and not duration > 0:
        raise ValueError(f"--duration must be greater than 0, got {duration}")
    config = opening.place_poses(options.run_config())
    wall, log = WallClock(), _make_log(log_level)
    with ExitStack() as stack:
        send = stack.enter_context(open_output(to, log.warning))
        pilot = _open_autopilot(mavlink, autopilot, poses, config, wall, log, stack)
        link = _open_poses(source, opening, poses, pilot, config, wall, log.warning, stack)
        opened: LiveSource
        if is_camera(source):
            opened = opening.open_stream(source, wall, latency_s, rate, log.warning)
        elif source.startswith(SIMULATOR):
            opened = opening.open_simulator(source, rate, poses, log.warning)
        elif "://" in source:
            schemes = ", ".join((*SCHEMES, "airsim"))
            raise ValueError(f"{source}: expected a recording, /dev/videoN or an address of {schemes}")
        else:
            opened = Playback(opening.open_recording(source, config, poses))
            config = opening.place_poses(options.run_config(opened.base_config))
        config = live_config(config)
        flight = stack.enter_context(Flight.from_config(config))
        for note in opened.notes:
            log.info(f"note: {note}")
        if out is not None:
            stack.enter_context(lock_folder(out))
        recorder = None if out is None else FlightRecorder(out, opened, flight, record, overwrite)
        outputs = Outputs(send if pilot is None else _send_to_both(pilot.send, send), log.warning)
        switch = None
        if recorder is not None:
            outputs, switch = recorder.add_to(outputs), recorder.record
        views = watching.open(
            opened.name, config, is_live=True, overwrite=overwrite, log=log.info, record=switch, is_recording=record
        )
        outputs = replace(outputs, views=stack.enter_context(views))
        session = LiveSession(opened, flight, outputs, poses=link, wall=wall, stale_s=stale_s)
        with on_first_signal(session.stop, signal.SIGINT, signal.SIGTERM):
            try:
                summary = session.run(duration)
            except BaseException:
                if recorder is not None:
                    recorder.abandon()
                    _warn(log, recorder)
                raise
            written = [] if recorder is None else recorder.finish()
    for line in (*summary.lines(), *written):
        log.info(line)
    if recorder is not None:
        _warn(log, recorder)
    return 0


def _warn(log: logging.Logger, recorder: FlightRecorder) -> None:
    for line in recorder.notes():
        log.warning(line)


class _Formatter(logging.Formatter):
    """UTC to the millisecond, level, and the message as one printable line."""

    def __init__(self) -> None:
        self.converter = time.gmtime
        super().__init__("%(asctime)s.%(msecs)03dZ %(levelname)s %(message)s", "%Y-%m-%dT%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def _make_log(level: Level) -> logging.Logger:
    """A logger of its own, outside of the tree of named loggers, that prints on stderr from `level` on."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter())
    log = logging.Logger("deckline", level.upper())
    log.addHandler(handler)
    return log


def _open_autopilot(
    address: str | None,
    firmware: str | None,
    poses: str | None,
    config: RunConfig,
    wall: WallClock,
    log: logging.Logger,
    stack: ExitStack,
) -> "Link | None":
    """The link to an autopilot; None: none was asked for."""
    takes_poses, origin = poses == FROM_AUTOPILOT, config.navigation.origin
    if address is None and (firmware is not None or takes_poses):
        raise ValueError("--autopilot and --poses mavlink need --mavlink udp:HOST:PORT")
    if address is None:
        return None
    if firmware is None:
        raise ValueError("--mavlink needs --autopilot px4 or ardupilot")
    if takes_poses and firmware == "px4" and origin is not None:
        raise ValueError("px4 takes targets in its own local frame, which --poses mavlink gives: leave --origin out")
    with needs_extra("mavlink"):
        from deckline.adapters.mavlink.link import Link
    link = Link(address, firmware, config.navigation, wall, log.info, takes_poses, log_losses=log.warning)
    return stack.enter_context(closing(link))


def _send_to_both(first: Callable[[Record], None], second: Callable[[Record], None]) -> Callable[[Record], None]:
    def send(record: Record) -> None:
        first(record)
        second(record)

    return send


def _open_poses(
    source: str,
    opening: SourceOptions,
    poses: str | None,
    pilot: "Link | None",
    config: RunConfig,
    wall: WallClock,
    log: Log,
    stack: ExitStack,
) -> PoseLookup | None:
    """Poses of a camera's pictures; None of those without, and of recordings and simulators, which have their own.

    Raises:
        ValueError: poses that the source has no use for.
    """
    if not is_camera(source):
        if poses == FROM_AUTOPILOT:
            raise ValueError(f"{source}: poses of an autopilot are for cameras and streams; leave --poses out")
        return None
    if poses is not None and opening.camera is None and opening.fov_deg is None:
        raise ValueError(f"{source}: poses are of no use without --camera or --fov-deg")
    if poses == FROM_AUTOPILOT:
        return pilot
    return None if poses is None else stack.enter_context(closing(UdpPoses(poses, config.navigation, wall, log)))


COMMANDS = {"live": live}
EXAMPLES = {
    "deckline live": (
        "deckline live camera:0 --camera camera.toml --poses udp://0.0.0.0:5601 --deck-z-m -18",
        "deckline live udp://0.0.0.0:5600 --to udp://127.0.0.1:5602 --out flight --record",
    ),
}
