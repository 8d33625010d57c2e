"""From a path to frames: which layout it has, and the camera, the poses and the runway given or found beside it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deckline.config import Navigation
from deckline.files import is_there
from deckline.recording.airsim import RECORD_FILE, AirSimRecording
from deckline.recording.bag import is_bag
from deckline.recording.camera_file import (
    CAMERA_FILE,
    CAMERA_FILES,
    EXAMPLE,
    OF_OPTION,
    STATED,
    MountedCamera,
    make_pinhole,
    note_assumed,
    note_camera,
    read_camera_file,
)
from deckline.recording.exif import camera_from_exif
from deckline.recording.image_folder import ImageFolder, find_first_image, list_images
from deckline.recording.images import FAR_DEPTH_M, IMAGE_SUFFIXES, PfmRows
from deckline.recording.poses import POSES_FILE, TIMES_FILE, read_image_times, read_poses
from deckline.recording.read_options import ReadOptions
from deckline.recording.runway_file import RUNWAY_FILE, read_runway_file
from deckline.recording.source import BadFrame, Recording, RecordingError
from deckline.recording.text_table import TextTable
from deckline.recording.video import Video, scan_video

if TYPE_CHECKING:
    from deckline.recording.pose_track import PoseTrack

NAVIGATION = Navigation()


def open_recording(
    path: Path | str,
    *,
    camera_file: Path | str | None = None,
    poses_file: Path | str | None = None,
    fov_deg: float | None = None,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    pfm_rows: PfmRows = "top-to-bottom",
    far_m: float = FAR_DEPTH_M,
    navigation: Navigation = NAVIGATION,
    topics: Sequence[str] = (),
    on_skip: Callable[[BadFrame], None] | None = None,
) -> Recording:
    """Open a recording in AirSim's layout, a folder of images, a single image, a video file, or a ROS bag.

    runway.toml in the folder (of a file <file>.runway.toml, else runway.toml beside it) states what is known of the
    deck, and becomes `base_config` of the source; see `recording.runway_file`.

    Args:
        path: folder with airsim_rec.txt, folder of images, image or video file; .mcap, .db3 or .bag file, or folder of
            a ROS 2 bag.
        camera_file: camera.toml, or a YAML calibration of OpenCV or ROS. When not given: an AirSim recording takes
            scene.json's camera, else camera.toml in its folder; a folder takes its camera.toml, else camera.yaml; an
            image or video file takes <file>.camera.toml (.yaml), else camera.toml (.yaml) beside it; a bag takes its
            camera_info and transforms. Without any, `fov_deg` counts, else the EXIF of each picture.
        poses_file: poses.csv of images or a video, or an autopilot's log (.bin, .tlog, .ulg). When not given: poses.csv
            in the folder; <file>.poses.csv, else poses.csv beside the file, when it is there.
        fov_deg: horizontal field of view where nothing else states the camera: a pinhole along the body's forward
            axis. None: 90, AirSim's default, for AirSim recordings; others have lines in pixels only.
        deck_z_m: world z (down) of the deck plane; overrides what files state.
        sea_z_m: world z (down) of the water; overrides what files state.
        pfm_rows: order of the rows in PFM depth files; AirSim's is "top-to-bottom", the PFM definition's the other.
        far_m: depths stored at or beyond this mean "nothing seen"; the default is AirSim's half-precision limit.
        navigation: how poses that go by time are placed on pictures.
        topics: of a bag, those that are preferred to others of their kind.
        on_skip: takes each damaged frame while somebody iterates; None prints its file and the reason on stderr.

    Raises:
        RecordingError: the source cannot be opened; one line with the file, the reason and the remedy.
        ValueError: an option out of its range.
    """
    path = Path(path)
    camera = None if camera_file is None else read_camera_file(Path(camera_file))
    options = ReadOptions(fov_deg, camera, deck_z_m, sea_z_m, pfm_rows, far_m)
    if path.name == RECORD_FILE:
        path = path.parent
    source = _open_layout(path, poses_file, options, navigation, topics)
    if (runway_file := _find(path, RUNWAY_FILE)) is not None:
        source.base_config, note = read_runway_file(runway_file)
        source.notes += (note,)
    source.on_skip = on_skip
    return source


def _open_layout(
    path: Path, poses_file: Path | str | None, options: ReadOptions, navigation: Navigation, topics: Sequence[str]
) -> Recording:
    """A recording of AirSim, a ROS bag, or images or a video."""
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if (path / RECORD_FILE).exists():
        if poses_file is not None:
            raise RecordingError(f"{path}: an AirSim recording has its poses in {RECORD_FILE}; leave {poses_file} out")
        fallback = read_camera_file(path / CAMERA_FILE) if is_there(path / CAMERA_FILE) else None
        return AirSimRecording(path, options, fallback)
    if is_bag(path) and not (path.is_dir() and list_images(path)):
        from deckline.recording.bag_topics import open_bag

        track = None if poses_file is None else _read_track(Path(poses_file), navigation)
        return open_bag(path, topics, options, track, navigation)
    if topics:
        raise RecordingError(f"{path}: not a ROS bag: it has no topics; leave {', '.join(topics)} out")
    return _open_images(path, poses_file, options, navigation)


def _open_images(
    path: Path, poses_file: Path | str | None, options: ReadOptions, navigation: Navigation
) -> ImageFolder | Video:
    """A folder, a single image or a video, with the camera and the poses given or found beside them."""
    if path.is_dir() and not list_images(path):
        inside = next((child for child in sorted(path.iterdir()) if (child / RECORD_FILE).exists()), None)
        hint = f"; did you mean {inside}/?" if inside else ""
        places = f"neither {RECORD_FILE} nor images ({' '.join(IMAGE_SUFFIXES)}) in this folder"
        raise RecordingError(f"{path}: zero frames: {places}{hint}")
    packets = None if path.is_dir() or path.suffix.lower() in IMAGE_SUFFIXES else scan_video(path)
    picture, size = find_first_image(path) if packets is None else (None, packets.size)
    mounted, notes = _find_camera(path, picture, size, options, None if packets is None else packets.stored_size)
    poses_file = None if (found := poses_file or _find(path, POSES_FILE)) is None else Path(found)
    if packets is not None:
        track = None if poses_file is None else _read_track(poses_file, navigation, packets.times_s)
        source: ImageFolder | Video = Video(packets, mounted, track)
    else:
        source = _open_folder(path, mounted, poses_file, options, navigation)
    source.notes += notes
    return source


def _find_camera(
    path: Path,
    picture: Path | None,
    size: tuple[int, int] | None,
    options: ReadOptions,
    stored_size: tuple[int, int] | None = None,
) -> tuple[MountedCamera | None, tuple[str, ...]]:
    """The camera of pictures: given, beside them, or a pinhole of the stated field of view; and notes on it.

    Args:
        picture: its first one that can be read; None: none, or a video.
        size: width and height of its first picture, px; None: none can be read.
        options: the caller's.
        stored_size: the same with pixels that may not be square, for which intrinsics may be, px.

    Raises:
        RecordingError: a camera file of another shape, or one that contradicts the stated field of view.
    """
    mounted, origin = options.camera, OF_OPTION
    if mounted is None and (camera_file := _find(path, *CAMERA_FILES)) is not None:
        mounted, origin = read_camera_file(camera_file), f"of {camera_file.name}"
    if mounted is not None:
        mounted = mounted if size is None or stored_size is None else mounted.for_square_pixels(size, stored_size)
        note = note_camera(str(path), mounted.camera, origin, options.fov_deg)
        notes = (note, *_note_scaling(path, mounted, size))
    elif options.fov_deg is not None and size is not None:
        mounted = make_pinhole(*size, options.fov_deg)
        notes = (note_camera(str(path), mounted.camera, STATED),)
    else:
        notes = (_note_unstated(path, picture, size),)
    return mounted and mounted.at(options.deck_z_m, options.sea_z_m), notes


def _note_unstated(path: Path, picture: Path | None, size: tuple[int, int] | None) -> str:
    """The note on a source whose camera nobody states: that of EXIF, which every picture may have, or none."""
    camera, origin = (None, "") if picture is None or size is None else camera_from_exif(picture, *size)
    if camera is not None:
        return note_camera(str(path), camera, origin)
    why = f"no camera file, and {origin}" if origin else "no camera file"
    return note_assumed(str(path), why, f"write {_list_places(path, CAMERA_FILE)[-1]}: {EXAMPLE}")


def _note_scaling(path: Path, mounted: MountedCamera, size: tuple[int, int] | None) -> tuple[str, ...]:
    """A note where intrinsics are scaled to the first picture's size; a RecordingError where its shape is another."""
    try:
        if size is None or (fitted := mounted.fit(*size)) is mounted:
            return ()
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    camera, scaled = mounted.camera, fitted.camera
    return (
        f"{path}: intrinsics for {camera.width}x{camera.height} px are scaled to the pictures' "
        f"{scaled.width}x{scaled.height} px, fx {camera.fx:.1f} to {scaled.fx:.1f} px",
    )


def _open_folder(
    path: Path, mounted: MountedCamera | None, poses_file: Path | None, options: ReadOptions, navigation: Navigation
) -> ImageFolder:
    """A folder or a single image; poses go by file where poses.csv names files, else by the times of times.csv."""
    folder, files = (path, None) if path.is_dir() else (path.parent, [path.name])
    times_file = folder / TIMES_FILE
    table = None if poses_file is None or _is_log(poses_file) else TextTable(poses_file, ",")
    if table is not None and "file" in table.header:
        return ImageFolder(folder, mounted, read_poses(table, navigation.origin), None, options, files)
    track = None if poses_file is None else _read_track(poses_file, navigation)
    if track is not None and not is_there(times_file):
        raise RecordingError(f"{poses_file} has poses by time; write {times_file} with the columns file,time_s")
    times = read_image_times(times_file) if is_there(times_file) else None
    return ImageFolder(folder, mounted, track, times, options, files)


def _is_log(path: Path) -> bool:
    from deckline.recording.logs import FORMATS

    return path.suffix.lower() in FORMATS


def _read_track(path: Path, navigation: Navigation, video_times_s: NDArray[np.float64] | None = None) -> "PoseTrack":
    from deckline.recording.logs import read_log_track
    from deckline.recording.pose_track import read_csv_track

    return read_log_track(path, navigation) if _is_log(path) else read_csv_track(path, navigation, video_times_s)


def _list_places(path: Path, name: str) -> list[Path]:
    """Where a camera or poses file of a source may lie."""
    return [path / name] if path.is_dir() else [path.with_name(f"{path.name}.{name}"), path.with_name(name)]


def _find(path: Path, *names: str) -> Path | None:
    """The first of these files that is there, those named after the source before those of its folder."""
    places = zip(*(_list_places(path, name) for name in names), strict=True)
    return next((place for row in places for place in row if is_there(place)), None)
