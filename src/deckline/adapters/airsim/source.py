"""A simulator that speaks AirSim's protocol, as a stream of frames."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from deckline.adapters.airsim.client import (
    POLL_S,
    SCHEME,
    Connection,
    Lost,
    Stopped,
    parse_address,
    take_images,
)
from deckline.adapters.airsim.frames import View, frame_name, live_frame
from deckline.adapters.airsim.mount import STILL_M, best_look, followed, look
from deckline.recording import BadFrame, RecordingError, Stream
from deckline.types import Frame

FIRST_WAIT_S, LONGEST_WAIT_S = 0.25, 8.0  # between two tries to connect again, doubled from one to the other
SLOW = 1.25  # frames that take so many times the wanted period are slow
WINDOW = 10  # frames over which that is judged


@dataclass(frozen=True)
class LiveConfig:
    """What to take from a simulator, and how often."""

    host: str
    port: int
    vehicle: str = ""  # "" is the simulator's first
    camera: str = "0"
    rate_hz: float = 5.0
    deck_z_m: float | None = None  # world z (down) of the deck plane
    sea_z_m: float | None = None  # world z (down) of the water


def say_on_stderr(line: str) -> None:
    print(line, file=sys.stderr)


class LiveSource(Stream):
    """Frames of a camera, at most `rate_hz` a second, until `stop`. A simulator that went away is waited for.

    Args:
        config: where and what.
        say: told when the simulator goes away, comes back, or is too slow.

    Raises:
        RecordingError: nobody answers, or there is no such camera.
    """

    def __init__(self, config: LiveConfig, say: Callable[[str], None] = say_on_stderr) -> None:
        if not 0.0 < config.rate_hz <= 1000.0:
            raise RecordingError(f"rate must lie between 0 and 1000 frames a second, got {config.rate_hz}")
        vehicle = f"/{config.vehicle}" if config.vehicle else ""
        self.name = f"{SCHEME}://{config.host}:{config.port}{vehicle} camera {config.camera}"
        self.config = config
        self._say = say
        self._stopped = threading.Event()
        self._connection: Connection | None = None
        try:
            with self._connect() as connection:
                first = best_look(connection, config.camera, config.vehicle)
        except Lost as error:
            raise RecordingError(f"{error}; start the simulator, or deckline sim --serve, and try again") from None
        except ValueError as error:
            raise RecordingError(f"{self.name}: {error}") from None
        self._mount = first.body_from_camera
        if first.moved_m > STILL_M:
            self.notes = (f"the vehicle was moving: where the camera sits on it is known within {first.moved_m:.2g} m",)

    def stop(self) -> None:
        self._stopped.set()

    def items(self) -> Iterator[Frame | BadFrame]:
        pace = Pace(self.config.rate_hz)
        try:
            while not self._stops_within(pace.wait_s(time.monotonic())):
                asked_s = time.monotonic()
                try:
                    item = self._take()
                except Lost as error:
                    self._connect_again(error)
                    pace = Pace(self.config.rate_hz)
                    continue
                slow = pace.took(asked_s, time.monotonic())
                if slow:
                    self._say(slow)
                yield item
        except Stopped:
            return
        finally:
            self._hang_up()

    def _take(self) -> Frame | BadFrame:
        """One frame. Raises Lost or Stopped."""
        if self._connection is None:
            self._connection = self._connect()
        name = self.config.camera
        try:
            scene, depth = take_images(self._connection, self.config.camera, self.config.vehicle)
            name = frame_name(self.config.camera, scene)
            now = look(self._connection, self.config.camera, self.config.vehicle)
            self._mount = followed(self._mount, now)
            config = self.config
            view = View(config.camera, self._mount, now.fov_rad, config.deck_z_m, sea_z_m=config.sea_z_m)
            return live_frame(scene, depth, view)
        except ValueError as error:
            return BadFrame(name, str(error))

    def _connect(self) -> Connection:
        return Connection(self.config.host, self.config.port, self._stopped)

    def _connect_again(self, error: Lost) -> None:
        """Wait until the simulator is back and has the camera. Raises Stopped."""
        self._hang_up()
        self._say(f"lost the simulator ({error}); waiting for it")
        wait_s = FIRST_WAIT_S
        while self._connection is None:
            if self._stops_within(wait_s):
                raise Stopped
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)
            try:
                self._connection = self._connect()
                first = best_look(self._connection, self.config.camera, self.config.vehicle)
                self._mount = first.body_from_camera
            except (Lost, ValueError):  # not there yet, or there and still loading
                self._hang_up()
        self._say("the simulator is back")

    def _stops_within(self, seconds: float) -> bool:
        """Sleep, and say whether it was ended. In slices: an event that is waited for may not be set by a signal."""
        end_s = time.monotonic() + seconds
        while not self._stopped.is_set():
            rest_s = end_s - time.monotonic()
            if rest_s <= 0:
                return False
            time.sleep(min(rest_s, POLL_S))
        return True

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None


class Pace:
    """When the next frame is due, and whether they come as often as wanted. Times are of a clock that never turns back.

    Args:
        rate_hz: frames a second that are wanted.
    """

    def __init__(self, rate_hz: float) -> None:
        self.period_s = 1.0 / rate_hz
        self._due_s: float | None = None
        self._start_s = 0.0  # when the first frame of this window was there
        self._asking_s = 0.0  # of this window, spent on the simulator
        self._frames = 0  # of this window
        self._said = False

    def wait_s(self, now_s: float) -> float:
        """How long to wait for the next frame; a frame that was missed is not made up for."""
        if self._due_s is None:
            self._due_s = now_s
        wait_s = max(self._due_s - now_s, 0.0)
        self._due_s = max(self._due_s, now_s) + self.period_s
        return wait_s

    def took(self, asked_s: float, there_s: float) -> str:
        """Note a frame; returns a line for people when frames have become too slow, else an empty text."""
        if self._frames == 0:
            self._start_s, self._asking_s = there_s, 0.0
        else:
            self._asking_s += there_s - asked_s
        self._frames += 1
        if self._frames <= WINDOW:
            return ""
        each_s, asking_s = (there_s - self._start_s) / WINDOW, self._asking_s / WINDOW
        self._frames = 0
        was_said, self._said = self._said, each_s > SLOW * self.period_s
        if was_said or not self._said:
            return ""
        return (
            f"frames come at {1 / each_s:.2g} a second, more slowly than the {1 / self.period_s:g} asked for: "
            f"the simulator takes {asking_s:.2g} s for one, the rest {each_s - asking_s:.2g} s"
        )


def open_live(
    address: str,
    camera: str = "0",
    rate_hz: float = 5.0,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
) -> LiveSource:
    """A live source from airsim://HOST:PORT[/VEHICLE].

    Raises:
        RecordingError: a wrong address, nobody answers, or there is no such camera.
    """
    try:
        host, port, vehicle = parse_address(address)
    except ValueError as error:
        raise RecordingError(str(error)) from None
    return LiveSource(LiveConfig(host, port, vehicle, camera, rate_hz, deck_z_m, sea_z_m))
