"""What `deckline run`, `live` and `calibrate` ask about a source, once."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from deckline.config import RunConfig
from deckline.extras import needs_extra
from deckline.files import print_line
from deckline.live.clock import WallClock
from deckline.live.opening import open_camera
from deckline.live.source import StreamCamera
from deckline.live.tally import Log
from deckline.recording import Recording, open_recording
from deckline.recording.camera_file import (
    OF_OPTION,
    MountedCamera,
    check_fov,
    make_pinhole,
    note_assumed,
    note_camera,
    read_camera_file,
)
from deckline.recording.read_options import ReadOptions

if TYPE_CHECKING:
    from deckline.adapters.airsim.source import AirSimSource

SIMULATOR = "airsim:"  # how a simulator's address begins


@dataclass(frozen=True)
class SourceOptions:
    """What is known of a source.

    Args:
        fov_deg: horizontal field of view of a pinhole, without a camera file.
        camera: camera.toml, or YAML of OpenCV or ROS, when not beside the source; of a simulator the camera's name.
        origin: of the world, degrees and metres, for poses that have these; their first position when not given.
        deck_z_m: world z (down, metres) of the deck plane, for ranges beyond the depth camera.
        sea_z_m: world z (down, metres) of the water, for dehazing (20 m below the deck when not given) and to notice a
            pitched camera.
        pose_offset_s: clock of the poses minus the pictures' (live: Unix time); 0.
        max_pose_gap_s: between two poses, beyond which pictures have no pose (0.5).
        topic: of a ROS bag, where several are there.
    """

    fov_deg: float | None = None
    camera: str | None = None
    origin: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="LAT LON ALT")] = None
    deck_z_m: float | None = None
    sea_z_m: float | None = None
    pose_offset_s: float | None = None
    max_pose_gap_s: float | None = None
    topic: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ()

    def place_poses(self, config: RunConfig) -> RunConfig:
        """The configuration with what is stated here of the poses."""
        stated = {"offset_s": self.pose_offset_s, "max_gap_s": self.max_pose_gap_s, "origin": self.origin}
        navigation: Any = {name: value for name, value in stated.items() if value is not None}
        return replace(config, navigation=replace(config.navigation, **navigation))

    def open_recording(self, path: str, config: RunConfig, poses: str | None) -> Recording:
        """A recording, a folder of images, a video or a bag.

        Raises:
            ValueError: it cannot be opened.
        """
        return open_recording(
            path,
            camera_file=self.camera,
            poses_file=None if poses is None else Path(poses),
            fov_deg=self.fov_deg,
            deck_z_m=self.deck_z_m,
            sea_z_m=self.sea_z_m,
            navigation=config.navigation,
            topics=self.topic,
        )

    def open_stream(
        self, address: str, wall: WallClock, latency_s: float, rate_hz: float, log: Log = print_line
    ) -> StreamCamera:
        """A camera or a stream.

        Raises:
            ValueError: no such address, no such camera file, or one that contradicts the field of view.
        """
        fov_deg = ReadOptions(self.fov_deg).fov_deg  # within its range
        mounted, pinhole = None, None
        if self.camera is not None:
            mounted = read_camera_file(Path(self.camera)).at(self.deck_z_m, self.sea_z_m)
            check_fov(mounted.camera, fov_deg, self.camera)
        elif fov_deg is not None:

            def pinhole(width: int, height: int) -> MountedCamera:
                return make_pinhole(width, height, fov_deg).at(self.deck_z_m, self.sea_z_m)

        stream = open_camera(address, mounted, wall, latency_s, rate_hz, log, pinhole)
        if mounted is not None:
            stream.notes += (note_camera(stream.name, mounted.camera, OF_OPTION),)
        elif fov_deg is None:
            stream.notes += (note_assumed(stream.name, "no camera file", "give --camera FILE"),)
        return stream

    def open_simulator(self, address: str, rate_hz: float, poses: str | None, log: Log = print_line) -> "AirSimSource":
        """A simulator's camera.

        Raises:
            ValueError: poses or a field of view are stated, which it has itself, or nobody answers at the address.
        """
        if poses is not None:
            raise ValueError(f"{address}: a simulator gives the poses itself; leave {poses} out")
        if self.fov_deg is not None:
            raise ValueError(f"{address}: a simulator gives its field of view itself; leave --fov-deg out")
        with needs_extra("sim"):
            from deckline.adapters.airsim.source import AirSimSource
        return AirSimSource(address, self.camera or "0", rate_hz, self.deck_z_m, self.sea_z_m, log)
