"""`deckline live`."""

import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from deckline.cli.dashboard import Address, open_dashboard
from deckline.cli.publish import open_publisher
from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import lock_folder, print_line
from deckline.flight import Flight
from deckline.live.clock import WallClock
from deckline.live.folder import Folder, open_output
from deckline.live.opening import is_camera, open_camera
from deckline.live.pipeline import STALE_S, Outputs, Session
from deckline.live.poses import PoseSource, UdpPoses
from deckline.live.source import LiveSource, Playback
from deckline.options import RunOptions
from deckline.recording import open_recording
from deckline.recording.camera_file import read_camera_file
from deckline.report.records import Record

if TYPE_CHECKING:
    from deckline.adapters.mavlink.link import Link

DEFAULTS = RunOptions()
FROM_AUTOPILOT = "mavlink"  # as the source of poses


def live(
    source: tyro.conf.Positional[str],
    to: str = "-",
    out: Path | None = None,
    record: bool = False,
    camera: str | None = None,
    poses: str | None = None,
    mavlink: str | None = None,
    autopilot: str | None = None,
    dashboard: Address = None,
    mcap: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    foxglove: Address = None,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    pose_offset_s: float | None = None,
    max_pose_gap_s: float | None = None,
    origin: tuple[float, float, float] | None = None,
    topic: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = (),
    latency_s: float = 0.0,
    stale_s: float = STALE_S,
    rate: float = 30.0,
    duration: float | None = None,
    options: Annotated[RunOptions, tyro.conf.arg(name="")] = DEFAULTS,
    overwrite: bool = False,
) -> int:
    """Guide from a camera, a network stream or a simulator: one JSON line for each answer, as late as it says.

    Runs until Ctrl-C, SIGTERM or --duration; a source that fails is waited for, and guidance says "stale".

    Args:
        source: camera:N, rtsp://..., udp://HOST:PORT (MPEG-TS), rtp://HOST:PORT (MPEG-TS in RTP), airsim://HOST:PORT,
            or a recording or video, which is played at its own pace.
        to: where the lines go: - for stdout, or udp://HOST:PORT.
        out: folder for guidance.jsonl, and at the end guidance.csv, report.html and run.toml.
        record: keep the frames in `out`/recording, for `deckline run`.
        camera: camera.toml, or a YAML calibration of OpenCV or ROS; of a simulator the camera's name.
        poses: udp://HOST:PORT on which poses arrive as JSON lines, or mavlink: from the autopilot of --mavlink; of a
            recording as in `deckline run`.
        mavlink: udp:HOST:PORT to listen on for an autopilot that takes LANDING_TARGET, or udpout:HOST:PORT to send to.
        autopilot: px4 or ardupilot.
        dashboard: watch in a browser at http://HOST:PORT (127.0.0.1:8080).
        mcap: for pictures and guidance as ROS 2 messages.
        foxglove: the same live, for Foxglove (127.0.0.1:8765).
        deck_z_m: world z (down, metres) of the deck plane.
        sea_z_m: world z (down, metres) of the water, for dehazing, and to notice a pitched camera.
        pose_offset_s: the clock of the poses minus this machine's Unix time (0).
        max_pose_gap_s: between two poses, beyond which frames in between have no pose (0.5).
        origin: latitude, longitude, degrees, and altitude, m, of the world's origin.
        topic: of a ROS bag, where several are there.
        latency_s: of exposure, coding and network, between a scene and its picture's arrival.
        stale_s: guidance is stale so many seconds after the last frame.
        rate: frames a second that are taken from a simulator or asked of it, at most.
        duration: seconds to run.
        options: of the configuration.
        overwrite: replace the results of an older run in `out`.
    """
    if record and out is None:
        raise ValueError("--record keeps frames in the folder of --out: state it")
    if duration is not None and not duration > 0:
        raise ValueError(f"--duration must be greater than 0, got {duration}")
    config = options.run_config()
    stated = {"offset_s": pose_offset_s, "max_gap_s": max_pose_gap_s, "origin": origin}
    navigation: Any = {name: value for name, value in stated.items() if value is not None}
    config = replace(config, navigation=replace(config.navigation, **navigation))
    wall, flight = WallClock(), Flight.from_config(config)
    with ExitStack() as stack:
        send = stack.enter_context(open_output(to))
        pilot = _open_autopilot(mavlink, autopilot, poses, config, wall, stack)
        if is_camera(source):
            mounted = None if camera is None else read_camera_file(Path(camera)).at(deck_z_m, sea_z_m)
            opened: LiveSource = open_camera(source, mounted, wall, latency_s, rate, print_line)
            link: PoseSource | None = pilot if poses == FROM_AUTOPILOT else None
            if poses is not None and link is None:
                link = stack.enter_context(closing(UdpPoses(poses, config.navigation, wall)))
            if link is not None and mounted is None:
                raise ValueError(f"{source}: poses are of no use without --camera")
        elif poses == FROM_AUTOPILOT:
            raise ValueError(f"{source}: poses of an autopilot are for cameras and streams; leave --poses out")
        else:
            link = None
            opened = _open_other(source, camera, poses, deck_z_m, sea_z_m, rate, topic, config)
        for note in opened.notes:
            print_line(f"note: {note}")
        if out is not None:
            stack.enter_context(lock_folder(out))
        folder = None if out is None else Folder(out, opened, flight, record, overwrite)
        outputs = Outputs(send if pilot is None else _send_to_both(pilot.send, send), print_line)
        outputs = outputs if folder is None else folder.add_to(outputs)
        recorder = None if folder is None else folder.record
        watched = open_dashboard(dashboard, opened.name, config, True, recorder, record)
        published = open_publisher(mcap, foxglove, opened.name, config, True, overwrite)
        views = (*stack.enter_context(watched), *stack.enter_context(published))
        outputs = replace(outputs, views=(*outputs.views, *views))
        session = Session(opened, flight, outputs, poses=link, wall=wall, stale_s=stale_s)
        with _stop_on_signal(session):
            try:
                summary = session.run(duration)
            finally:
                written = [] if folder is None else folder.finish(session.counts)
    for line in (*summary.lines(), *([] if folder is None else folder.losses()), *_pose_losses(link)):
        print_line(line)
    for path in written:
        print_line(path)
    return 0


def _open_autopilot(
    address: str | None, firmware: str | None, poses: str | None, config: RunConfig, wall: WallClock, stack: ExitStack
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
    return stack.enter_context(closing(Link(address, firmware, config.navigation, wall, print_line, takes_poses)))


def _send_to_both(first: Callable[[Record], None], second: Callable[[Record], None]) -> Callable[[Record], None]:
    def send(record: Record) -> None:
        first(record)
        second(record)

    return send


def _open_other(
    source: str,
    camera: str | None,
    poses: str | None,
    deck_z_m: float | None,
    sea_z_m: float | None,
    rate: float,
    topics: tuple[str, ...],
    config: RunConfig,
) -> LiveSource:
    """A simulator, or a recording played at its own pace."""
    if not source.startswith("airsim:"):
        heights: Any = {"deck_z_m": deck_z_m, "sea_z_m": sea_z_m, "navigation": config.navigation}
        return Playback(open_recording(source, camera_file=camera, poses_file=poses, topics=topics, **heights))
    if poses is not None:
        raise ValueError(f"{source}: a simulator gives the poses itself; leave {poses} out")
    with needs_extra("sim"):
        from deckline.adapters.airsim.source import AirSimSource
    return AirSimSource(source, camera or "0", rate, deck_z_m, sea_z_m)


def _pose_losses(poses: PoseSource | None) -> list[str]:
    if not isinstance(poses, UdpPoses) or not poses.refused:
        return []
    return [f"{poses.refused} poses refused; the last one: {poses.reason}"]


@contextmanager
def _stop_on_signal(session: Session) -> Iterator[None]:
    """SIGINT and SIGTERM end the session; a second one is no longer held back."""
    signals = (signal.SIGINT, signal.SIGTERM)
    before: Any = [signal.getsignal(number) for number in signals]

    def restore() -> None:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)

    def stop(_number: int, _frame: FrameType | None) -> None:
        restore()
        session.stop()

    for number in signals:
        signal.signal(number, stop)
    try:
        yield
    finally:
        restore()


COMMANDS = {"live": live}
EXAMPLES = {
    "deckline live": (
        "deckline live camera:0 --camera camera.toml --poses udp://0.0.0.0:5601 --deck-z-m -18",
        "deckline live udp://0.0.0.0:5600 --to udp://127.0.0.1:5602 --out flight --record",
    ),
}
