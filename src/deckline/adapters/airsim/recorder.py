"""startRecording, stopRecording: frames at an interval into a folder of their own."""

import asyncio
from collections.abc import Awaitable, Callable
from datetime import datetime
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from deckline.adapters.airsim.settings import Settings
from deckline.recording import RecordingWriter
from deckline.types import Frame

MOVED = 1e-9  # change of any number of a pose that counts as a move


class Recorder:
    """Records while it is on. All methods belong to the event loop.

    Args:
        out: each recording becomes a folder in it, named by date and time.
        settings: interval, camera, whether only moves count.
        take: gives the frame of now.
        scene: free keys of scene.json.
        log: gets a line when a recording begins and ends.
    """

    def __init__(
        self,
        out: Path,
        settings: Settings,
        take: Callable[[], Awaitable[Frame]],
        scene: dict[str, object],
        log: Callable[[str], None],
    ) -> None:
        self._out, self._settings, self._take, self._scene, self._log = out, settings, take, scene, log
        self._task: asyncio.Task[None] | None = None
        self._stop = asyncio.Event()

    @property
    def on(self) -> bool:
        """Whether it records."""
        return self._task is not None and not self._task.done()

    async def start(self) -> None:
        """Begin a recording; nothing when one is on.

        Raises:
            ValueError: the folder cannot be written.
        """
        if self.on:
            return
        writer = await asyncio.to_thread(self._open)
        self._stop = asyncio.Event()
        self._task = asyncio.create_task(self._record(writer))

    async def stop(self) -> None:
        """End the recording; when this returns, its files are whole."""
        self._stop.set()
        if self._task is not None:
            await self._task
            self._task = None

    def _open(self) -> RecordingWriter:
        stamp = datetime.now().strftime("%Y-%m-%d-%H-%M-%S")
        folder, again = self._out / stamp, 1
        while folder.exists():
            folder, again = self._out / f"{stamp}-{again + 1}", again + 1
        return RecordingWriter(
            folder, scene=self._scene, vehicle=self._settings.vehicle, camera_name=self._settings.recorded
        )

    async def _record(self, writer: RecordingWriter) -> None:
        loop, last = asyncio.get_running_loop(), None
        self._log(f"recording into {writer.out}")
        try:
            with writer:
                while not self._stop.is_set():
                    due = loop.time() + self._settings.interval_s
                    frame = await self._take()
                    if not self._settings.on_move or last is None or moved(last, frame):
                        await asyncio.to_thread(writer.add, frame)
                        last = frame
                    await self._pause(due - loop.time())
        except (ValueError, OSError) as error:
            self._log(f"recording into {writer.out} ended: {' '.join(str(error).split())}")
        else:
            self._log(f"recorded {writer.count} frames into {writer.out}")

    async def _pause(self, seconds: float) -> None:
        """Wait until the next frame is due or the recording ends."""
        try:
            await asyncio.wait_for(self._stop.wait(), max(seconds, 0.0))
        except TimeoutError:
            return


def moved(before: Frame, now: Frame) -> bool:
    """Whether the vehicle is elsewhere."""
    a, b = before.world_from_body, now.world_from_body
    if a is None or b is None:
        return True
    step: RigidTransform = a.inv() * b
    return bool(abs(step.translation).max() > MOVED or step.rotation.magnitude() > MOVED)
