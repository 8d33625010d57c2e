"""Runways projected through a camera to the points of a detector, without rendering; nothing of the model's equations.

World: the runway's frame, x along the landing from the ramp, y to the right, z down.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from deckline.config import Deck, RunConfig
from deckline.dehaze.horizon import Horizon, NoHorizon
from deckline.geometry import Camera, attitude, camera_mount
from deckline.localize import localize
from deckline.localize.ransac import least_squares_line
from deckline.localize.solver import CORRELATION
from deckline.picture_pose import PictureAnswer, PictureTracker
from deckline.picture_pose.model import Mount
from deckline.picture_pose.sights import HorizonSight, LineSight, sight_horizon, sight_lines
from deckline.picture_pose.states import DIP_RAD, Belief, States, initial_belief, shared_sigmas
from deckline.types import SIDES, Detection, Diagnostics, Frame, LinePoints, PixelLine, Reason
from runway_scene import horizon_line, spaced_pixels

CAMERA = Camera.from_fov(1280, 720, np.deg2rad(60))
MOUNT = camera_mount([0.4, 0.1, 0.2], Rotation.from_euler("y", -0.05))
LEVEL = RunConfig(deck=Deck(sea_state=0.0, width_m=20.0))
IN_WIDTHS = RunConfig(deck=Deck(sea_state=0.0))
SIGMA_PX = 0.5
SPEED_M_S, GLIDESLOPE, TOUCHDOWN_M = 40.0, np.tan(np.deg2rad(3.5)), 70.0
RATE_HZ = 10.0


@dataclass(frozen=True)
class Runway:
    """Two lines on a plane."""

    width_m: float = 20.0  # at the ramp
    angle_rad: float = 0.0  # right line's azimuth minus left line's
    slope: float = 0.0  # of the deck's z along the lines
    cant: float = 0.0  # and to their right
    length_m: float = 220.0
    painted_m: tuple[float, float] = (0.0, 0.0)  # how far right of their place left and right line are painted


@dataclass(frozen=True)
class Place:
    """Where the aircraft is."""

    distance_m: float = 200.0
    lateral_m: float = 3.0
    height_m: float = 15.0
    roll: float = 0.02
    pitch: float = 0.01
    heading: float = 0.03

    @property
    def position_m(self) -> np.ndarray:
        """(3,) as `States.PLACE`."""
        return np.array([self.distance_m, self.lateral_m, self.height_m])


LEVEL_RUNWAY, BEFORE_RAMP = Runway(), Place()


def pose_of(place: Place, runway: Runway = LEVEL_RUNWAY) -> RigidTransform:
    """world_from_body."""
    z = -place.height_m - place.distance_m * runway.slope
    at = [-place.distance_m, place.lateral_m, z]
    return RigidTransform.from_components(at, attitude(place.roll, place.pitch, place.heading))


def line_of(runway: Runway, side: str, count: int = 4000) -> np.ndarray:
    """Points (N, 3) of an edge line, from the ramp."""
    x = np.linspace(0.0, runway.length_m, count)
    index = SIDES.index(side)
    y = (2 * index - 1) * (runway.width_m / 2 + np.tan(runway.angle_rad / 2) * x) + runway.painted_m[index]
    return np.column_stack([x, y, runway.slope * x + runway.cant * y])


def see(
    place: Place = BEFORE_RAMP,
    runway: Runway = LEVEL_RUNWAY,
    camera: Camera = CAMERA,
    mount: RigidTransform = MOUNT,
    rng: np.random.Generator | None = None,
    count: int = 24,
    sigma_px: float = SIGMA_PX,
) -> Detection:
    """What a detector finds in evenly spaced rows; with `rng` u errs as stated."""
    view = (pose_of(place, runway) * mount).inv()
    return Detection(*(_points(view.apply(line_of(runway, side)), camera, rng, count, sigma_px) for side in SIDES))


def _points(
    optical_m: np.ndarray, camera: Camera, rng: np.random.Generator | None, count: int, sigma_px: float
) -> LinePoints:
    chosen = spaced_pixels(camera, optical_m, count)
    if not len(chosen):
        return LinePoints.empty()
    if rng is not None:
        chosen = chosen + np.column_stack([sigma_px * correlated(rng, count), np.zeros(count)])
    return LinePoints(chosen, np.full(count, 0.9), np.full(count, sigma_px))


def correlated(rng: np.random.Generator, count: int) -> np.ndarray:
    """Normal numbers (count,) of 1-sigma 1 whose neighbours have the correlation that the fit expects."""
    numbers = rng.normal(size=count)
    for index in range(1, count):
        numbers[index] = CORRELATION * numbers[index - 1] + np.sqrt(1 - CORRELATION**2) * numbers[index]
    return numbers


def pixel_lines(detection: Detection) -> dict[str, PixelLine]:
    """Lines through all points, of a lens without distortion."""
    found = {}
    for side in SIDES:
        points = getattr(detection, side)
        if len(points):
            line = least_squares_line(points.points_px)
            found[side] = PixelLine(line, np.ones(len(points), bool), points.points_px[[0, -1]], SIGMA_PX)
    return found


def sights_of(detection: Detection, camera: Camera = CAMERA) -> dict[str, LineSight]:
    """The lines as the fit takes them."""
    return sight_lines(camera, detection, pixel_lines(detection))


def horizon_of(
    place: Place, camera: Camera = CAMERA, mount: RigidTransform = MOUNT, rng: np.random.Generator | None = None
) -> Horizon:
    """The sea's horizon `DIP_RAD` below level in the picture; with `rng` it errs by its sigma."""
    middle, slope = horizon_line(camera, (pose_of(place) * mount).rotation, DIP_RAD)
    sigma_px, slope_sigma = 1.0, 0.0015
    off = np.zeros(2) if rng is None else rng.normal(0, [sigma_px, slope_sigma])
    return Horizon(camera.width, float(middle + off[0]), sigma_px, float(slope + off[1]), slope_sigma)


def horizon_sight(
    place: Place, camera: Camera = CAMERA, mount: RigidTransform = MOUNT, rng: np.random.Generator | None = None
) -> HorizonSight:
    """The same as the fit takes it: by the stated camera."""
    return sight_horizon(CAMERA, horizon_of(place, camera, mount, rng))


def belief_of(
    place: Place = BEFORE_RAMP, runway: Runway = LEVEL_RUNWAY, config: RunConfig = LEVEL, time_s: float = 0.0
) -> Belief:
    """A belief at the truth that knows nothing but what is stated."""
    rotation = attitude(place.roll, place.pitch, place.heading).as_matrix()
    start = initial_belief(time_s, rotation, place.position_m, shared_sigmas(CAMERA, config), config)
    mean = start.mean.copy()
    mean[[States.WIDTH, States.ANGLE]] = runway.width_m, runway.angle_rad
    mean[[States.SLOPE, States.CANT]] = runway.slope, runway.cant
    return replace(start, mean=mean)


CAMERA_MOUNT = Mount.of(MOUNT)


def draw_place(rng: np.random.Generator, roll_sigma: float = np.deg2rad(2.0)) -> Place:
    """Somewhere on an approach."""
    distance = rng.uniform(40.0, 300.0)
    height = (distance + TOUCHDOWN_M) * GLIDESLOPE * rng.uniform(0.7, 1.3)
    lateral = rng.uniform(-0.05, 0.05) * distance
    return Place(distance, lateral, height, rng.normal(0, roll_sigma), rng.normal(0, 0.02), rng.normal(0, 0.04))


def is_near(belief: Belief, place: Place, sigmas: float) -> bool:
    """Whether no error is larger than so many of its 1-sigma."""
    off, sigma = errors_of(belief, place)
    return bool(np.all(np.abs(off) < sigmas * sigma))


def errors_of(belief: Belief, place: Place) -> tuple[np.ndarray, np.ndarray]:
    """Errors of lateral deviation, height, roll, pitch, heading (about the runway's axes), and their 1-sigma (5,)."""
    true = attitude(place.roll, place.pitch, place.heading)
    turn = (Rotation.from_matrix(belief.rotation) * true.inv()).as_rotvec()
    off = np.array([*(belief.mean[States.PLACE] - place.position_m)[1:], *turn])
    index = [States.LATERAL, States.HEIGHT, *range(States.SIZE)[States.ATTITUDE]]
    return off, np.sqrt(np.diag(belief.covariance)[index])


def fly(start_m: float = 300.0, lateral_m: float = 3.0, shake: float = 1.0, seed: int = 0) -> Callable[[float], Place]:
    """The place at a time of an approach at `SPEED_M_S` that sways and shakes."""
    phase = np.random.default_rng([seed, 1]).uniform(0, 2 * np.pi, 5)

    def place(time_s: float) -> Place:
        sway = np.sin(2 * np.pi * np.array([0.06, 0.05, 0.23, 0.19, 0.31]) * time_s + phase)
        distance = start_m - SPEED_M_S * time_s
        height = (distance + TOUCHDOWN_M) * GLIDESLOPE + 0.5 * sway[1]
        roll, pitch, heading = shake * np.deg2rad([1.5, 0.5, 0.5]) * sway[2:]
        return Place(distance, lateral_m * sway[0], height, roll, pitch + 0.01, heading)

    return place


def frame_at(time_s: float, camera: Camera = CAMERA, mount: RigidTransform = MOUNT) -> Frame:
    """A frame without a pose, whose first pixel holds its time in hundredths of a second."""
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    image[0, 0, :2] = divmod(round(100 * time_s), 256)
    return Frame(f"{time_s:.3f}.png", time_s, image, camera, mount)


class Follower:
    """A tracker and what its frames show. `horizon` replaces the search in the picture: that of a time, s.

    Args:
        config: of the tracker.
        patch: pytest's monkeypatch.
        horizon: None: no picture has one.
    """

    def __init__(
        self,
        config: RunConfig,
        patch: pytest.MonkeyPatch,
        horizon: Callable[[float], Horizon | NoHorizon] = lambda _: NoHorizon("none is drawn"),
    ) -> None:
        self.config, self.tracker = config, PictureTracker(config)

        def find(image_rgb: np.ndarray, rough: bool = False) -> Horizon | NoHorizon:
            high, low = image_rgb[0, 0, :2].tolist()
            return horizon((256 * high + low) / 100)

        patch.setattr("deckline.dehaze.horizon_search.find_horizon", find)
        patch.setattr("deckline.picture_pose.tracker.find_horizon", find)

    @property
    def belief(self) -> Belief:
        memory = self.tracker._memory
        assert memory is not None
        return memory.belief

    def __call__(self, frame: Frame, detection: Detection, flags: Diagnostics = ()) -> PictureAnswer:
        estimate = localize(frame, detection, self.config, np.random.default_rng(0))
        return self.tracker.update(frame, detection, estimate, flags)

    def follow(
        self,
        flight: Callable[[float], Place],
        times: Iterable[float],
        rng: np.random.Generator | None = None,
        runway: Runway = LEVEL_RUNWAY,
    ) -> list[PictureAnswer]:
        """The answers of the frames of some times."""
        return [self(frame_at(time_s), see(flight(time_s), runway, rng=rng)) for time_s in times]


FLIGHT = fly()


def with_horizon(
    patch: pytest.MonkeyPatch,
    config: RunConfig = LEVEL,
    flight: Callable[[float], Place] = FLIGHT,
    seed: int | None = None,
) -> Follower:
    """A follower whose pictures show the horizon of a flight."""
    rng = None if seed is None else np.random.default_rng([seed, 8])
    return Follower(config, patch, lambda time_s: horizon_of(flight(time_s), rng=rng))


def seconds(start_s: float, end_s: float) -> np.ndarray:
    """Times of the frames from `start_s` to before `end_s`."""
    return np.round(np.arange(round(start_s * RATE_HZ), round(end_s * RATE_HZ)) / RATE_HZ, 6)


def reasons(diagnostics: Diagnostics) -> list[Reason]:
    return [diagnostic.reason for diagnostic in diagnostics]
