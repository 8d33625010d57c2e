"""Latitude, longitude and altitude in a local North-East-Down world: the tangent plane at an origin.

Source: WGS 84 (NGA.STND.0036), geodetic to Earth-centred coordinates in closed form. Altitudes above mean sea level are
taken as ellipsoidal: over an airfield the geoid's height is one constant, which the origin's altitude takes away.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
SEMI_MAJOR_M, FLATTENING = 6378137.0, 1 / 298.257223563
GEODETIC_STEPS = 4  # 100 km from the origin within 1 mm


def ecef_from_geodetic(geodetic: Array) -> Array:
    """Latitude, longitude, degrees, and altitude, m, (N, 3) -> Earth-centred, Earth-fixed coordinates (N, 3), m."""
    lat, lon, alt = np.deg2rad(geodetic[:, 0]), np.deg2rad(geodetic[:, 1]), geodetic[:, 2]
    e2 = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_M / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    level = (normal + alt) * np.cos(lat)
    return np.column_stack([level * np.cos(lon), level * np.sin(lon), (normal * (1 - e2) + alt) * np.sin(lat)])


def ecef_from_ned(geodetic: Array) -> Rotation:
    """Rotations (N) from the local North-East-Down axes at latitudes and longitudes (N, 3), degrees."""
    return Rotation.from_euler("ZY", np.column_stack([geodetic[:, 1], -90.0 - geodetic[:, 0]]), degrees=True)


def ned_from_geodetic(
    geodetic: Array, rotations: Rotation, origin: tuple[float, float, float]
) -> tuple[Array, Rotation]:
    """Positions (N, 3), m, and attitudes (N) in the North-East-Down world of an origin.

    Args:
        geodetic: (N, 3) latitude, longitude, degrees, and altitude, m.
        rotations: (N) body to the local North-East-Down axes at each position.
        origin: latitude, longitude, degrees, and altitude, m.

    Raises:
        ValueError: latitudes or longitudes out of range.
    """
    outside = (np.abs(geodetic[:, :2]) > [90.0, 180.0]).any(axis=1)
    if outside.any():
        latitude, longitude = geodetic[outside][0, :2]
        raise ValueError(f"latitude must lie within 90 degrees, longitude within 180, got {latitude}, {longitude}")
    at = np.array([origin])
    ned_from_ecef = ecef_from_ned(at)[0].inv()
    positions = ned_from_ecef.apply(ecef_from_geodetic(geodetic) - ecef_from_geodetic(at))
    return positions, ned_from_ecef * ecef_from_ned(geodetic) * rotations


def geodetic_from_ned(position_m: Array, origin: tuple[float, float, float]) -> Array:
    """Latitude, longitude, degrees, and altitude, m, (3,) of a position (3,), m, North-East-Down of an origin.

    Newton's steps on `ecef_from_geodetic`; each moves by what is left along the local axes.
    """
    geodetic = np.array([origin], dtype=np.float64)
    target = ecef_from_geodetic(geodetic)[0] + ecef_from_ned(geodetic)[0].apply(position_m)
    for _ in range(GEODETIC_STEPS):
        north, east, down = ecef_from_ned(geodetic)[0].inv().apply(target - ecef_from_geodetic(geodetic)[0])
        latitude, _, altitude = geodetic[0]
        level_m = (SEMI_MAJOR_M + altitude) * np.cos(np.deg2rad(latitude))
        geodetic += [np.rad2deg(north / (SEMI_MAJOR_M + altitude)), np.rad2deg(east / level_m), -down]
    return np.asarray(geodetic[0])
