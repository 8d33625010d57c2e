"""Which topics of a bag are pictures, camera, poses and depth, and what they hold besides pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from posixpath import dirname
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from deckline.config import Navigation
from deckline.recording.bag import Bag, MessageReader, Topic, deserialize, open_reader, refuse
from deckline.recording.camera_file import (
    OF_OPTION,
    STATED,
    MountedCamera,
    make_pinhole,
    note_assumed,
    note_camera,
)
from deckline.recording.pose_track import PoseTrack, join_tracks, make_track
from deckline.recording.read_options import ReadOptions
from deckline.recording.ros_messages import (
    BODY,
    TransformTree,
    camera_from_info,
    decode_depth,
    decode_picture,
    is_depth,
    is_rectified,
    read_attitude,
    read_fix,
    read_mount,
    read_pose,
    read_time,
    turn_track,
)
from deckline.recording.source import RecordingError

PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
INFOS = ("sensor_msgs/msg/CameraInfo",)
POSES = ("nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
TREES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FIXES, ATTITUDES = ("sensor_msgs/msg/NavSatFix",), ("sensor_msgs/msg/Imu",)
READ = (*PICTURES, *INFOS, *POSES, *TREES, *FIXES, *ATTITUDES)
STATIC = "tf_static"
GUIDANCE = "/deckline/pose"  # of our own: relative to the deck, no pose in the world
CHOOSE = "choose with --topic"


@dataclass(eq=False)
class BagContents:
    """What the scan of a bag found, by topic; times are those of the headers, s."""

    log_ns: dict[str, list[int]] = field(default_factory=dict)
    times_s: dict[str, list[float]] = field(default_factory=dict)
    rows: dict[str, list[list[float]]] = field(default_factory=dict)  # of poses, attitudes and fixes
    frames: dict[str, str] = field(default_factory=dict)  # of the headers of the first ones
    tree: TransformTree = field(default_factory=TransformTree)
    notes: list[str] = field(default_factory=list)


class TopicSelector:
    """The topics of a bag and those that somebody named.

    Raises:
        RecordingError: a named topic that is not there or is not read.
    """

    def __init__(self, path: Path, reader: Any, names: Sequence[str]) -> None:
        self.path, self._reader = path, reader
        counted = {name: info for name, info in reader.topics.items() if info.msgcount and info.connections}
        self.topics = {
            name: Topic(name, info.connections[0].msgtype, tuple(info.connections)) for name, info in counted.items()
        }
        for name in names:
            if name not in self.topics:
                self.fail(f"no messages of the topic {name}; there are {self._list(self.topics.values())}")
            if self.topics[name].kind not in READ:
                self.fail(f"{self.topics[name]} is not read; types that are: {', '.join(READ)}")
        self._named = [self.topics[name] for name in names]

    def fail(self, reason: str) -> NoReturn:
        raise RecordingError(f"{self.path}: {reason}")

    def of(self, kinds: Sequence[str]) -> list[Topic]:
        """The named topics of these types, else all of them."""
        named = [topic for topic in self._named if topic.kind in kinds]
        return named or [topic for topic in self.topics.values() if topic.kind in kinds]

    def is_named(self, topic: Topic) -> bool:
        return topic in self._named

    def one(self, topics: Sequence[Topic], what: str) -> Topic | None:
        """The only one of these."""
        if len(topics) > 1:
            self.fail(f"{len(topics)} topics with {what}: {self._list(topics)}; {CHOOSE}")
        return topics[0] if topics else None

    def first(self, topic: Topic) -> Any:
        """The first message of a topic."""
        with refuse(lambda reason: RecordingError(f"{self.path}: {topic}: damaged: {reason}")):
            connection, _, data = next(self._reader.messages(topic.connections))
            return deserialize(self._reader, connection, data)

    def pictures(self) -> tuple[Topic, Topic | None, list[str]]:
        """The pictures, the depth that belongs to them, and notes."""
        found = [topic for topic in self.topics.values() if topic.kind in PICTURES]
        depths = [topic for topic in found if is_depth(self.first(topic))]
        named = [topic for topic in found if self.is_named(topic)]
        seen = [topic for topic in named if topic not in depths] or [one for one in found if one not in depths]
        if (pictures := self.one(seen, "pictures")) is None:
            kinds = " or ".join(PICTURES)
            self.fail(f"zero frames: no pictures ({kinds}) in {self._list(self.topics.values()) or 'it'}")
        first = self.first(pictures)
        with refuse(lambda reason: RecordingError(f"{self.path}: {pictures}: {reason}")):
            shape = decode_picture(first).shape[:2]
        if named_depths := [topic for topic in depths if topic in named]:
            depth = self.one(named_depths, "depth")
            with refuse(lambda reason: RecordingError(f"{self.path}: {depth}: {reason}")):
                decode_depth(self.first(named_depths[0]))
            return pictures, depth, []
        fitting = [topic for topic in depths if self._fits(topic, first.header.frame_id, shape)]
        if len(fitting) == 1:
            return pictures, fitting[0], []
        why = "each fits the pictures: name one with --topic" if fitting else "compressed, or of another size or frame"
        return pictures, None, [f"{self.path}: depth left out: {self._list(depths)}: {why}"] if depths else []

    def _fits(self, topic: Topic, frame: str, shape: tuple[int, ...]) -> bool:
        message = self.first(topic)
        is_plain = hasattr(message, "encoding") and (message.height, message.width) == shape
        return is_plain and message.header.frame_id == frame

    def info(self, pictures: Topic, frame: str) -> Topic | None:
        """The camera_info of pictures: named, beside them, or of their frame."""
        infos = self.of(INFOS)
        folders = (dirname(pictures.name), dirname(dirname(pictures.name)))  # the latter of <topic>/compressed
        beside = [topic for topic in infos if topic.name in [f"{folder}/camera_info" for folder in folders]]
        if beside and not self.is_named(infos[0]):
            return beside[0]
        same = [topic for topic in infos if self.is_named(topic) or self.first(topic).header.frame_id == frame]
        return self.one(same, "camera_info")

    def poses(self) -> list[Topic]:
        """The topic of poses; or those of transforms; or a fix and an attitude; or none."""
        named = [topic for topic in self._named if topic.kind in (*POSES, *TREES, *FIXES)]
        pool = named or [topic for topic in self.topics.values() if topic.name != GUIDANCE]
        poses = self.one([topic for topic in pool if topic.kind in POSES], "poses")
        if poses is not None:
            return [poses]
        if trees := [topic for topic in pool if topic.kind in TREES and not topic.name.endswith(STATIC)]:
            return trees
        fix = self.one([topic for topic in pool if topic.kind in FIXES], "fixes")
        attitude = None if fix is None else self.one(self.of(ATTITUDES), "attitudes")
        return [] if fix is None or attitude is None else [fix, attitude]

    def trees(self) -> list[Topic]:
        return [topic for topic in self.topics.values() if topic.kind in TREES]

    def _list(self, topics: Any) -> str:
        return ", ".join(map(str, topics))


def scan(path: Path, reader: Any, topics: Sequence[Topic]) -> BagContents:
    """Read all of a bag once: times of pictures, poses and transforms."""
    found, kinds = BagContents(), {topic.name: topic.kind for topic in topics}
    readers = dict.fromkeys(POSES, read_pose) | dict.fromkeys(FIXES, read_fix) | dict.fromkeys(ATTITUDES, read_attitude)
    last_ns = 0
    try:
        with refuse(RecordingError):
            connections = [connection for topic in topics for connection in topic.connections]
            for connection, log_ns, data in reader.messages(connections):
                message, name, last_ns = deserialize(reader, connection, data), connection.topic, log_ns
                if kinds[name] in TREES:
                    found.tree.add(message, name.endswith(STATIC))
                    continue
                found.log_ns.setdefault(name, []).append(log_ns)
                found.times_s.setdefault(name, []).append(read_time(message) or 1e-9 * log_ns)
                if kinds[name] in readers:
                    found.frames.setdefault(name, message.header.frame_id)
                    found.rows.setdefault(name, []).append(readers[kinds[name]](message))
    except RecordingError as error:
        found.notes.append(f"{path}: reading breaks off at {1e-9 * last_ns:.3f} s: {error}")
    return found


def open_bag(
    path: Path,
    names: Sequence[str],
    options: ReadOptions,
    track: PoseTrack | None,
    navigation: Navigation,
) -> Bag:
    """A bag as a recording.

    Args:
        path: MCAP, SQLite or ROS 1 file, or a ROS 2 bag's folder.
        names: topics that are preferred to others of their kind.
        options: camera, else as camera_info and transforms state; heights of deck and sea; field of view without them.
        track: None: the bag's own poses.
        navigation: how poses are placed on pictures.

    Raises:
        RecordingError: no bag, no pictures, or several topics that may be meant.
        ImportError: the extra `ros` is not installed.
    """
    reader, notes = open_reader(path)
    chooser = TopicSelector(path, reader, names)
    pictures, depth, depth_notes = chooser.pictures()
    frame = chooser.first(pictures).header.frame_id
    sources = [] if track is not None else chooser.poses()
    chosen = dict.fromkeys([pictures, *([depth] if depth else []), *sources, *chooser.trees()])
    found = scan(path, reader, list(chosen))
    notes += [*depth_notes, *found.notes]
    body = _body_of(chooser, sources, found.tree, frame)
    mounted, origin = _find_camera(chooser, pictures, frame, options)
    mount: PoseTrack | RigidTransform | None = None
    if mounted is None:
        notes.append(note_assumed(str(path), origin, "give --camera FILE"))
    elif options.camera is None:
        mount = read_mount(found.tree, frame, body, f"{path}: mount", navigation)
        if mount is None:
            notes.append(f"{path}: no transform from {body} to {frame!r}: the camera is taken to point forward")
        elif isinstance(mount, RigidTransform):
            mounted, mount = replace(mounted, body_from_camera=mount), None
    track = track if track is not None else _read_track(path, sources, found, body, navigation)
    times = np.array(found.times_s[pictures.name])
    no_poses = (f"{path}: no poses: the pictures alone say where the aircraft is",)
    notes += no_poses if track is None else track.notes_on(times)
    if mounted is not None:
        notes.append(note_camera(str(path), mounted.camera, origin, options.fov_deg))
        mounted = mounted.at(options.deck_z_m, options.sea_z_m)
    readers = {topic.name: _message_reader(path, topic, found) for topic in (pictures, depth) if topic}
    source = Bag(path, readers[pictures.name], mounted, mount, track, None if depth is None else readers[depth.name])
    used = f"pictures {pictures.name}" + "".join(f", poses {topic.name}" for topic in sources if track)
    source.notes = (f"{path}: {used}" + (f", depth {depth.name}" if depth else ""), *notes)
    return source


def _find_camera(
    chooser: TopicSelector, pictures: Topic, frame: str, options: ReadOptions
) -> tuple[MountedCamera | None, str]:
    """The camera: given, of camera_info, or of the stated field of view; and where it is from, or why there is none."""
    if options.camera is not None:
        return options.camera, OF_OPTION
    why = "no camera_info"
    if (info := chooser.info(pictures, frame)) is not None:
        where, why = f"{chooser.path}: {info.name}", f"{info.name} is not calibrated"
        mounted = camera_from_info(chooser.first(info), is_rectified(pictures.name), where)
        if mounted is not None:
            return mounted, f"of {info.name}"
    if options.fov_deg is None:
        return None, why
    height, width = decode_picture(chooser.first(pictures)).shape[:2]
    return make_pinhole(width, height, options.fov_deg), STATED


def _message_reader(path: Path, topic: Topic, found: BagContents) -> tuple[MessageReader, NDArray[np.float64]]:
    return MessageReader(path, topic, np.array(found.log_ns[topic.name])), np.array(found.times_s[topic.name])


def _body_of(chooser: TopicSelector, sources: Sequence[Topic], tree: TransformTree, frame: str) -> str:
    """The body's frame: an odometry's child, else base_link, else the frame above the camera that moves."""
    if sources and sources[0].kind == POSES[0]:
        return str(chooser.first(sources[0]).child_frame_id).lstrip("/") or BODY
    above = tree.path(frame)
    if BODY in above or (sources and sources[0].kind in POSES):
        return BODY
    return next((child for child in above[:-1] if tree.moves(child)), BODY)


def _read_track(
    path: Path, sources: Sequence[Topic], found: BagContents, body: str, navigation: Navigation
) -> PoseTrack | None:
    """The body's poses in our world."""
    if not sources:
        return None
    if sources[0].kind in TREES:
        above = found.tree.path(body)
        track = found.tree.resolve(above, f"{path}: transforms", navigation) if len(above) > 1 else None
        return turn_track(track, above[-1], body) if isinstance(track, PoseTrack) else None
    own_clock = navigation if len(sources) == 1 else replace(navigation, offset_s=0.0)
    tracks = []
    for topic in sources:
        rows = np.array(found.rows.get(topic.name, [])).reshape(-1, 7)
        times = found.times_s.get(topic.name, [])
        tracks.append(make_track(f"{path}: {topic.name}", times, rows[:, :3], rows[:, 3:], own_clock))
    if len(sources) == 1:
        world = found.frames[sources[0].name]
        is_odometry = sources[0].kind == POSES[0]  # only they name their body
        return turn_track(tracks[0], world, body if is_odometry or not world.endswith("ned") else "frd")
    return join_tracks(turn_track(tracks[1], "", found.frames[sources[1].name]), tracks[0], True, navigation)
