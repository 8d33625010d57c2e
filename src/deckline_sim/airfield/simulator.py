"""Frames of presets `airfield` and `pad`, drawn without OpenGL; configuration and index decide all of a frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, camera_mount
from deckline.haze import add_haze, beta_from_visibility
from deckline.recording.image_folder import list_images
from deckline.recording.images import read_image
from deckline.types import Frame, Segment, Truth
from deckline_sim.airfield.ground import NOISE_SLOPES, TILE, GroundCamera
from deckline_sim.airfield.pad import draw_pad
from deckline_sim.airfield.picture import AirfieldPicture, draw_airfield, make_textures
from deckline_sim.camera.foreground import add_foreground
from deckline_sim.camera.measure import measure_depth
from deckline_sim.config import SimConfig
from deckline_sim.visibility import draw_visibility

FRAME, TEXTURES = 3, 8  # random streams
MOST_PHOTOGRAPHS = 200  # whose pieces are textures
UP_TO_DOWN = np.array([1.0, 1.0, -1.0])


class AirfieldSimulator:
    """Draws single frames in any order.

    Args:
        config: of preset `airfield` or `pad`. It sets size, number, seed, visibility, depth and photographs;
            camera, light, ground and runway are drawn for every frame.

    Raises:
        ValueError: a damaged photograph, or a folder without any that makes a texture.
        OSError: no such folder.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        rng = np.random.default_rng([config.seed, TEXTURES])
        photographs = _read_photographs(Path(config.photographs), rng) if config.photographs else ()
        self.textures = make_textures(rng, photographs)
        if config.photographs and len(self.textures) == len(NOISE_SLOPES):
            raise ValueError(f"{config.photographs}: no photograph with something in it, {TILE // 2} px or larger")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Nothing to release; as `ShipSimulator.close`."""

    def frame(self, index: int) -> Frame:
        """Frame `index`; its truth's conditions hold the kind of its edge lines as "edge"."""
        config = self.config
        rng = np.random.default_rng([config.seed, FRAME, index])
        draw = draw_pad if config.preset == "pad" else draw_airfield
        airfield = draw(config.width, config.height, self.textures, rng)
        visibility = draw_visibility(config.visibility_m, rng)
        image, airlight = airfield.image_rgb, None
        if np.isfinite(visibility):
            airlight = rng.uniform(130, 235) * (1 + rng.normal(0, 0.03, 3))
            image = add_haze(image, airfield.range_m, beta_from_visibility(visibility), airlight)
        left, right = (
            (None, None) if airfield.ends_m is None else (Segment(*(UP_TO_DOWN * line)) for line in airfield.ends_m)
        )
        drawn = Frame(
            file=f"{config.preset}_{index}.png",
            time_s=float(index),
            image_rgb=image,
            camera=_camera(airfield.viewer),
            body_from_camera=camera_mount(),
            depth_m=measure_depth(_true_depth(airfield), config.depth, rng),
            world_from_body=_pose(airfield.viewer),
            deck_z_m=-airfield.deck_m,
            truth=Truth(
                left,
                right,
                visibility_m=visibility,
                airlight_rgb=None if airlight is None else (airlight[0], airlight[1], airlight[2]),
                clear_rgb=airfield.image_rgb if config.keep_clear and np.isfinite(visibility) else None,
                centre_painted=airfield.centre_painted,
                conditions={} if airfield.edge is None else {"edge": str(airfield.edge)},
            ),
        )
        return add_foreground(drawn, config, index)


def _read_photographs(folder: Path, rng: np.random.Generator) -> Iterator[NDArray[np.uint8]]:
    files = sorted(list_images(folder))
    for k in rng.permutation(len(files))[:MOST_PHOTOGRAPHS]:
        try:
            yield read_image(folder / files[k])
        except ValueError as error:
            raise ValueError(f"{folder / files[k]}: {error}") from None


def _camera(viewer: GroundCamera) -> Camera:
    middle = (viewer.width - 1) / 2, (viewer.height - 1) / 2
    return Camera(viewer.width, viewer.height, viewer.focal_px, viewer.focal_px, *middle)


def _pose(viewer: GroundCamera) -> RigidTransform:
    """world_from_body of an aircraft whose optical axis is its body's forward axis."""
    rotation = Rotation.from_matrix((viewer.axes * UP_TO_DOWN).T)
    return RigidTransform.from_components(viewer.position_m * UP_TO_DOWN, rotation) * camera_mount().inv()


def _true_depth(airfield: AirfieldPicture) -> NDArray[np.float32]:
    """(H, W) along the optical axis, m; NaN for sky."""
    depth = airfield.range_m / _camera(airfield.viewer).ray_lengths()
    return np.where(np.isfinite(depth), depth, np.nan).astype(np.float32)
