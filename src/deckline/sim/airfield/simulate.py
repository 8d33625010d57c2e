"""Frames of presets `airfield` and `pad`, drawn without OpenGL; configuration and index decide all of a frame."""

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.geometry import Camera, camera_mount
from deckline.haze import CONTRAST_THRESHOLD, add_haze
from deckline.recording.images import read_image
from deckline.sim.airfield.ground import Viewer
from deckline.sim.airfield.pad import draw_pad
from deckline.sim.airfield.picture import Airfield, draw_airfield, make_textures
from deckline.sim.camera.glass import look_through
from deckline.sim.camera.measure import measure_depth
from deckline.sim.config import SimConfig
from deckline.types import Frame, Segment, Truth

FRAME, TEXTURES = 3, 8  # random streams
MOST_PHOTOGRAPHS = 200  # whose pieces are textures
UP_TO_DOWN = np.array([1.0, 1.0, -1.0])


class AirfieldSimulator:
    """Draws single frames in any order.

    Args:
        config: of one of them. Size, number, seed, visibility, depth and photographs count; camera, light, ground and
            runway are drawn anew for every frame.
    """

    def __init__(self, config: SimConfig) -> None:
        self.config = config
        rng = np.random.default_rng([config.seed, TEXTURES])
        files = (
            sorted(path for path in Path(config.photographs).iterdir() if path.suffix in (".jpg", ".png"))
            if config.photographs
            else []
        )
        chosen = rng.permutation(len(files))[:MOST_PHOTOGRAPHS]
        self.textures = make_textures(rng, [read_image(files[k]) for k in chosen])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        return

    def frame(self, index: int) -> Frame:
        """Frame `index`; its truth's conditions say under "edge" what the edge line is."""
        config = self.config
        rng = np.random.default_rng([config.seed, FRAME, index])
        draw = draw_pad if config.preset == "pad" else draw_airfield
        airfield = draw(config.width, config.height, self.textures, rng)
        low, high = config.visibility_m
        visibility = high if np.isinf(high) else float(rng.uniform(low, high))
        image, airlight = airfield.image_rgb, None
        if np.isfinite(visibility):
            airlight = rng.uniform(130, 235) * (1 + rng.normal(0, 0.03, 3))
            image = add_haze(image, airfield.range_m, -np.log(CONTRAST_THRESHOLD) / visibility, airlight)
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
                conditions={} if airfield.edge is None else {"edge": str(airfield.edge)},
            ),
        )
        return look_through(drawn, config, index)


def _camera(viewer: Viewer) -> Camera:
    middle = (viewer.width - 1) / 2, (viewer.height - 1) / 2
    return Camera(viewer.width, viewer.height, viewer.focal_px, viewer.focal_px, *middle)


def _pose(viewer: Viewer) -> RigidTransform:
    """world_from_body of an aircraft whose camera looks along its body's forward axis."""
    rotation = Rotation.from_matrix((viewer.axes * UP_TO_DOWN).T)
    return RigidTransform.from_components(viewer.position_m * UP_TO_DOWN, rotation) * camera_mount().inv()


def _true_depth(airfield: Airfield) -> NDArray[np.float32]:
    """(H, W) along the optical axis, m; NaN for sky."""
    depth = airfield.range_m / _camera(airfield.viewer).ray_lengths()
    return np.where(np.isfinite(depth), depth, np.nan).astype(np.float32)
