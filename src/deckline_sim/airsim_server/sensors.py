"""The vehicle's sensors with AirSim's default errors, GPS with an error that AirSim does not add, and the standard air.

A sensor draws one reading for each simulated time; two readings at one time are equal.
Source of the values: AirSim's documented defaults; of the pressure: ICAO standard atmosphere; of the magnetic field:
the dipole of IGRF-13, epoch 2020, good to 15 degrees and 20 %.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deckline_sim.airsim_server.kinematics import GRAVITY_M_S2, VehicleMotion
from deckline_sim.airsim_server.settings import DistanceSetting
from deckline_sim.airsim_server.structs import Struct, geo_struct, pose_struct, vector_struct
from deckline_sim.airsim_server.world import World

IMU_STEP_S = 0.003  # AirSim's physics step, for which white noise is drawn
GYRO_WALK = math.radians(0.30) / 60.0  # rad/s for a step of 1 s: 0.30 deg per root hour
GYRO_BIAS = math.radians(4.6) / 3600.0 / math.sqrt(500.0)  # rad/s in 1 s: 4.6 deg/h in 500 s
ACCELERATION_WALK = 0.24e-3 * GRAVITY_M_S2  # m/s^2 for a step of 1 s
ACCELERATION_BIAS = 36e-6 * GRAVITY_M_S2 / math.sqrt(800.0)  # m/s^2 in 1 s: 36 ug in 800 s
GPS_START_M, GPS_END_M, GPS_TIME_S, GPS_LATENCY_S = 100.0, 0.1, 0.9, 0.2  # 1-sigma falls from start to end
FIX_3D_M, FIX_2D_M = 3.0, 4.0
PRESSURE_DRIFT, PRESSURE_DRIFT_S = 0.0365 / 20.0, 3600.0  # of the pressure; first-order Gauss-Markov
PRESSURE_NOISE_PA = 2.7
MAGNETIC_NOISE_GAUSS = 0.005
DISTANCE_NOISE_M = 0.2
SEA_LEVEL_PA, SEA_LEVEL_K, LAPSE_K_M, PRESSURE_EXPONENT = 101325.0, 288.15, 0.0065, 5.255877
AIR_GAS_CONSTANT = 287.053  # J/(kg K)
DIPOLE_GAUSS = np.array([-1450.9, 4652.5, -29404.8]) * 1e-5  # g11, h11, g10

Origin = tuple[float, float, float]


class SimulatedSensors:
    """Reads the sensors; only on one thread.

    Args:
        seed: of the noise.
    """

    def __init__(self, world: World, seed: int) -> None:
        self._world, self._seed = world, seed
        self.reset()

    def reset(self) -> None:
        """Restart every sensor now."""
        self._rng = np.random.default_rng([self._seed, 41451])
        self._started_s = self._world.clock.seconds()
        self._last: dict[str, tuple[float, Struct]] = {}  # time and reading by sensor
        self._gyro_bias, self._acceleration_bias, self._pressure_drift = np.zeros(3), np.zeros(3), 0.0

    def read(self, name: str, motion: VehicleMotion, measure: Callable[[VehicleMotion, float], Struct]) -> Struct:
        """The reading of a sensor at `motion.time_s`, with a time stamp; `measure` also gets the s passed."""
        before_s, reading = self._last.get(name, (self._started_s, {}))
        if not reading or motion.time_s > before_s:
            stamp = {"time_stamp": self._world.clock.nanoseconds(motion.time_s)}
            reading = measure(motion, motion.time_s - before_s) | stamp
            self._last[name] = motion.time_s, reading
        return reading

    def imu(self, motion: VehicleMotion, passed_s: float) -> Struct:
        """ImuData: specific force and rates about the body's axes; the orientation is true, as AirSim's."""
        turn = motion.pose.rotation
        force = turn.inv().apply(motion.acceleration - [0.0, 0.0, GRAVITY_M_S2])
        white, root = 1.0 / math.sqrt(IMU_STEP_S), math.sqrt(passed_s)
        noise = self._rng.normal(size=(4, 3))
        self._gyro_bias = self._gyro_bias + GYRO_BIAS * root * noise[0]
        self._acceleration_bias = self._acceleration_bias + ACCELERATION_BIAS * root * noise[1]
        rates = motion.rates + self._gyro_bias + GYRO_WALK * white * noise[2]
        force = force + self._acceleration_bias + ACCELERATION_WALK * white * noise[3]
        return {
            "orientation": pose_struct(motion.pose)["orientation"],
            "angular_velocity": vector_struct(rates),
            "linear_acceleration": vector_struct(force),
        }

    def gps(self, motion: VehicleMotion, passed_s: float) -> Struct:
        """GpsData, delayed by the latency. The error has the stated accuracy; AirSim adds none."""
        on_s = motion.time_s - self._started_s
        sigma_m = GPS_END_M + (GPS_START_M - GPS_END_M) * math.exp(-on_s / GPS_TIME_S)
        error = sigma_m * self._rng.normal(size=3)
        position = motion.pose.translation - GPS_LATENCY_S * motion.velocity + error
        return {
            "gnss": {
                "geo_point": geo_struct(position, self._world.settings.origin),
                "eph": sigma_m,
                "epv": sigma_m,
                "velocity": vector_struct(motion.velocity),
                "fix_type": 3 if sigma_m <= FIX_3D_M else 2 if sigma_m <= FIX_2D_M else 0,
                "time_utc": self._world.clock.nanoseconds(motion.time_s - GPS_LATENCY_S) // 1000,
            },
            "is_valid": True,
        }

    def barometer(self, motion: VehicleMotion, passed_s: float) -> Struct:
        """BarometerData: pressure, Pa, its pressure altitude, m, and the sea-level pressure, hPa."""
        decay = math.exp(-passed_s / PRESSURE_DRIFT_S)
        drift, noise = self._rng.normal(size=2)
        self._pressure_drift = decay * self._pressure_drift + PRESSURE_DRIFT * math.sqrt(1.0 - decay**2) * drift
        altitude_m = self._world.settings.origin[2] - motion.pose.translation[2]
        pressure = standard_air(altitude_m)[0] * (1.0 + self._pressure_drift) + PRESSURE_NOISE_PA * noise
        altitude_m = (1.0 - (pressure / SEA_LEVEL_PA) ** (1.0 / PRESSURE_EXPONENT)) * SEA_LEVEL_K / LAPSE_K_M
        return {"altitude": altitude_m, "pressure": pressure, "qnh": SEA_LEVEL_PA / 100.0}

    def magnetometer(self, motion: VehicleMotion, passed_s: float) -> Struct:
        """MagnetometerData, gauss along the body's axes."""
        field = motion.pose.rotation.inv().apply(magnetic_field(self._world.settings.origin))
        noise = MAGNETIC_NOISE_GAUSS * self._rng.normal(size=3)
        return {"magnetic_field_body": vector_struct(field + noise), "magnetic_field_covariance": []}

    def distance(self, setting: DistanceSetting, true_m: float) -> Struct:
        """DistanceSensorData of a true distance, m; NaN: nothing there."""
        measured = true_m + DISTANCE_NOISE_M * float(self._rng.normal())
        measured = setting.farthest_m if math.isnan(true_m) else measured
        return {
            "distance": float(np.clip(measured, setting.nearest_m, setting.farthest_m)),
            "min_distance": setting.nearest_m,
            "max_distance": setting.farthest_m,
            "relative_pose": pose_struct(setting.mount),
        }


def standard_air(altitude_m: float) -> tuple[float, float, float]:
    """Pressure, Pa, temperature, K, and density, kg/m^3, of the standard atmosphere below 11 km."""
    temperature = SEA_LEVEL_K - LAPSE_K_M * min(altitude_m, 11e3)
    pressure = SEA_LEVEL_PA * (temperature / SEA_LEVEL_K) ** PRESSURE_EXPONENT
    return pressure, temperature, pressure / (AIR_GAS_CONSTANT * temperature)


def magnetic_field(origin: Origin) -> NDArray[np.float64]:
    """The Earth's dipole field (3,), north, east, down, gauss, at a latitude and longitude, deg, at sea level."""
    latitude, longitude = np.deg2rad(origin[:2])
    (sin, cos), (s, c) = ((np.sin(angle), np.cos(angle)) for angle in (latitude, longitude))
    up = np.array([cos * c, cos * s, sin])
    field = 3.0 * (DIPOLE_GAUSS @ up) * up - DIPOLE_GAUSS
    return np.array([[-sin * c, -sin * s, cos], [-s, c, 0.0], -up]) @ field


def environment_struct(motion: VehicleMotion, origin: Origin) -> Struct:
    """EnvironmentState."""
    place = geo_struct(motion.pose.translation, origin)
    pressure, temperature, density = standard_air(place["altitude"])
    return {
        "position": vector_struct(motion.pose.translation),
        "geo_point": place,
        "gravity": vector_struct([0.0, 0.0, GRAVITY_M_S2]),
        "air_pressure": pressure,
        "temperature": temperature,
        "air_density": density,
    }
