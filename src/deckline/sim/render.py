"""Draws a ship, sea and sky with OpenGL, off screen through EGL. On a machine without a GPU, Mesa's llvmpipe does it.

Image row 0 is drawn at the bottom of the frame buffer, so that what is read back starts with the top row and
pixel centres lie where `deckline.geometry` puts them. Depth is a float attachment of its own, sampled at pixel
centres; it does not pass through the depth buffer.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline.sim.bake import SAMPLES, noise_texture, paint_deck
from deckline.sim.gl import moderngl, open_context
from deckline.sim.layout import Layout
from deckline.sim.mesh import Mesh, triangles
from deckline.sim.ship import Ship
from deckline.sim.weather import Weather

NEAR_M, FAR_M = 1.0, 20000.0  # clip planes of the depth buffer, which only sorts surfaces
SHADERS = Path(__file__).parent / "shaders"
LINEAR = ((np.arange(256) / 255.0) ** 2.2).astype(np.float32)


@dataclass(frozen=True)
class Quality:
    """How carefully a picture is drawn; a poor one looks like other renderers' work."""

    samples: int = SAMPLES  # per pixel, this many or 1, which leaves jagged edges
    anisotropy: float = 16.0  # of the deck's texture filter; 1 smears far markings together


BEST = Quality()


def random_quality(rng: np.random.Generator) -> Quality:
    """Mostly good."""
    anisotropy = float(rng.choice([1.0, 2.0, 4.0, 16.0], p=[0.15, 0.25, 0.25, 0.35]))
    return Quality(samples=1 if rng.random() < 0.15 else SAMPLES, anisotropy=anisotropy)


@dataclass(frozen=True, eq=False)
class View:
    """One picture."""

    radiance: NDArray[np.float32]  # (H, W, 3) linear light; 1 is what a white surface in full daylight sends
    depth_m: NDArray[np.float32]  # (H, W) along the optical axis; NaN in the sky


class Renderer:
    """Holds the OpenGL context and what is on the card. Use as a context manager."""

    def __init__(self) -> None:
        self.context = open_context()
        program = self._program
        self.sea, self.sea_depth = program("fullscreen.vert", "sea.frag"), program("fullscreen.vert", "sea_depth.frag")
        self.solid, self.deck = program("solid.vert", "solid.frag"), program("solid.vert", "deck.frag")
        self.depth, self.painter = program("solid.vert", "depth.frag"), program("paint.vert", "paint.frag")
        self.noise = noise_texture(self.context)
        self.corners = self.context.buffer(np.array([[-1, -1], [3, -1], [-1, 3]], dtype=np.float32).tobytes())
        self.targets: dict[tuple[int, int], tuple[moderngl.Framebuffer, ...]] = {}
        self.ship: Ship | None = None
        self.ship_objects: list[moderngl.Buffer | moderngl.Texture | moderngl.VertexArray] = []

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.context.release()

    def _program(self, vertex: str, fragment: str) -> moderngl.Program:
        return self.context.program(vertex_shader=_source(vertex), fragment_shader=_source(fragment))

    def load(self, ship: Ship, sun: NDArray[np.float64]) -> None:
        """Bring a ship onto the card and paint its deck, under a sun (3,): direction to the ground, world."""
        for thing in self.ship_objects:
            thing.release()
        self.ship, self.sun = ship, sun
        deck = deck_mesh(ship.layout)
        self.noise.use(0)
        self.paint_map = paint_deck(self.context, self.painter, ship)
        buffers = [self.context.buffer(mesh.tobytes()) for mesh in (ship.solids, deck)]
        layout = ("3f 3f 3f", "position", "normal", "colour")
        plain = ("3f 24x", "position")
        solid, deck_array, *depths = (
            self.context.vertex_array(program, [(buffer, *attributes)], skip_errors=True)
            for program, buffer, attributes in (
                (self.solid, buffers[0], layout), (self.deck, buffers[1], layout),
                (self.depth, buffers[0], plain), (self.depth, buffers[1], plain),
            )
        )  # fmt: skip
        self.solid_array, self.deck_array, self.depth_arrays = solid, deck_array, depths
        self.ship_objects = [solid, deck_array, *depths, *buffers, self.paint_map]

    def render(
        self,
        camera: Camera,
        world_from_camera: RigidTransform,
        weather: Weather,
        time_s: float = 0.0,
        with_ship: bool = True,
        quality: Quality = BEST,
        world_from_ship: RigidTransform | None = None,
    ) -> View:
        """A picture of the loaded ship (or of its sea alone) and its depth, the ship at rest or where it is put.

        Raises:
            ValueError: a camera with lens distortion or one that is not above the sea, or no ship loaded.
        """
        if camera.has_distortion:
            raise ValueError(f"the renderer draws a pinhole, got distortion {camera.distortion}")
        if self.ship is None:
            raise ValueError("load a ship before rendering: none is loaded")
        eye_z, sea_z = world_from_camera.translation[2], self.ship.layout.sea_z_m
        if not eye_z < sea_z:
            raise ValueError(f"the camera must be above the sea (z < {sea_z:.2f} m), got z = {eye_z:.2f} m")
        where = self.ship.layout.world_from_ship if world_from_ship is None else world_from_ship
        values = uniforms(camera, world_from_camera, where, self.ship, weather, self.sun, time_s, with_ship)
        self._set(values, quality.anisotropy)
        sampled, resolved, measured = self._targets(camera)
        drawn = sampled if quality.samples > 1 else resolved
        drawn.use()
        drawn.clear()
        self._draw(self.sea, [self.solid_array, self.deck_array] if with_ship else [])
        if drawn is sampled:
            self.context.copy_framebuffer(resolved, sampled)
        rgb = np.frombuffer(resolved.read(components=3, alignment=1), dtype=np.uint8)
        measured.use()
        measured.clear()
        self._draw(self.sea_depth, self.depth_arrays if with_ship else [])
        depth = np.frombuffer(measured.read(components=1, dtype="f4"), dtype=np.float32)
        shape = (camera.height, camera.width)
        radiance = LINEAR[rgb].reshape(*shape, 3)
        return View(radiance, np.where(depth > 0, depth, np.float32(np.nan)).reshape(shape))

    def _draw(self, background: moderngl.Program, arrays: list[moderngl.VertexArray]) -> None:
        backdrop = self.context.vertex_array(background, [(self.corners, "2f", "corner")])
        self.context.disable(moderngl.DEPTH_TEST)
        backdrop.render()
        backdrop.release()
        self.context.enable(moderngl.DEPTH_TEST)
        for array in arrays:
            array.render()

    def _targets(self, camera: Camera) -> tuple[moderngl.Framebuffer, ...]:
        """Frame buffers of a size: sampled colour, resolved colour, exact depth."""
        size = (camera.width, camera.height)
        if size not in self.targets:
            gl = self.context
            sampled = gl.framebuffer(
                [gl.renderbuffer(size, 4, samples=SAMPLES)], gl.depth_renderbuffer(size, samples=SAMPLES)
            )
            resolved = gl.framebuffer([gl.renderbuffer(size, 4)], gl.depth_renderbuffer(size))
            measured = gl.framebuffer([gl.renderbuffer(size, 1, dtype="f4")], gl.depth_renderbuffer(size))
            self.targets[size] = (sampled, resolved, measured)
        return self.targets[size]

    def _set(self, values: dict[str, ArrayLike], anisotropy: float) -> None:
        """Hand every drawing program the uniforms that it has."""
        for program in (self.sea, self.sea_depth, self.solid, self.deck, self.depth):
            for name in program:
                if isinstance(program[name], moderngl.Uniform):
                    value = np.asarray(values[name])
                    program[name] = value.item() if value.ndim == 0 else tuple(value.ravel().tolist())
        self.paint_map.anisotropy = anisotropy
        self.noise.use(0)
        self.paint_map.use(1)


def uniforms(
    camera: Camera,
    world_from_camera: RigidTransform,
    ship_pose: RigidTransform,
    ship: Ship,
    weather: Weather,
    sun: NDArray[np.float64],
    time_s: float,
    with_ship: bool,
) -> dict[str, ArrayLike]:
    """Every uniform of the shaders by name; matrices column by column, as OpenGL reads them."""
    layout = ship.layout
    world_from_ship = ship_pose.as_matrix()
    optical_from_ship = (world_from_camera.inv() * ship_pose).as_matrix()
    values: dict[str, ArrayLike] = {item.name: getattr(weather, item.name) for item in fields(weather)}
    return values | {
        "lens": (camera.fx, camera.fy, camera.cx, camera.cy),
        "world_from_optical": world_from_camera.rotation.as_matrix().T,
        "eye": world_from_camera.translation,
        "sea_z": layout.sea_z_m,
        "sun": sun,
        "ship": (*world_from_ship[:2, 3], *world_from_ship[:2, 0]),
        "wake": (ship.stern_half_m, weather.wake_spread, weather.wake_length_m, weather.wake * with_ship),
        "hull_m": layout.length_m,
        "time_s": time_s,
        "clip_from_ship": (clip_from_optical(camera) @ optical_from_ship).T,
        "depth_row": optical_from_ship[2],
        "world_from_ship": world_from_ship[:3, :3].T,
        "world_from_ship4": world_from_ship.T,
        "paint_area": (*layout.outline_m.min(axis=0), *np.ptp(layout.outline_m, axis=0)),
        "noise_map": 0,
        "paint_map": 1,
    }


def clip_from_optical(camera: Camera) -> NDArray[np.float64]:
    """Projection (4, 4) of the optical frame to OpenGL's clip space, image row 0 at the bottom."""
    sx, sy = 2.0 / camera.width, 2.0 / camera.height
    a, b = (FAR_M + NEAR_M) / (FAR_M - NEAR_M), -2.0 * FAR_M * NEAR_M / (FAR_M - NEAR_M)
    return np.array(
        [
            [camera.fx * sx, 0.0, (camera.cx + 0.5) * sx - 1.0, 0.0],
            [0.0, camera.fy * sy, (camera.cy + 0.5) * sy - 1.0, 0.0],
            [0.0, 0.0, a, b],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )


def deck_mesh(layout: Layout) -> Mesh:
    """The deck's surface as strips between its edges."""
    x, port, starboard = layout.stations_m, layout.port_m, layout.starboard_m
    zero = np.zeros(len(x) - 1)
    p0, p1 = np.column_stack([x[:-1], port[:-1], zero]), np.column_stack([x[1:], port[1:], zero])
    s0, s1 = np.column_stack([x[:-1], starboard[:-1], zero]), np.column_stack([x[1:], starboard[1:], zero])
    return triangles(np.concatenate([np.stack([p0, p1, s1], 1), np.stack([p0, s1, s0], 1)]), (0.0, 0.0, 0.0))


def _source(name: str) -> str:
    text = (SHADERS / name).read_text(encoding="utf-8")
    return text.replace("#include sky.glsl", (SHADERS / "sky.glsl").read_text(encoding="utf-8"))
