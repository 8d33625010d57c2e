"""Parked aircraft: prototypes of unit length around the origin, nose to +x, wheels on z = 0, colours as tints."""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deckline.sim.ship.mesh import Mesh, at_height, bars, boxes, disc, frustum, join, loft

KINDS = {  # lengths, m, of aircraft of each kind
    "delta": 15.0,
    "swept": 18.3,
    "folded": 18.3,
    "propeller": 17.5,
    "propeller folded": 17.5,
    "helicopter": 17.0,
    "helicopter folded": 17.0,
    "trainer": 11.0,
}
GLASS = (0.12, 0.13, 0.16)
GREY = (0.85, 0.85, 0.85)


@lru_cache(maxsize=len(KINDS))
def prototype(kind: str) -> Mesh:
    """An aircraft of length 1; its greys are multiplied by an instance's colour.

    Raises:
        ValueError: an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"an aircraft's kind must be one of {tuple(KINDS)}, got {kind!r}")
    if kind.startswith("helicopter"):
        return helicopter(kind.endswith("folded"))
    if kind.startswith("propeller"):
        return propeller(kind.endswith("folded"))
    return jet(kind)


@lru_cache(maxsize=len(KINDS))
def extents(kind: str) -> tuple[float, float]:
    """Twice how far an aircraft of length 1 reaches from its origin, along and across."""
    along, across = 2 * np.abs(prototype(kind)[:, :2]).max(axis=0)
    return float(along), float(across)


def body(stations: ArrayLike, radii: ArrayLike, middles_z: ArrayLike, rgb: ArrayLike = (1.0, 1.0, 1.0)) -> Mesh:
    """A fuselage of hexagonal sections along x."""
    ring = disc(0.0, 0.0, 1.0, 6)
    x, r, z = (np.asarray(v, dtype=np.float64) for v in (stations, radii, middles_z))
    sections = [np.column_stack([np.full(6, x[k]), r[k] * ring[:, 0], z[k] + r[k] * ring[:, 1]]) for k in range(len(x))]
    return loft(sections, rgb)


def plate(outline: ArrayLike, z: float, thick: float = 0.012, rgb: ArrayLike = (0.95, 0.95, 0.95)) -> Mesh:
    """A flat wing of any convex outline (N, 2), its underside at z."""
    return loft([at_height(outline, z), at_height(outline, z - thick)], rgb)


def both(outline: ArrayLike) -> list[NDArray[np.float64]]:
    """A starboard outline (N, 2) and its mirror image."""
    points = np.asarray(outline, dtype=np.float64)
    return [points, points * [1.0, -1.0]]


def fin(x: float, y: float, base_z: float, chord: float, rise: float, cant: float = 0.0) -> Mesh:
    """A swept vertical tail."""
    corners = np.array([[0, 0], [chord, 0], [0.35 * chord, rise], [-0.15 * chord, rise]])
    faces = [
        np.column_stack([x + corners[:, 0], y + cant * corners[:, 1] + side, base_z - corners[:, 1]])
        for side in (-0.006, 0.006)
    ]
    return loft(faces, GREY)


def gear(nose_x: float, main_x: float, main_y: float, z: float) -> Mesh:
    """Three legs with wheels down to the deck."""
    feet = np.array([[nose_x, 0.0, 0.0], [main_x, main_y, 0.0], [main_x, -main_y, 0.0]])
    wheels = boxes(feet, (0.05, 0.02, 0.05), 0.0, (0.15, 0.15, 0.15))
    return join([bars(feet, feet + np.array([0.0, 0.0, z]), 0.014, GREY), wheels])


def jet(kind: str) -> Mesh:
    """A fighter with a delta, swept or folded wing, or a small trainer."""
    z = -0.135
    parts = [body([-0.5, -0.3, 0.1, 0.33, 0.5], [0.05, 0.062, 0.065, 0.04, 0.004], [z, z, z, z - 0.005, z + 0.005])]
    parts.append(body([0.12, 0.2, 0.3, 0.37], [0.01, 0.032, 0.03, 0.005], np.full(4, z - 0.05), GLASS))
    parts.append(gear(0.3, -0.1, 0.09, z))
    wing = {
        "delta": [[0.18, 0.05], [-0.33, 0.31], [-0.4, 0.31], [-0.4, 0.05]],
        "swept": [[0.12, 0.05], [-0.15, 0.36], [-0.26, 0.36], [-0.26, 0.05]],
        "folded": [[0.12, 0.05], [-0.04, 0.21], [-0.26, 0.21], [-0.26, 0.05]],
        "trainer": [[0.06, 0.05], [-0.06, 0.37], [-0.18, 0.37], [-0.16, 0.05]],
    }[kind]
    parts += [plate(half, z) for half in both(wing)]
    if kind == "folded":
        for side in (-1.0, 1.0):
            tip = np.array([[-0.04, 0.0], [-0.26, 0.0], [-0.26, 0.14], [-0.15, 0.14]])
            faces = [np.column_stack([tip[:, 0], np.full(4, side * y), z - tip[:, 1]]) for y in (0.2, 0.212)]
            parts.append(loft(faces, GREY))
    if kind != "delta":
        parts += [plate(half, z) for half in both([[-0.36, 0.05], [-0.46, 0.2], [-0.52, 0.2], [-0.5, 0.05]])]
    if kind in ("delta", "trainer"):
        parts.append(fin(-0.48, 0.0, z - 0.05, 0.2, 0.17))
    else:
        parts += [fin(-0.42, side * 0.075, z - 0.04, 0.17, 0.15, side * 0.3) for side in (-1.0, 1.0)]
        intakes = [[-0.1, side * 0.075, z + 0.05] for side in (-1.0, 1.0)]
        parts.append(boxes(intakes, (0.42, 0.05, 0.09), 0.0, GREY))
    nozzle = body([-0.515, -0.49], [0.045, 0.05], [z, z], (0.25, 0.25, 0.25))
    return join([*parts, nozzle])


def propeller(folded: bool) -> Mesh:
    """A twin turboprop with a rotating radome on its back."""
    z = -0.16
    parts = [body([-0.5, -0.25, 0.3, 0.45, 0.5], [0.02, 0.07, 0.075, 0.05, 0.01], [z - 0.05, z, z, z, z])]
    parts.append(body([0.36, 0.4, 0.46], [0.01, 0.04, 0.01], np.full(3, z - 0.035), GLASS))
    parts.append(gear(0.35, -0.02, 0.16, z))
    half = 0.27 if folded else 0.68
    parts += [plate(o, z - 0.06, 0.02) for o in both([[0.14, 0.0], [0.12, half], [0.01, half], [-0.02, 0.0]])]
    if folded:
        rear = [[0.0, 0.2], [-0.42, 0.22], [-0.42, 0.26], [0.0, 0.26]]
        parts += [loft([at_height(o, z - 0.15), at_height(o, z)], GREY) for o in both(rear)]
    for side in (-1.0, 1.0):
        nacelle = body([-0.12, 0.2, 0.26], [0.025, 0.045, 0.02], np.full(3, z - 0.05)).copy()
        nacelle[:, 1] += side * 0.19
        blades = np.array([[0.27, side * 0.19, z - 0.05]] * 4)
        tips = blades + 0.12 * np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        parts += [nacelle, bars(blades, tips, 0.018, (0.3, 0.3, 0.3))]
        parts.append(fin(-0.5, side * 0.2, z - 0.02, 0.12, 0.13))
    parts += [plate(o, z - 0.04) for o in both([[-0.38, 0.0], [-0.4, 0.24], [-0.5, 0.24], [-0.5, 0.0]])]
    dish = [at_height(disc(-0.1, 0.0, r, 12), z - up) for r, up in ((0.08, 0.14), (0.21, 0.165), (0.08, 0.195))]
    return join([*parts, loft(dish, (0.9, 0.9, 0.9)), boxes([[-0.1, 0.0, z - 0.05]], (0.06, 0.03, 0.1), 0.0, GREY)])


def helicopter(folded: bool) -> Mesh:
    """A transport helicopter with its rotor spread or folded aft."""
    z = -0.11
    parts = [
        body([-0.12, 0.0, 0.3, 0.42, 0.48], [0.05, 0.08, 0.085, 0.06, 0.01], [z - 0.02, z, z, z, z + 0.02]),
        body([-0.5, -0.1], [0.02, 0.045], [z - 0.07, z - 0.03]),
        body([0.28, 0.36, 0.44], [0.02, 0.06, 0.01], np.full(3, z - 0.025), GLASS),
        boxes([[0.1, 0.0, z - 0.06]], (0.25, 0.09, 0.07), 0.0, GREY),
        fin(-0.5, 0.0, z - 0.06, 0.1, 0.15),
        gear(-0.3, 0.2, 0.1, z),
        frustum(disc(0.12, 0.0, 0.02, 6), z - 0.1, disc(0.12, 0.0, 0.02, 6), z - 0.17, GREY),
    ]
    hub = np.array([0.12, 0.0, z - 0.165])
    angle = np.pi + np.linspace(-0.12, 0.12, 5) if folded else np.arange(5) * 2 * np.pi / 5 + 0.3
    reach = np.column_stack([np.cos(angle), np.sin(angle), np.full(5, 0.08)]) * (0.55 if folded else 0.48)
    parts.append(bars(np.tile(hub, (5, 1)), hub + reach, 0.022, (0.22, 0.22, 0.24)))
    tail = np.array([-0.49, 0.02, z - 0.2])
    spokes = 0.09 * np.array([[1, 0, 1], [-1, 0, -1], [1, 0, -1], [-1, 0, 1]])
    parts.append(bars(np.tile(tail, (4, 1)), tail + spokes, 0.015, (0.22, 0.22, 0.24)))
    return join(parts)
