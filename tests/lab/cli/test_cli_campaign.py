"""`deckline campaign`."""

import json

import numpy as np
import pytest

from deckline.cli.main import main
from deckline_lab.cli import campaign
from deckline_sim.landing.touchdown import Outcome
from lab.campaigns.stand_in import Flown

PLAN = """
landings = 6
shard = 4
[landing]
sight = "guidance"
[factors]
sea_state = [2, 4]
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "fog.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def not_flown(monkeypatch):
    """Every landing is a wave-off that had to be."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(campaign, "fly_landing", lambda config, seed: Flown(Outcome.WAVE_OFF, called_for=True))
    monkeypatch.setattr(campaign, "check_landing", lambda config: None)


def test_a_campaign_writes_summary_and_report(tmp_path, plan, not_flown, capsys):
    out = tmp_path / "out"
    assert main(["campaign", str(plan), "--out", str(out), "--jobs", "1"]) == 0
    cells = json.loads((out / "summary.json").read_text())["cells"]
    assert [cell["settings"] for cell in cells] == [{"sea_state": 2}, {"sea_state": 4}]
    assert cells[0]["shares"]["good"]["hits"] == 6
    assert np.isclose(cells[0]["shares"]["ramp_strike"]["at_most"], 1 - 0.05 ** (1 / 6))
    assert str(out / "report.html") in capsys.readouterr().out
    page = (out / "report.html").read_text()
    assert "Touchdowns on the deck" in page and "Dispersion" not in page  # none touched it


@pytest.fixture
def filmed(not_flown, monkeypatch):
    """Configuration and seed of each landing that is filmed; none is flown."""
    films, found = pytest.importorskip("deckline_lab.campaigns.filmed"), []
    monkeypatch.setattr(films, "fly_filmed", lambda config, seed: found.append((config, seed)))
    monkeypatch.setattr(films, "make_film", lambda landing: b"film")
    return found


def test_the_first_landing_of_every_outcome_is_filmed_once(tmp_path, plan, filmed):
    out = tmp_path / "out"
    for _ in range(2):
        assert main(["campaign", str(plan), "--out", str(out), "--jobs", "1", "--films"]) == 0
    ((config, seed),) = filmed
    (film,) = (out / "films").iterdir()
    assert (film.name, config.sea_state) == (f"wave_off-0-{seed}.mp4", 2)
    assert f"films/{film.name}" in (out / "report.html").read_text()


def test_clear_air_is_text_in_the_summary_and_a_number_in_films(tmp_path, plan, filmed):
    plan.write_text(PLAN.replace("sea_state = [2, 4]", "visibility_m = [inf]"))
    out = tmp_path / "out"
    assert main(["campaign", str(plan), "--out", str(out), "--jobs", "1", "--films"]) == 0
    (cell,) = json.loads((out / "summary.json").read_text())["cells"]
    assert (cell["settings"], [config.visibility_m for config, _ in filmed]) == ({"visibility_m": "inf"}, [np.inf])


@pytest.mark.parametrize(("key", "word"), [("guidance", "picture"), ("aircraft", "f15")])
def test_one_line_for_a_plan_that_cannot_be_flown(tmp_path, plan, capsys, key, word):
    pytest.importorskip("jsbsim")
    plan.write_text(PLAN.replace("[factors]", f'{key} = "{word}"\n[factors]'))
    assert main(["campaign", str(plan), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert not (tmp_path / "out").exists()
