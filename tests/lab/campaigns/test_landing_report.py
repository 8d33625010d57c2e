"""The page of one landing."""

import re
from dataclasses import replace

import numpy as np
import pytest

from deckline.types import DepthMode, Guidance, Protection, Status, Value
from deckline_sim.landing.autopilot import WaveOff
from deckline_sim.landing.config import LandingConfig
from deckline_sim.landing.film import FilmedLanding
from deckline_sim.landing.landing import fly
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome

pytest.importorskip("matplotlib")
pytest.importorskip("jsbsim")

from deckline_lab.campaigns.landing_figures import true_deviations
from deckline_lab.campaigns.landing_report import landing_html

CONFIG = LandingConfig(guidance="navigation", navigation="exact", start_m=300.0, sea_state=1.0)


@pytest.fixture(scope="module")
def filmed():
    landing = fly(CONFIG, 1)
    known = Value(0.5, 0.1)
    answers = [
        Guidance(0.0, Status.NOT_SEEN, DepthMode.NONE),
        Guidance(1.0, Status.OK, DepthMode.COARSE, known, vertical_deviation_m=known),
        Guidance(1.1, Status.OK, DepthMode.COARSE, known, protection=Protection(1.0, 2.0, None, 3.0, 1e-7)),
    ]
    return FilmedLanding(surroundings(CONFIG, 1), landing, answers, landing.seconds)


def test_the_true_path_ends_at_the_touchdown(filmed):
    path, contact = true_deviations(filmed), filmed.landing.touchdown
    step_m = 70.0 / 30.0  # of one sample
    assert contact is not None
    assert -path[-1, 1] - filmed.scene.deck.touchdown_m == pytest.approx(contact.beyond_aim_m, abs=step_m)
    assert path[-1, 2] == pytest.approx(contact.right_m, abs=0.1)
    assert np.all(np.diff(path[:, 1]) < 0)
    assert path[0, 1] == pytest.approx(CONFIG.start_m, abs=5.0)  # of the hook, behind the centre of gravity


def test_the_page_holds_outcome_film_settings_and_pictures(filmed):
    page = landing_html(filmed, "landing.mp4")
    assert f"Wire {filmed.landing.touchdown.wire}" in page
    assert f"{filmed.landing.touchdown.beyond_aim_m:+.1f} m" in page
    assert 'src="landing.mp4"' in page
    assert len(re.findall(r"data:image/png;base64,\w{100}", page)) == 3
    assert re.search(r"camera\.rate_hz</th><td>10\.0", page)
    assert "2 of 3 answers ok" in page


def test_the_page_of_a_pass_without_answers_and_touchdown(filmed):
    landing = replace(filmed.landing, outcome=Outcome.WAVE_OFF, touchdown=None, wave_off=WaveOff.NOT_SEEN)
    page = landing_html(replace(filmed, landing=landing, answers=[]), "landing.mp4")
    assert "Wave-off" in page
    assert str(WaveOff.NOT_SEEN) in page
