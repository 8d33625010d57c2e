"""An aircraft with flight dynamics: one of JSBSim's models, its state in the simulator's world.

The world is a plane, north, east, down from its origin; JSBSim's earth is an ellipsoid, entered at the equator. Over
the few kilometres of an approach its surface falls by less than 0.5 m, and height is measured above it. The steady wind
carries the air in which JSBSim flies: its aircraft is trimmed in still air, and its place moves on with the wind.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.extras import needs_extra

FT = 0.3048
M_PER_RAD_NORTH = 6335439.33  # meridian radius of WGS 84 at the equator
M_PER_RAD_EAST = 6378137.0  # equatorial radius of WGS 84
IN = 0.0254
KNOT = 1852 / 3600
DYNAMICS_HZ = 120.0
FASTEST_M_S = 340.0  # speed of sound: no flight model here is of faster flight, only one that diverges gets there
WHEELS = 3  # the first contacts of every model in `AIRCRAFT_TYPES`: nose, left, right


@dataclass(frozen=True)
class AircraftType:
    """How one of JSBSim's models is flown to a deck."""

    speed_kt: float
    """Calibrated airspeed on the approach."""
    hook_m: tuple[float, float, float]
    """Of the lowered hook's point from the centre of gravity, forward, right, down, m."""
    sink_limit_m_s: float
    """Sink over the deck that the gear bears, m/s."""

    @property
    def airspeed_m_s(self) -> float:
        """True airspeed close to the water, m/s."""
        return self.speed_kt * KNOT


# The A-4 lands at 130 kt. Its hook and the limit are our own: the model has no hook. 24 ft/s is what
# MIL-A-8863 asks of carrier aircraft's gear.
AIRCRAFT_TYPES = {"A4": AircraftType(130.0, (-3.5, 0.0, 1.6), 24 * FT)}


@dataclass(frozen=True)
class Controls:
    """Commands, -1 to 1, the throttle 0 to 1."""

    elevator: float = 0.0
    """Positive: nose down."""
    aileron: float = 0.0
    """Positive: right wing down."""
    rudder: float = 0.0
    """Positive: nose left."""
    throttle: float = 0.0
    """Of military power."""


@dataclass(frozen=True, eq=False)
class AircraftState:
    """Where an aircraft is and how it moves."""

    position_m: tuple[float, float, float]
    """Of the centre of gravity, world, m."""
    attitude_rad: tuple[float, float, float]
    """Roll, pitch, yaw."""
    velocity_m_s: tuple[float, float, float]
    """World, m/s."""
    rates_rad_s: tuple[float, float, float]
    """About the body's axes, rad/s."""
    airspeed_m_s: float
    """True airspeed, m/s."""
    load_factor: float
    """Lift in weights, as an accelerometer measures it: 1 in steady level flight."""

    @property
    def rotation(self) -> Rotation:
        """world_from_body without the position."""
        return Rotation.from_euler("ZYX", self.attitude_rad[::-1])

    @property
    def world_from_body(self) -> RigidTransform:
        """The pose."""
        return RigidTransform.from_components(self.position_m, self.rotation)

    @property
    def has_departed(self) -> bool:
        """Whether the flight model has diverged: a value that is not finite, or an airspeed that nothing flies."""
        parts = (*self.position_m, *self.attitude_rad, *self.velocity_m_s, *self.rates_rad_s, self.load_factor)
        return not (self.airspeed_m_s <= FASTEST_M_S and all(map(math.isfinite, parts)))


class Aircraft:
    """One flight of one of JSBSim's models.

    Args:
        model: a name of `AIRCRAFT_TYPES`.
        position_m: of the centre of gravity (3,), world, m.
        heading_rad: of the nose, rad.
        gamma_rad: flight path through the air, rad; negative: descending.
        wind_m_s: (3,) steady wind over the water, world, m/s.
        sea_z_m: world z of the water, on which the model's own wheels would stand.

    Raises:
        ValueError: an unknown model, or one that cannot be trimmed on this path.
    """

    def __init__(
        self,
        model: str,
        position_m: NDArray[np.float64],
        heading_rad: float,
        gamma_rad: float,
        wind_m_s: NDArray[np.float64],
        sea_z_m: float = 0.0,
    ) -> None:
        if model not in AIRCRAFT_TYPES:
            raise ValueError(f"unknown aircraft {model!r}: use one of {', '.join(AIRCRAFT_TYPES)}")
        with needs_extra("sim"):
            import jsbsim
        self.type = AIRCRAFT_TYPES[model]
        jsbsim.FGJSBBase().debug_lvl = 0  # no banner
        self._fdm = jsbsim.FGFDMExec(None)
        self._fdm.load_model(model)
        self._fdm.set_dt(1 / DYNAMICS_HZ)
        self._wind_m_s = tuple(wind_m_s.tolist())
        self._steps = 0
        self._fdm["ic/terrain-elevation-ft"] = -sea_z_m / FT
        self._start(position_m, heading_rad, gamma_rad)
        try:
            self._fdm["simulation/do_simple_trim"] = 1
        except jsbsim.TrimFailureError:
            raise ValueError(
                f"aircraft {model} cannot be trimmed at {self.type.speed_kt:g} kt and "
                f"{math.degrees(gamma_rad):.1f} degrees"
            ) from None
        self.trim_throttle = self._fdm["fcs/throttle-cmd-norm[0]"]
        self.wheels_m = self._wheels()
        self.state = self._read()

    def _start(self, position_m: NDArray[np.float64], heading_rad: float, gamma_rad: float) -> None:
        fdm = self._fdm
        fdm["ic/lat-geod-rad"] = position_m[0] / M_PER_RAD_NORTH
        fdm["ic/long-gc-rad"] = position_m[1] / M_PER_RAD_EAST
        fdm["ic/h-sl-ft"] = -position_m[2] / FT
        fdm["ic/psi-true-rad"] = heading_rad
        fdm["ic/vc-kts"] = self.type.speed_kt
        fdm["ic/gamma-rad"] = gamma_rad
        for part in ("gear/gear-cmd-norm", "gear/gear-pos-norm", "fcs/flap-cmd-norm", "fcs/flap-pos-norm"):
            fdm[part] = 1.0
        fdm["propulsion/set-running"] = -1
        fdm.run_ic()

    def _wheels(self) -> NDArray[np.float64]:
        """Lowest points (N, 3) of nose and main wheels from the centre of gravity, body, m."""
        fdm = self._fdm
        centre = np.array([fdm[f"inertia/cg-{axis}-in"] for axis in "xyz"])
        wheels = [[fdm[f"gear/unit[{k}]/{axis}-position"] for axis in "xyz"] for k in range(WHEELS)]
        return (np.array(wheels) - centre) * [-IN, IN, -IN]  # structural: aft, right, up

    def step(self, controls: Controls, gust_m_s: tuple[float, float, float]) -> AircraftState:
        """Fly on for 1 / DYNAMICS_HZ in air that moves with `gust_m_s` (3,), world, m/s, beside the steady wind."""
        fdm = self._fdm
        fdm["fcs/elevator-cmd-norm"] = controls.elevator
        fdm["fcs/aileron-cmd-norm"] = controls.aileron
        fdm["fcs/rudder-cmd-norm"] = controls.rudder
        fdm["fcs/throttle-cmd-norm[0]"] = controls.throttle
        north, east, down = gust_m_s
        fdm["atmosphere/wind-north-fps"], fdm["atmosphere/wind-east-fps"] = north / FT, east / FT
        fdm["atmosphere/wind-down-fps"] = down / FT
        fdm.run()
        self._steps += 1
        self.state = self._read()
        return self.state

    def _read(self) -> AircraftState:
        fdm, (north, east, down), flown_s = self._fdm, self._wind_m_s, self._steps / DYNAMICS_HZ
        return AircraftState(
            (
                fdm["position/lat-geod-rad"] * M_PER_RAD_NORTH + north * flown_s,
                fdm["position/long-gc-rad"] * M_PER_RAD_EAST + east * flown_s,
                -fdm["position/h-sl-ft"] * FT + down * flown_s,
            ),
            (fdm["attitude/phi-rad"], fdm["attitude/theta-rad"], fdm["attitude/psi-rad"]),
            (
                fdm["velocities/v-north-fps"] * FT + north,
                fdm["velocities/v-east-fps"] * FT + east,
                fdm["velocities/v-down-fps"] * FT + down,
            ),
            (fdm["velocities/p-rad_sec"], fdm["velocities/q-rad_sec"], fdm["velocities/r-rad_sec"]),
            fdm["velocities/vt-fps"] * FT,
            fdm["accelerations/Nz"],
        )
