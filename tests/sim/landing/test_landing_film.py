"""The film of a landing, with a stand-in for the renderer."""

from dataclasses import replace

import numpy as np
import pytest

from deckline.geometry import wrap_angle
from deckline.recording.images import encode_image
from deckline.report.video import count_pictures
from deckline.types import DepthMode, Frame, Guidance, Status, Truth
from deckline_sim.flight.viewpoints import runway_point
from deckline_sim.landing.aircraft import AircraftState
from deckline_sim.landing.autopilot import WaveOff
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.film import (
    FILM_HZ,
    FILM_PX,
    HELD_S,
    FilmedLanding,
    draw_film,
    film_samples,
    is_broken_off,
    shown_answer,
    write_film,
)
from deckline_sim.landing.film_views import DECK_FOV_DEG, chase_view, deck_view, pilot_view
from deckline_sim.landing.landing import Landing, Sample
from deckline_sim.landing.recorded_sight import PilotPicture, RecordedSight
from deckline_sim.landing.sight import Moment
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome, Touchdown

SCENE = surroundings(LandingConfig(visibility_m=800.0), 3)
LENGTH_S = 0.5


def sample_at(time_s, to_go_m=60.0):
    """On the centre line, 5 m above the deck."""
    deck = SCENE.deck
    place = runway_point(deck.moved_layout(time_s), deck.touchdown_m - to_go_m, 0.0, 5.0)
    heading = float(np.arctan2(*deck.landing_direction[::-1]))
    velocity = 60.0 * np.array([*deck.landing_direction, 0.0])
    state = AircraftState(tuple(place), (0.0, 0.1, heading), tuple(velocity), (0.0, 0.0, 0.0), 65.0, 1.0)
    return Sample(time_s, state, None)


def answer_at(time_s):
    return Guidance(time_s, Status.UNVERIFIED, DepthMode.COARSE)


def landing(outcome=Outcome.WIRE, wave_off=None):
    contact = Touchdown(LENGTH_S, 1.0, 0.5, 3.0, 2) if outcome is Outcome.WIRE else None
    samples = tuple(sample_at(k / 30) for k in range(round(LENGTH_S * 30) + 1))
    return Landing(outcome, contact, wave_off, False, None, 0.0, 0, LENGTH_S, samples)


def filmed(**values):
    answers = [answer_at(k / 10) for k in range(4)]
    return replace(FilmedLanding(SCENE, landing(), answers, last_seen_s=0.3), **values)


class StandIn:
    """Renders even pictures: grey 120, without haze 40."""

    def __init__(self):
        self.views = []

    def __call__(self, view, name):
        self.views.append(view)
        size = (view.camera.height, view.camera.width, 3)
        truth = Truth(airlight_rgb=(200.0, 200.0, 200.0), clear_rgb=np.full(size, 40, np.uint8))
        image = np.full(size, 120, np.uint8)
        return Frame(name, view.time_s, image, view.camera, view.body_from_camera, truth=truth)


def test_a_film_has_its_pictures_and_holds_the_last_one(tmp_path):
    pictures = list(draw_film(filmed(), StandIn()))
    moving = round(LENGTH_S * FILM_HZ) + 1
    assert len(pictures) == moving + round(HELD_S * FILM_HZ)
    assert {image.shape for image, _ in pictures} == {(FILM_PX[1], FILM_PX[0], 3)}
    times = [time_s for _, time_s in pictures]
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 1 / FILM_HZ), abs=0.02)
    assert times[-1] == pytest.approx(LENGTH_S + HELD_S)
    assert all(np.array_equal(image, pictures[-1][0]) for image, _ in pictures[moving:])
    path = tmp_path / "film.mp4"
    assert write_film(filmed(), StandIn(), path) == count_pictures(path) == len(pictures)


def test_samples_of_a_film_end_with_the_last_one():
    flown = landing().samples
    chosen = film_samples(flown[:-1])
    assert chosen[-1] is flown[-2]
    assert [sample.time_s for sample in chosen[:-1]] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert film_samples(flown[:1]) == [flown[0]]


def test_the_pilots_panels_show_the_recorded_pictures():
    hazy, marked = (encode_image(np.full((360, 640, 3), level, np.uint8), "jpg", 95) for level in (90, 30))
    renderer = StandIn()
    image, _ = next(iter(draw_film(filmed(pictures=[PilotPicture(0.0, hazy, marked)]), renderer)))
    assert len(renderer.views) == 2
    assert image[200, 300] == pytest.approx(np.full(3, 90), abs=2)
    assert image[200, 900] == pytest.approx(np.full(3, 30), abs=2)
    image, _ = next(iter(draw_film(filmed(), renderer)))
    assert len(renderer.views) == 5
    assert (image[200, 300, 0], image[200, 900, 0]) == (120, 40)


def test_answers_are_shown_when_they_arrive():
    film, late_s = filmed(), SCENE.config.camera.latency_s
    assert shown_answer(film, late_s - 0.01).status is Status.NOT_SEEN
    assert shown_answer(film, 0.2 + late_s).time_s == 0.2
    assert shown_answer(film, 9.0).time_s == pytest.approx(0.3)


def test_nothing_is_shown_after_the_pass_is_broken_off():
    film = filmed(landing=landing(Outcome.WAVE_OFF, WaveOff.NOT_SEEN))
    assert not is_broken_off(film, 0.4)
    assert is_broken_off(film, 0.45)
    assert shown_answer(film, 0.45).status is Status.NOT_SEEN
    assert not is_broken_off(filmed(), 0.45)


@pytest.mark.parametrize("view", [deck_view, chase_view])
@pytest.mark.parametrize("to_go_m", [800.0, 100.0, 0.0, -20.0])
def test_the_aircraft_is_in_the_views_from_outside(view, to_go_m):
    sample = sample_at(1.0, to_go_m)
    made = view(SCENE, sample)
    (pixel,) = made.camera.project(made.world_from_camera.inv().apply([sample.state.position_m]))
    assert np.all(pixel > 0)
    assert np.all(pixel < (made.camera.width, made.camera.height))
    assert made.world_from_body.rotation.as_euler("ZYX")[2] == pytest.approx(0.0, abs=1e-9)  # level


def test_the_decks_view_is_closer_in_the_farther_the_aircraft_is():
    fov = [deck_view(SCENE, sample_at(0.0, to_go)).camera.fov_deg for to_go in (800.0, 100.0, 0.0)]
    assert fov[0] == pytest.approx(DECK_FOV_DEG[0])
    assert fov[0] < fov[1] < fov[2]


def test_the_chase_view_looks_along_the_landing():
    made = chase_view(SCENE, sample_at(0.0))
    yaw = made.world_from_body.rotation.as_euler("ZYX")[0]
    assert wrap_angle(yaw - np.arctan2(*SCENE.deck.landing_direction[::-1])) == pytest.approx(0.0, abs=1e-9)


def test_the_pilots_view_has_the_cameras_field_of_view():
    made = pilot_view(SCENE, sample_at(0.0))
    assert made.camera.fov_deg == pytest.approx(SCENE.camera.fov_deg)
    assert made.camera.width < SCENE.camera.width


def test_a_recorded_sight_passes_answers_on():
    class Silent:
        def see(self, moment):
            return None if moment.time_s > 0.15 else answer_at(moment.time_s)

    state = sample_at(0.0).state
    recorded = RecordedSight(Silent())
    moments = [Moment(t, state.world_from_body, np.zeros(3), np.zeros(3)) for t in (0.0, 0.1, 0.2)]
    assert [recorded.see(moment) is None for moment in moments] == [False, False, True]
    assert [answer.time_s for answer in recorded.answers] == [0.0, 0.1]
    assert recorded.last_s == 0.2
    assert recorded.pictures == []
