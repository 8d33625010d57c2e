"""Two lines to train on: drawn in a picture, and painted on a plane that frames with truth show."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera, attitude
from deckline.types import Frame, Segment, Truth

LINES_PX = np.array([[[250.0, 300.0], [290.0, 180.0]], [[420.0, 305.0], [350.0, 185.0]]])  # left and right, near to far
CAMERA = Camera.from_fov(320, 180, np.deg2rad(60))


def two_lines() -> np.ndarray:
    """A picture (360, 640, 3): a red left line and a green right one, 4 px wide, on dark grey."""
    v, u = np.mgrid[0:360, 0:640]
    image = np.full((360, 640, 3), 40.0)
    for channel, ((u0, v0), (u1, v1)) in enumerate(LINES_PX):
        middle = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
        image[..., channel] += 200 * np.clip(2.5 - np.abs(u - middle), 0, 1) * ((v >= v1) & (v <= v0))
    return image.astype(np.uint8)


def line_frame(index: int, runway: bool = True) -> Frame:
    """Looking along two lines on a plane from 120 m before them, 20 m above; the sky is behind that plane."""
    position = np.array([-120.0, 2.0 * index, -40.0])
    world_from_body = RigidTransform.from_components(position, attitude(0.02 * index, -0.12, 0.0))
    bare = Frame(f"img_{index}.ppm", float(index), np.zeros((180, 320, 3), np.uint8), CAMERA)
    v, u = np.mgrid[0:180, 0:320]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    rays = (world_from_body * bare.body_from_camera).rotation.apply(CAMERA.rays(pixels))
    with np.errstate(divide="ignore"):
        depth = np.where(rays[:, 2] > 0.01, 20.0 / rays[:, 2], np.nan).reshape(180, 320)
    ground = position + rays * np.nan_to_num(depth.ravel(), nan=2000.0)[:, None]
    on_line = (np.abs(np.abs(ground[:, 1]) - 12) < 1.0) & (ground[:, 0] > 0) & (ground[:, 0] < 220)
    level = np.where(on_line.reshape(180, 320) & runway, 220, np.where(np.isnan(depth), 160, 60))
    lines = [Segment(np.array([0.0, y, -20.0]), np.array([220.0, y, -20.0])) if runway else None for y in (-12.0, 12.0)]
    return Frame(
        bare.file,
        bare.time_s,
        np.repeat(level[..., None], 3, axis=2).astype(np.uint8),
        CAMERA,
        depth_m=depth.astype(np.float32),
        world_from_body=world_from_body,
        deck_z_m=-20.0,
        truth=Truth(*lines, float("inf"), (160.0, 160.0, 160.0)),
    )
