"""Draws a ship, sea and sky with OpenGL, off screen through EGL. On a machine without a GPU, Mesa's llvmpipe does it.

Image row 0 is drawn at the bottom of the frame buffer, so that what is read back starts with the top row and
pixel centres lie where `deckline.geometry` puts them. Depth is a float attachment of its own, sampled at pixel
centres; it does not pass through the depth buffer.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from deckline.geometry import Camera
from deckline_sim.scene.gl import (
    ShadowMap,
    fullscreen,
    link,
    moderngl,
    noise_field,
    open_context,
    paint_deck,
    tile_texture,
)
from deckline_sim.scene.view import (
    CLEAR_AIR_M,
    SAMPLES,
    Label,
    Rendering,
    RenderScene,
    Uniforms,
    scene_uniforms,
    solid_uniforms,
)
from deckline_sim.scene.waves import wave_tile
from deckline_sim.ship.mesh import Mesh
from deckline_sim.ship.ship import Ship
from deckline_sim.ship.structure import deck_mesh

CLIP_DISTANCE0 = 0x3000  # OpenGL's name
BRIGHTEST = np.finfo(np.float16).max
KEPT_TARGETS = 4  # sizes of frame buffers; every distorting lens has a pinhole of its own size
VERTEX = ("3f 3f 3f", "position", "normal", "colour")
LAMP = ("3f 3f 1f", "position", "colour", "strength")
POSITION = ("3f 24x", "position")


@dataclass(frozen=True, eq=False)
class Solid:
    """A mesh on the card and the program that draws it."""

    program: moderngl.Program
    colour: moderngl.VertexArray
    depth: moderngl.VertexArray


class Renderer:
    """Holds the OpenGL context and what is on the card. Use as a context manager."""

    def __init__(self) -> None:
        self.context = open_context()
        program = partial(link, self.context)
        self.sea, self.sea_depth = program("fullscreen.vert", "sea.frag"), program("fullscreen.vert", "sea_depth.frag")
        self.ground = program("fullscreen.vert", "ground.frag")
        self.solid, self.deck = program("solid.vert", "solid.frag"), program("solid.vert", "deck.frag")
        self.measure, self.painter = program("solid.vert", "depth.frag"), program("paint.vert", "paint.frag")
        self.lamp = program("lamp.vert", "lamp.frag")
        self.shadow = ShadowMap(self.context, program("shadow.vert", "shadow.frag"))
        self.noise, self.waves = (tile_texture(self.context, tile) for tile in (noise_field(), wave_tile()))
        self.backdrops = {each: fullscreen(self.context, each) for each in (self.sea, self.ground, self.sea_depth)}
        self.targets: dict[tuple[int, int], tuple[moderngl.Framebuffer, ...]] = {}
        self.ship: Ship | None = None
        self.ship_objects: list[moderngl.Buffer | moderngl.Texture | moderngl.VertexArray] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the OpenGL context."""
        self.context.__enter__()
        self.context.release()

    def load(self, ship: Ship, sun: NDArray[np.float64]) -> None:
        """Bring a ship onto the card, paint its deck and cast its shadows.

        Args:
            ship: what to draw from now on.
            sun: (3,) direction to the ground, world; the ship's own shadows stay as they fall when it is at rest.
        """
        self.context.__enter__()  # several renderers may be open: this makes our context the current one
        for thing in self.ship_objects:
            thing.release()
        self.ship, self.sun, self.ship_objects = ship, sun, []
        deck = deck_mesh(ship.layout)
        self.noise.use(0)
        self.paint_map = paint_deck(self.context, self.painter, ship)
        self.ship_objects.append(self.paint_map)
        self.solids = [self._solid(self.solid, ship.solids), self._solid(self.deck, deck)]
        self.background = [self._solid(self.solid, ship.background)] if len(ship.background) else []
        casters = np.concatenate([ship.solids[:, :3], deck[:, :3]]).astype(np.float64)
        sun_on_ship = ship.layout.world_from_ship.rotation.inv().apply(sun)
        self.shadow.draw([self._buffer(ship.solids), self._buffer(deck)], casters, sun_on_ship)
        self.lamps: moderngl.VertexArray | None = None
        if len(ship.lights):
            self.lamps = self.context.vertex_array(self.lamp, [(self._buffer(ship.lights), *LAMP)])
            self.ship_objects.append(self.lamps)

    def render(self, scene: RenderScene) -> Rendering:
        """Picture and depth of a scene.

        Raises:
            ValueError: a camera with lens distortion or one that is not above the sea, or no ship loaded.
        """
        return self._draw(scene, *self._place(scene))

    def labels(self, scene: RenderScene) -> NDArray[np.uint8]:
        """What each pixel's middle shows, (H, W) of `Label`; errors as for `render`."""
        return np.maximum(self._measure(scene, *self._place(scene), labels=True), 0.0).astype(np.uint8)

    def depth(self, scene: RenderScene) -> NDArray[np.float32]:
        """The depth (H, W) of `render` without its picture, which takes most of the time."""
        return _mask_sky(self._measure(scene, *self._place(scene)))

    def _place(self, scene: RenderScene) -> tuple[Uniforms, Uniforms]:
        """Set the uniforms of all programs; returns those of the ship and those of the rest of the world."""
        camera = scene.camera
        if camera.has_distortion:
            raise ValueError(f"the renderer draws a pinhole, got distortion {camera.distortion}")
        if self.ship is None:
            raise ValueError("load a ship before rendering: none is loaded")
        eye_z, sea_z = scene.world_from_camera.translation[2], self.ship.layout.sea_z_m
        if not eye_z < sea_z:
            raise ValueError(f"the camera must be above the sea (z < {sea_z:.2f} m), got z = {eye_z:.2f} m")
        self.context.__enter__()
        where = self.ship.layout.world_from_ship if scene.world_from_ship is None else scene.world_from_ship
        ship = solid_uniforms(scene, where, CLEAR_AIR_M)
        moved = where.translation - self.ship.layout.world_from_ship.translation
        company = RigidTransform.from_translation([moved[0], moved[1], 0.0])  # other ships and land follow the ship
        world = solid_uniforms(scene, company, scene.weather.fade_m)
        values = scene_uniforms(scene, self.ship, where)
        values |= ship | {"sun": self.sun, "light_from_ship": self.shadow.light_from_ship.T}
        self._bind(values, scene.quality.anisotropy)
        return ship, world | {"shadow": 0.0}

    def _draw(self, scene: RenderScene, ship: Uniforms, world: Uniforms) -> Rendering:
        sampled, resolved, _ = self._targets(scene.camera)
        drawn = sampled if scene.quality.samples > 1 else resolved
        solids = self.solids if scene.with_ship else []
        land = self.ship is not None and self.ship.layout.on_land
        drawn.use()
        drawn.clear()
        self.context.enable_direct(CLIP_DISTANCE0)
        for solid in solids:
            solid.colour.render()
        for solid in self.background:
            _set(solid.program, world)
            solid.colour.render()
        self.context.disable_direct(CLIP_DISTANCE0)
        self.backdrops[self.ground if land else self.sea].render()
        if scene.with_ship and scene.weather.lamps > 0.0 and self.lamps is not None:
            self.context.enable(moderngl.BLEND | moderngl.PROGRAM_POINT_SIZE)
            self.context.blend_func = moderngl.ONE, moderngl.ONE
            self.lamps.render(moderngl.POINTS)
            self.context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
            self.context.disable(moderngl.BLEND)
        if drawn is sampled:
            self.context.copy_framebuffer(resolved, sampled)
        radiance = np.frombuffer(resolved.read(components=4, alignment=1, dtype="f2"), dtype=np.float16)
        radiance = np.minimum(radiance, BRIGHTEST)  # the sun's glitter may be more
        depth = self._measure(scene, ship, world)
        rgb = radiance.reshape(*depth.shape, 4)[..., :3].astype(np.float32)
        return Rendering(rgb, _mask_sky(depth))

    def _measure(
        self, scene: RenderScene, ship: Uniforms, world: Uniforms, labels: bool = False
    ) -> NDArray[np.float32]:
        """Depth (H, W) along the optical axis, or the labels (H, W); not positive in the sky."""
        measured = self._targets(scene.camera)[-1]
        measured.use()
        measured.clear()
        self.context.enable_direct(CLIP_DISTANCE0)
        for solid in self.background:
            _set(self.measure, world | {"label": labels * Label.BACKGROUND})
            solid.depth.render()
        for solid, label in zip(self.solids if scene.with_ship else [], (Label.STRUCTURE, Label.DECK), strict=False):
            _set(self.measure, ship | {"label": labels * label})
            solid.depth.render()
        self.context.disable_direct(CLIP_DISTANCE0)
        _set(self.sea_depth, {"label": labels * Label.SURFACE})
        self.backdrops[self.sea_depth].render()
        read = np.frombuffer(measured.read(components=1, dtype="f4"), dtype=np.float32)
        return read.reshape(scene.camera.height, scene.camera.width)

    def _targets(self, camera: Camera) -> tuple[moderngl.Framebuffer, ...]:
        """Frame buffers of a size: sampled colour, resolved colour, exact depth."""
        size = (camera.width, camera.height)
        if size not in self.targets:
            gl = self.context
            if len(self.targets) >= KEPT_TARGETS:
                for old in self.targets.pop(next(iter(self.targets))):
                    for part in (*old.color_attachments, old.depth_attachment, old):
                        part.release()
            sampled = gl.framebuffer(
                [gl.renderbuffer(size, 4, samples=SAMPLES, dtype="f2")], gl.depth_renderbuffer(size, samples=SAMPLES)
            )
            resolved = gl.framebuffer([gl.renderbuffer(size, 4, dtype="f2")], gl.depth_renderbuffer(size))
            measured = gl.framebuffer([gl.renderbuffer(size, 1, dtype="f4")], gl.depth_renderbuffer(size))
            self.targets[size] = (sampled, resolved, measured)
        return self.targets[size]

    def _bind(self, values: Uniforms, anisotropy: float) -> None:
        """Set the uniforms and textures of every drawing program."""
        for program in (self.sea, self.ground, self.sea_depth, self.solid, self.deck, self.measure, self.lamp):
            _set(program, values)
        self.paint_map.anisotropy = anisotropy
        for unit, texture in enumerate((self.noise, self.paint_map, self.waves, self.shadow.texture)):
            texture.use(unit)
        self.context.enable_only(moderngl.DEPTH_TEST)
        self.context.depth_func = "<="

    def _buffer(self, mesh: Mesh) -> moderngl.Buffer:
        buffer = self.context.buffer(np.ascontiguousarray(mesh, dtype=np.float32).tobytes())
        self.ship_objects.append(buffer)
        return buffer

    def _solid(self, program: moderngl.Program, mesh: Mesh) -> Solid:
        buffer = self._buffer(mesh)
        colour = self.context.vertex_array(program, [(buffer, *VERTEX)], skip_errors=True)
        depth = self.context.vertex_array(self.measure, [(buffer, *POSITION)], skip_errors=True)
        self.ship_objects += [colour, depth]
        return Solid(program, colour, depth)


def _set(program: moderngl.Program, values: dict[str, ArrayLike]) -> None:
    for name in program:
        if name in values and isinstance(program[name], moderngl.Uniform):
            value = np.asarray(values[name])
            program[name] = value.item() if value.ndim == 0 else tuple(value.ravel().tolist())


def _mask_sky(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.where(depth_m > 0, depth_m, np.float32(np.nan))
