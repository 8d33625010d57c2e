"""A simulator that speaks AirSim's protocol, as a stream of frames."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

from deckline.adapters.airsim.client import (
    POLL_S,
    SCHEME,
    Connection,
    ConnectionLostError,
    StoppedError,
    get_images,
    parse_address,
)
from deckline.adapters.airsim.frames import (
    STILL_M,
    MountMeasurement,
    measure_mount,
    measure_still_mount,
    name_frame,
    read_frame,
    update_mount,
)
from deckline.recording import BadFrame, RecordingError, Stream
from deckline.types import Frame

FIRST_WAIT_S, LONGEST_WAIT_S = 0.25, 8.0  # between two tries to connect again; each wait doubles
SLOW = 1.25  # frames that take so many times the wanted period are slow
WINDOW = 10  # frames over which that is judged


def print_to_stderr(line: str) -> None:
    print(line, file=sys.stderr)


class LiveSource(Stream):
    """Frames of a simulator's camera until `stop`. A simulator that goes away is waited for.

    Args:
        address: airsim://HOST:PORT[/VEHICLE].
        camera: AirSim's name of it.
        rate_hz: frames a second, at most.
        deck_z_m, sea_z_m: world z (down) of the deck plane and of the water.
        log: gets a line when the simulator goes away, comes back, or is too slow.

    Raises:
        RecordingError: a wrong address or rate, nobody answers, or there is no such camera.
    """

    def __init__(
        self,
        address: str,
        camera: str = "0",
        rate_hz: float = 5.0,
        deck_z_m: float | None = None,
        sea_z_m: float | None = None,
        log: Callable[[str], None] = print_to_stderr,
    ) -> None:
        if not 0.0 < rate_hz <= 1000.0:
            raise RecordingError(f"rate must lie between 0 and 1000 frames a second, got {rate_hz}")
        try:
            self._host, self._port, self._vehicle = parse_address(address)
        except ValueError as error:
            raise RecordingError(str(error)) from None
        vehicle = f"/{self._vehicle}" if self._vehicle else ""
        self.name = f"{SCHEME}://{self._host}:{self._port}{vehicle} camera {camera}"
        self._camera, self._rate_hz, self._heights = camera, rate_hz, (deck_z_m, sea_z_m)
        self._log = log
        self._stopped = threading.Event()
        self._connection: Connection | None = None
        try:
            first = self._connect()
        except ConnectionLostError as error:
            raise RecordingError(f"{error}; start the simulator, or deckline sim --serve, and try again") from None
        except ValueError as error:
            raise RecordingError(f"{self.name}: {error}") from None
        self._hang_up()  # the frames may be asked for much later
        self._mount = first.body_from_camera
        if first.motion_m > STILL_M:
            self.notes = (
                f"the vehicle was moving: where the camera sits on it is known within {first.motion_m:.2g} m",
            )

    def stop(self) -> None:
        self._stopped.set()

    def items(self) -> Iterator[Frame | BadFrame]:
        pace = Pace(self._rate_hz)
        try:
            while not self._wait_for_stop(pace.next_wait(time.monotonic())):
                start_s = time.monotonic()
                try:
                    item = self._take_frame()
                except ConnectionLostError as error:
                    self._connect_again(error)
                    pace = Pace(self._rate_hz)
                    continue
                if slow := pace.count_frame(start_s, time.monotonic()):
                    self._log(slow)
                yield item
        except StoppedError:
            return
        finally:
            self._hang_up()

    def _take_frame(self) -> Frame | BadFrame:
        """One frame. Raises ConnectionLostError or StoppedError."""
        if self._connection is None:
            self._connection = Connection(self._host, self._port, self._stopped)
        name = self._camera
        try:
            scene, depth = get_images(self._connection, self._camera, self._vehicle)
            name = name_frame(self._camera, scene)
            measured = measure_mount(self._connection, self._camera, self._vehicle)
            self._mount = update_mount(self._mount, measured)
            return read_frame(name, scene, depth, self._mount, measured.fov_rad, *self._heights)
        except ValueError as error:
            return BadFrame(name, str(error))

    def _connect(self) -> MountMeasurement:
        """Connect and measure the camera's mount. Raises ConnectionLostError, StoppedError or ValueError."""
        self._connection = Connection(self._host, self._port, self._stopped)
        try:
            first = measure_still_mount(self._connection, self._camera, self._vehicle)
        except (ConnectionLostError, ValueError):
            self._hang_up()
            raise
        return first

    def _connect_again(self, error: ConnectionLostError) -> None:
        """Wait until the simulator is back and has the camera. Raises StoppedError."""
        self._hang_up()
        self._log(f"lost the simulator ({error}); waiting for it")
        wait_s = FIRST_WAIT_S
        while self._connection is None:
            if self._wait_for_stop(wait_s):
                raise StoppedError
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)
            with suppress(ConnectionLostError, ValueError):  # not there yet, or there and still loading
                self._mount = self._connect().body_from_camera
        self._log("the simulator is back")

    def _wait_for_stop(self, seconds: float) -> bool:
        """Sleep; whether `stop` ended it. In slices: a signal handler may not set an event that is waited for."""
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
    """When the next frame is due, and whether they come as often as wanted. Times are of a monotonic clock.

    Args:
        rate_hz: frames a second that are wanted.
    """

    def __init__(self, rate_hz: float) -> None:
        self.period_s = 1.0 / rate_hz
        self._due_s: float | None = None
        self._start_s = 0.0  # when the first frame of this window was there
        self._busy_s = 0.0  # of this window, spent on the simulator
        self._frames = 0  # of this window
        self._is_slow = False

    def next_wait(self, now_s: float) -> float:
        """Seconds to wait for the next frame; a missed frame is not made up for."""
        if self._due_s is None:
            self._due_s = now_s
        wait_s = max(self._due_s - now_s, 0.0)
        self._due_s = max(self._due_s, now_s) + self.period_s
        return wait_s

    def count_frame(self, start_s: float, end_s: float) -> str:
        """Count a frame; returns a line for people when frames have become too slow, else an empty text."""
        if self._frames == 0:
            self._start_s, self._busy_s = end_s, 0.0
        else:
            self._busy_s += end_s - start_s
        self._frames += 1
        if self._frames <= WINDOW:
            return ""
        each_s, busy_s = (end_s - self._start_s) / WINDOW, self._busy_s / WINDOW
        self._frames = 0
        was_slow, self._is_slow = self._is_slow, each_s > SLOW * self.period_s
        if was_slow or not self._is_slow:
            return ""
        return (
            f"frames come at {1 / each_s:.2g} a second, more slowly than the {1 / self.period_s:g} asked for: "
            f"the simulator takes {busy_s:.2g} s for one, the rest {each_s - busy_s:.2g} s"
        )
