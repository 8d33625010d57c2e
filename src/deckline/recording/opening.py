"""open_recording: from a path to frames."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from deckline.recording.airsim import RECORD_FILE, AirSimOptions, AirSimRecording
from deckline.recording.camera_file import CAMERA_FILE, EXAMPLE, MountedCamera, read_camera_file
from deckline.recording.folder import ImageFolder, list_images
from deckline.recording.images import IMAGE_SUFFIXES
from deckline.recording.netpbm import FAR_DEPTH_M, PfmRows
from deckline.recording.poses_file import POSES_FILE, Poses, read_poses
from deckline.recording.scene import SCENE_FILE, read_scene
from deckline.recording.source import BadFrame, RecordingError, Source


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
    """Open a recording in AirSim's layout, a folder of images, or a video file.

    Args:
        path: folder with airsim_rec.txt, folder of images, or video file.
        camera_file: camera.toml. When not given: an AirSim recording takes scene.json's camera, else camera.toml in
            its folder, else a pinhole of `fov_deg`; a folder takes its camera.toml; a video <video>.camera.toml, else
            camera.toml beside it.
        poses_file: poses.csv of a folder or video. When not given: poses.csv in the folder; <video>.poses.csv, else
            poses.csv beside the video, when it is there.
        fov_deg: horizontal field of view of an AirSim recording that has no camera; 90 is AirSim's default.
        deck_z_m: world z (down) of the deck plane; overrides what files say.
        sea_z_m: world z (down) of the water; overrides what files say.
        pfm_rows: order of the rows in PFM depth files; AirSim's is "top-to-bottom", the PFM definition's the other.
        far_m: depths stored at or beyond this mean "nothing seen"; the default is AirSim's half-precision limit.
        on_skip: takes each damaged frame while somebody iterates; None prints its file and the reason on stderr.

    Raises:
        RecordingError: the source cannot be opened; one line that says what, where, and how to mend it.
    """
    path = Path(path)
    if pfm_rows not in ("top-to-bottom", "bottom-to-top"):
        raise RecordingError(f'pfm_rows must be "top-to-bottom" or "bottom-to-top", got {pfm_rows!r}')
    if not 0.0 < fov_deg < 180.0:
        raise RecordingError(f"fov_deg must lie between 0 and 180, got {fov_deg}")
    for name, value in (("deck_z_m", deck_z_m), ("sea_z_m", sea_z_m)):
        if value is not None and not math.isfinite(value):
            raise RecordingError(f"{name} must be a finite number of metres, got {value}")
    if not far_m > 0:
        raise RecordingError(f"far_m must be > 0 m, got {far_m}")
    given_camera = None if camera_file is None else read_camera_file(Path(camera_file))
    given_poses = None if poses_file is None else read_poses(Path(poses_file))
    if path.name == RECORD_FILE:
        path = path.parent
    source: Source
    if not path.exists():
        raise RecordingError(f"{path}: there is no such file or folder")
    if (path / RECORD_FILE).exists():
        if given_poses is not None:
            raise RecordingError(f"{path}: an AirSim recording has its poses in {RECORD_FILE}; leave {poses_file} out")
        source = _airsim(path, AirSimOptions(fov_deg, given_camera, None, deck_z_m, pfm_rows, far_m, sea_z_m))
    elif path.is_dir():
        _check_known(path)
        camera = (given_camera or _find_camera([path / CAMERA_FILE], path)).at(deck_z_m, sea_z_m)
        poses = given_poses or _find_poses([path / POSES_FILE])
        source = ImageFolder(path, camera, poses, pfm_rows, far_m)
    else:
        source = _video(path, given_camera, given_poses, deck_z_m, sea_z_m)
    source.on_skip = on_skip
    return source


def _video(
    path: Path, camera: MountedCamera | None, poses: Poses | None, deck_z_m: float | None, sea_z_m: float | None
) -> Source:
    from deckline.recording.video import Video, check_video  # PyAV is needed for videos only

    check_video(path)
    beside = [path.with_name(f"{path.name}.{CAMERA_FILE}"), path.with_name(CAMERA_FILE)]
    pose_files = [path.with_name(f"{path.name}.{POSES_FILE}"), path.with_name(POSES_FILE)]
    mounted = (camera or _find_camera(beside, path)).at(deck_z_m, sea_z_m)
    return Video(path, mounted, poses or _find_poses(pose_files))


def _airsim(folder: Path, options: AirSimOptions) -> AirSimRecording:
    scene = read_scene(folder / SCENE_FILE) if (folder / SCENE_FILE).exists() else None
    if (folder / CAMERA_FILE).exists():
        options = replace(options, fallback_camera=read_camera_file(folder / CAMERA_FILE))
    return AirSimRecording(folder, scene, options)


def _check_known(folder: Path) -> None:
    if list_images(folder):
        return
    inside = [f"{child.name}/" for child in sorted(folder.iterdir()) if (child / RECORD_FILE).exists()]
    hint = f"; did you mean {folder / inside[0]}?" if inside else ""
    raise RecordingError(
        f"{folder}: zero frames: neither {RECORD_FILE} nor images ({' '.join(IMAGE_SUFFIXES)}) in this folder{hint}"
    )


def _find_camera(candidates: Sequence[Path], source: Path) -> MountedCamera:
    for candidate in candidates:
        if candidate.exists():
            return read_camera_file(candidate)
    looked = " or ".join(str(candidate) for candidate in candidates)
    raise RecordingError(f"{source}: no camera file: write {looked}, or give one; it holds {EXAMPLE}")


def _find_poses(candidates: Sequence[Path]) -> Poses | None:
    for candidate in candidates:
        if candidate.exists():
            return read_poses(candidate)
    return None
