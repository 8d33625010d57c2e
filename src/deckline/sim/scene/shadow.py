"""Where a ship's own parts keep the sun off it: a depth map of the ship as the sun sees it."""

import numpy as np
from numpy.typing import NDArray

from deckline.sim.scene.gl import moderngl

MAP_SIZE = (2048, 1024)  # along the ship, across; about 0.2 m a texel on a large carrier
MARGIN_M = 2.0  # of light around the casters
REACH = 1.02  # of the depth range beyond the farthest caster


def light_from_ship(sun: NDArray[np.float64], points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Affine map (4, 4) of the ship frame to shadow map coordinates, every one of `points` (N, 3) inside 0..1.

    The first axis runs along the ship as seen from the sun, the third away from the sun.

    Args:
        sun: unit vector (3,) from the sun to the ground, ship frame.
        points_m: what casts shadows, ship frame.
    """
    ahead = np.array([1.0, 0.0, 0.0]) - sun[0] * sun
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.array([0.0, 1.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead)
    axes = np.stack([ahead, np.cross(sun, ahead), sun])
    seen = points_m @ axes.T
    low, high = seen.min(axis=0) - MARGIN_M, seen.max(axis=0) + MARGIN_M
    scale = 1.0 / (high - low) / [1.0, 1.0, REACH]
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = scale[:, None] * axes, -scale * low
    return out


class ShadowMap:
    """The depth map on the card; made once, drawn for every ship and sun."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        self.context, self.program = context, program
        self.texture = context.depth_texture(MAP_SIZE)
        self.texture.compare_func = "<="
        self.texture.repeat_x = self.texture.repeat_y = False
        self.target = context.framebuffer(depth_attachment=self.texture)
        self.light_from_ship = np.eye(4)

    def draw(self, buffers: list[moderngl.Buffer], points_m: NDArray[np.float64], sun: NDArray[np.float64]) -> None:
        """Depth of meshes of vertices (x, y, z and 24 more bytes) under a sun (3,), ship frame."""
        self.light_from_ship = light_from_ship(sun, points_m)
        self.program["light_from_ship"] = tuple(self.light_from_ship.T.ravel().tolist())
        self.target.use()
        self.target.clear()
        self.context.enable(moderngl.DEPTH_TEST)
        for buffer in buffers:
            array = self.context.vertex_array(self.program, [(buffer, "3f 24x", "position")])
            array.render()
            array.release()
