"""The objects of the scene by name: their poses, their IDs in segmentation pictures, and where a camera sees them."""

import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline_sim.airsim_server.structs import Struct, geo_struct, pose_struct, vector_struct
from deckline_sim.airsim_server.world import World, WorldState
from deckline_sim.scene.view import Label
from deckline_sim.ship.paint_shapes import axes

LABELS = {"Deck": (Label.DECK,), "Carrier": (Label.DECK, Label.STRUCTURE)}  # of objects that cameras detect
OWN_LABEL = {"Deck": Label.DECK, "Carrier": Label.STRUCTURE, "Background": Label.BACKGROUND}  # that IDs colour
MOST_ID = 255
LONGEST = 200  # characters of a pattern
_LEVELS = (255, 127, 191, 95, 159, 223, 79)  # of a channel, in the order in which Cosys-AirSim's colours use them


@dataclass(frozen=True)
class DetectionFilter:
    """The objects that a camera detects, by names with * and ?, and how near they must be, m."""

    names: tuple[str, ...] = ()
    radius_m: float = np.inf


def _palette() -> NDArray[np.uint8]:
    """Colours (256, 3) of object IDs: all triples of levels, those with a new level after those without."""
    colours = list(product(_LEVELS[:2], repeat=3))
    for number, level in enumerate(_LEVELS[2:], 2):
        for is_new in list(product((False, True), repeat=3))[1:]:
            colours += product(*((level,) if new else _LEVELS[:number] for new in is_new))
    return np.array(colours[: MOST_ID + 1], dtype=np.uint8)


PALETTE = _palette()


def surface_name(world: World) -> str:
    return "Ground" if world.layout.on_land else "Sea"


def object_names(world: World) -> list[str]:
    """All objects with a pose."""
    return ["Carrier", "Deck", "Ramp", "Touchdown", surface_name(world), world.settings.vehicle]


def object_pose(world: World, name: str, state: WorldState, time_s: float) -> RigidTransform | None:
    """world_from_object at a time, or None.

    Carrier and Deck: x forward, y starboard, z down, origin on the deck's stern. Ramp and Touchdown: on the deck, x
    along the landing, origin in the middle of the runway's near end, and at the planned touchdown point.
    """
    if name == world.settings.vehicle:
        return state.world_from_body
    if name == surface_name(world):
        return RigidTransform.from_translation([0.0, 0.0, world.layout.sea_z_m])
    ship = world.ship_pose(time_s)
    if name in ("Carrier", "Deck"):
        return ship
    if name not in ("Ramp", "Touchdown"):
        return None
    near, _ = world.layout.centre_m
    along = axes(*world.layout.centre_m)[0]
    place = near + along * (world.config.flight.touchdown_m if name == "Touchdown" else 0.0)
    turn = Rotation.from_euler("z", np.arctan2(along[1], along[0]))
    return ship * RigidTransform.from_components([*place, 0.0], turn)


def find(names: list[str], pattern: str, is_regex: bool) -> list[str]:
    """The names that a pattern matches, ignoring case; a ValueError for an invalid expression."""
    if not isinstance(pattern, str) or len(pattern) > LONGEST:
        raise ValueError(f"a name or expression has at most {LONGEST} characters, got {str(pattern)[:40]!r}")
    try:
        expression = re.compile(pattern if is_regex else re.escape(pattern), re.IGNORECASE)
    except (re.error, OverflowError) as error:
        raise ValueError(f"no regular expression: {pattern[:40]!r}: {error}") from None
    return [name for name in names if expression.fullmatch(name)]


def matches_wildcard(name: str, pattern: str) -> bool:
    """Whether a name matches a pattern with * and ?, upper and lower case alike, as Unreal compares them."""
    return fnmatchcase(name.lower(), pattern.lower().replace("[", "[[]"))


def segmented_names(world: World) -> dict[str, Label]:
    """The objects that segmentation pictures show, and their pixels' label."""
    return {surface_name(world): Label.SURFACE} | OWN_LABEL


def object_ids(world: World, state: WorldState) -> dict[str, int]:
    """The segmentation IDs as set; an object's own is its label."""
    return {name: state.object_ids.get(name, int(label)) for name, label in segmented_names(world).items()}


def segmentation(world: World, camera: str, image_type: int, state: WorldState, time_s: float) -> NDArray[np.uint8]:
    """A camera's picture (H, W, 3) of the objects' IDs in `PALETTE`; the sky and ID -1 are black."""
    colours = np.zeros((len(Label), 3), dtype=np.uint8)
    labels = segmented_names(world)
    for name, number in object_ids(world, state).items():
        if number >= 0:
            colours[labels[name]] = PALETTE[number]
    return colours[world.labels(camera, image_type, state, time_s)]


def detections(world: World, camera: str, image_type: int) -> list[Struct]:
    """DetectionInfos of the filtered objects that a camera sees; only on the world's own thread.

    `box2D` bounds the visible pixels, and `box3D` the object in the mount's frame, whose x axis is the viewing axis.
    """
    state, time_s = world.snapshot()
    wanted = state.filters.get((camera, image_type), DetectionFilter())
    seen = world.labels(camera, image_type, state, time_s) if wanted.names else np.zeros((1, 1), np.uint8)
    mount_from_world = (state.world_from_body * world.mount(camera, state)).inv()
    ship, found = world.ship_pose(time_s), []
    for name, labels in LABELS.items():
        if not any(matches_wildcard(name, pattern) for pattern in wanted.names):
            continue
        relative = mount_from_world * ship
        rows, columns = np.nonzero(np.isin(seen, labels))
        if not len(rows) or np.linalg.norm(relative.translation) > wanted.radius_m:
            continue
        corners = relative.apply(world.outline(name))
        found.append(
            {
                "name": name,
                "geo_point": geo_struct(ship.translation, world.settings.origin),
                "box2D": _box((columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)),
                "box3D": {"min": vector_struct(corners.min(axis=0)), "max": vector_struct(corners.max(axis=0))},
                "relative_pose": pose_struct(relative),
            }
        )
    return found


def _box(low: tuple[int, int], high: tuple[int, int]) -> Struct:
    return {name: {"x_val": float(x), "y_val": float(y)} for name, (x, y) in (("min", low), ("max", high))}
