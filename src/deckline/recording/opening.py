"""open_recording: from a path to frames; folders of images, with camera.toml, poses.csv and depth/<stem>.pfm."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from deckline.recording.airsim import RECORD_FILE, AirSimRecording, ReadOptions
from deckline.recording.camera_file import CAMERA_FILE, EXAMPLE, MountedCamera, make_plain_frame, read_camera_file
from deckline.recording.images import DEPTH_PLANAR, FAR_DEPTH_M, IMAGE_SUFFIXES, PfmRows, read_depth, read_image
from deckline.recording.poses import POSES_FILE, Poses, read_poses
from deckline.recording.source import BadFrame, FrameError, RecordingError, Source, check_index, is_inside
from deckline.recording.video import Video, count_frames
from deckline.types import Frame

DEPTH_FOLDER = "depth"  # PFM files, metres along the optical axis


class ImageFolder(Source):
    """Images in natural order of their names. Without poses.csv they are taken to be one second apart.

    Args:
        mounted: None: no camera file, and images of any sizes.
        files: names of images in the folder; None: all that are there or have a row in `poses`.

    Attributes:
        files: names of the images, in order.
    """

    def __init__(
        self,
        folder: Path,
        mounted: MountedCamera | None,
        poses: Poses | None,
        options: ReadOptions,
        files: Sequence[str] | None = None,
    ) -> None:
        self.folder = folder
        self.name = str(folder if files is None else folder / files[0])
        self._mounted = mounted
        self._poses = poses
        self._depth_options = (DEPTH_PLANAR, options.pfm_rows, options.far_m)
        found = {*list_images(folder), *(poses.rows if poses else ())} if files is None else files
        self.files = sorted(found, key=make_natural_key)
        no_poses = (f"{folder}: no poses.csv: no positions, and the images are taken to be 1 s apart",)
        self.notes = poses.notes if poses else no_poses

    def __len__(self) -> int:
        return len(self.files)

    def load(self, index: int) -> Frame:
        check_index(index, len(self), self.name)
        file = self.files[index]
        try:
            return self._frame(index, file)
        except ValueError as error:
            raise FrameError(file, str(error)) from None

    def _frame(self, index: int, file: str) -> Frame:
        if not is_inside(file):
            raise ValueError("poses.csv must name files inside the folder")
        time_s, world_from_body = (float(index), None) if self._poses is None else self._poses.at(file)
        image = read_image(self.folder / file)
        if self._mounted is None:
            return make_plain_frame(file, time_s, image)
        depth, name = None, f"{DEPTH_FOLDER}/{Path(file).stem}.pfm"
        if (self.folder / name).exists():
            depth = read_depth(self.folder / name, name, self._mounted.camera, *self._depth_options)
        return self._mounted.frame(file, time_s, image, world_from_body=world_from_body, depth_m=depth)


def list_images(folder: Path) -> list[str]:
    """Names of the image files right in a folder; hidden ones are left out."""
    return [
        child.name
        for child in folder.iterdir()
        if child.suffix.lower() in IMAGE_SUFFIXES and not child.name.startswith(".") and child.is_file()
    ]


def make_natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sort key that puts frame_2 before frame_10."""
    parts = re.split(r"([0-9]+)", name.lower())
    return [*((1, int(part), "") if part.isdigit() else (0, 0, part) for part in parts), (0, 0, name)]


def open_recording(
    path: Path | str,
    *,
    camera_file: Path | str | None = None,
    poses_file: Path | str | None = None,
    fov_deg: float = 90.0,
    deck_z_m: float | None = None,
    sea_z_m: float | None = None,
    pfm_rows: PfmRows = "top-to-bottom",
    far_m: float = FAR_DEPTH_M,
    on_skip: Callable[[BadFrame], None] | None = None,
) -> Source:
    """Open a recording in AirSim's layout, a folder of images, a single image, or a video file.

    Args:
        path: folder with airsim_rec.txt, folder of images, image or video file.
        camera_file: camera.toml. When not given: an AirSim recording takes scene.json's camera, else camera.toml in
            its folder, else a pinhole of `fov_deg`; a folder takes its camera.toml; an image or video file takes
            <file>.camera.toml, else camera.toml beside it. Images and videos without one have lines in pixels only.
        poses_file: poses.csv of images or a video. When not given: poses.csv in the folder; <file>.poses.csv, else
            poses.csv beside the file, when it is there.
        fov_deg: horizontal field of view of an AirSim recording that has no camera; 90 is AirSim's default.
        deck_z_m: world z (down) of the deck plane; overrides what files say.
        sea_z_m: world z (down) of the water; overrides what files say.
        pfm_rows: order of the rows in PFM depth files; AirSim's is "top-to-bottom", the PFM definition's the other.
        far_m: depths stored at or beyond this mean "nothing seen"; the default is AirSim's half-precision limit.
        on_skip: takes each damaged frame while somebody iterates; None prints its file and the reason on stderr.

    Raises:
        RecordingError: the source cannot be opened; one line that says what, where, and how to mend it.
        ValueError: an option out of its range.
    """
    path = Path(path)
    camera = None if camera_file is None else read_camera_file(Path(camera_file))
    options = ReadOptions(fov_deg, camera, deck_z_m, sea_z_m, pfm_rows, far_m)
    if path.name == RECORD_FILE:
        path = path.parent
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if (path / RECORD_FILE).exists():
        if poses_file is not None:
            raise RecordingError(f"{path}: an AirSim recording has its poses in {RECORD_FILE}; leave {poses_file} out")
        fallback = read_camera_file(path / CAMERA_FILE) if (path / CAMERA_FILE).exists() else None
        source: Source = AirSimRecording(path, options, fallback)
    else:
        source = _open_images(path, poses_file, options)
    source.on_skip = on_skip
    return source


def _open_images(path: Path, poses_file: Path | str | None, options: ReadOptions) -> ImageFolder | Video:
    """A folder, a single image or a video, with the camera and the poses given or found beside them."""
    is_video = not path.is_dir() and path.suffix.lower() not in IMAGE_SUFFIXES
    frames = count_frames(path) if is_video else 0
    if path.is_dir() and not list_images(path):
        inside = next((child for child in sorted(path.iterdir()) if (child / RECORD_FILE).exists()), None)
        hint = f"; did you mean {inside}/?" if inside else ""
        places = f"neither {RECORD_FILE} nor images ({' '.join(IMAGE_SUFFIXES)}) in this folder"
        raise RecordingError(f"{path}: zero frames: {places}{hint}")
    mounted = options.camera
    if mounted is None and (camera_file := _find(path, CAMERA_FILE)) is not None:
        mounted = read_camera_file(camera_file)
    mounted = mounted and mounted.at(options.deck_z_m, options.sea_z_m)
    poses_file = poses_file or _find(path, POSES_FILE)
    poses = None if poses_file is None else read_poses(Path(poses_file), is_video)
    folder, files = (path, None) if path.is_dir() else (path.parent, [path.name])
    source: ImageFolder | Video = (
        Video(path, mounted, poses, frames) if is_video else ImageFolder(folder, mounted, poses, options, files)
    )
    if mounted is None:
        place = _list_places(path, CAMERA_FILE)[-1]
        source.notes = (f"{path}: no camera file: lines in pixels, no metres; for these write {place}: {EXAMPLE}",)
    return source


def _list_places(path: Path, name: str) -> list[Path]:
    """Where a camera or poses file of a source may lie."""
    return [path / name] if path.is_dir() else [path.with_name(f"{path.name}.{name}"), path.with_name(name)]


def _find(path: Path, name: str) -> Path | None:
    return next((place for place in _list_places(path, name) if place.exists()), None)
