"""Views of a landing from outside: from the deck, and from behind the aircraft."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deckline.geometry import Camera
from deckline.report.annotators import resize
from deckline.report.draw import Image
from deckline.report.overlay import PANEL_PX
from deckline.types import Frame
from deckline_sim.flight.viewpoints import Viewpoint, pose_towards, runway_point
from deckline_sim.landing.airframe import airframe_mesh, draw_aircraft
from deckline_sim.landing.landing import Sample
from deckline_sim.landing.surroundings import Surroundings, frame_name

RENDERED_PX = (480, 270)  # width, height; the film shows them larger
# The deck's camera, m: past the touchdown point, outside the left line, above the deck.
DECK_CAMERA_M = (40.0, 2.0, 4.0)
DECK_VIEW_M = 50.0  # that its picture shows across at the aircraft, as far as its fields of view, degrees, allow
DECK_FOV_DEG = (14.0, 65.0)
CHASE_M = (26.0, 6.0)  # the other camera: behind and above the aircraft
CHASE_AIM_M = (30.0, -2.0)  # ahead of and above the aircraft: what it points at
CHASE_FOV_DEG = 50.0

TakePicture = Callable[[Viewpoint, str], Frame]  # renders a view of a landing under a name


def pilot_view(scene: Surroundings, sample: Sample) -> Viewpoint:
    """What the aircraft's camera sees, in a small picture of its proportions."""
    camera, width = scene.camera, RENDERED_PX[0]
    small = camera.resized(width, max(round(width * camera.height / camera.width), 2))
    velocity, rates = np.array(sample.state.velocity_m_s), np.array(sample.state.rates_rad_s)
    return Viewpoint(sample.state.world_from_body, small, sample.time_s, scene.body_from_camera, velocity, rates)


def deck_view(scene: Surroundings, sample: Sample) -> Viewpoint:
    """From beside the touchdown point towards the aircraft, closer in the farther it is."""
    layout = scene.deck.moved_layout(sample.time_s)
    beyond, outside, above = DECK_CAMERA_M
    right = -(layout.spacing_m / 2 + outside)
    eye = runway_point(layout, scene.deck.touchdown_m + beyond, right, above)
    aim = np.array(sample.state.position_m)
    across = 2 * np.arctan2(DECK_VIEW_M / 2, np.linalg.norm(aim - eye))
    return _towards(sample, eye, aim, float(np.clip(np.rad2deg(across), *DECK_FOV_DEG)))


def chase_view(scene: Surroundings, sample: Sample) -> Viewpoint:
    """From behind and above the aircraft along the landing direction."""
    along, place = np.array([*scene.deck.landing_direction, 0.0]), np.array(sample.state.position_m)
    up = np.array([0.0, 0.0, -1.0])
    eye, aim = (place + ahead * along + above * up for ahead, above in ((-CHASE_M[0], CHASE_M[1]), CHASE_AIM_M))
    return _towards(sample, eye, aim, CHASE_FOV_DEG)


def draw_outside(scene: Surroundings, sample: Sample, view: Viewpoint, take: TakePicture) -> Image:
    """The picture of a view with the aircraft in it, as large as a panel of the film."""
    frame = take(view, frame_name(scene.seed, sample.time_s))
    airlight = (255.0, 255.0, 255.0)
    if frame.truth is not None and frame.truth.airlight_rgb is not None:
        airlight = frame.truth.airlight_rgb
    return draw_aircraft(
        resize(frame.image_rgb, PANEL_PX),
        airframe_mesh(scene.config.aircraft),
        sample.state.world_from_body,
        view.camera.resized(*PANEL_PX),
        view.world_from_camera,
        airlight,
        scene.config.visibility_m,
    )


def _towards(sample: Sample, eye: NDArray[np.float64], aim: NDArray[np.float64], fov_deg: float) -> Viewpoint:
    """A level camera at a place (3,) that points at another, world, m."""
    camera = Camera.from_fov(*RENDERED_PX, np.deg2rad(fov_deg))
    return Viewpoint(
        pose_towards(eye, aim, np.zeros(3)), camera, sample.time_s, velocity_m_s=np.array(sample.state.velocity_m_s)
    )
