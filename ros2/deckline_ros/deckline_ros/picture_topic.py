"""The newest picture of a subscription as a live source."""

import time
from collections.abc import Iterator
from typing import Any

from scipy.spatial.transform import RigidTransform

from deckline.live.mailbox import Mailbox
from deckline.live.pipeline import WAIT_S
from deckline.live.poses import FUTURE_S
from deckline.live.source import Captured, LiveSource
from deckline.recording import BadFrame
from deckline.recording.camera_file import MountedCamera
from deckline.recording.ros_messages import decode_picture, read_time
from deckline.types import Frame

NAME = "ros2"  # of the source and its frames


class PictureTopic(LiveSource):
    """Frames of pictures that `put` takes; a newer one replaces one that waits."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self._mailbox: Mailbox[tuple[Any, float, MountedCamera | None, RigidTransform | None] | BadFrame] = Mailbox()

    def put(self, message: Any, age_s: float, camera: MountedCamera | None, mount: RigidTransform | None) -> None:
        """Take a picture; one from the future is refused, for its age is not known.

        Args:
            message: Image or CompressedImage.
            age_s: since its capture, s; negative: its time is ahead of the clock.
            camera: None: not known, and the lines are found in pixels alone.
            mount: body_from_camera; None: not known, and pictures of a known camera are refused.
        """
        if age_s < -FUTURE_S:
            return self._mailbox.put(BadFrame(NAME, f"a picture from {-age_s:.3f} s in the future; set the clocks"))
        self._mailbox.put((message, time.monotonic() - max(age_s, 0.0), camera, mount))

    def captures(self) -> Iterator[Captured | BadFrame]:
        while not self.stopped.is_set():
            if (taken := self._mailbox.take(WAIT_S)) is not None:
                yield taken if isinstance(taken, BadFrame) else self._capture(*taken)

    def _capture(
        self, message: Any, at_s: float, camera: MountedCamera | None, mount: RigidTransform | None
    ) -> Captured | BadFrame:
        try:
            image, time_s = decode_picture(message), read_time(message)
            if camera is None:
                return Captured(Frame(NAME, time_s, image), at_s)
            if mount is None:
                raise ValueError(f"/tf_static has no transform from the body to {message.header.frame_id!r}")
            mounted = camera.fit(image.shape[1], image.shape[0])
            return Captured(mounted.frame(NAME, time_s, image, body_from_camera=mount), at_s)
        except ValueError as error:
            return BadFrame(NAME, str(error))
