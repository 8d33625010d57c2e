"""Plans: cells, seeds, draws, and what they refuse."""

import json
from pathlib import Path

import numpy as np
import pytest

from deckline_lab.campaigns.landings import check_landing
from deckline_lab.campaigns.plan import CampaignPlan, check_plan, read_plan

EXAMPLES = Path(__file__).parents[3] / "examples" / "campaigns"
PLAN = """
seed = 3
landings = 5
shard = 2
[landing]
wind_m_s = 8.0
camera.rate_hz = 20
[factors]
visibility_m = [300, inf]
camera.latency_s = [0.05, 0.1, 0.2]
[ranges]
turbulence = [0.5, 2.0]
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        path = tmp_path / "plan.toml"
        path.write_text(text)
        return read_plan(path)

    return read


def test_factors_make_every_combination_a_cell(read):
    plan = read(PLAN)
    cells = [(cell["visibility_m"], cell["camera.latency_s"]) for cell in plan.cells]
    assert sorted(cells) == [(v, t) for v in (300, np.inf) for t in (0.05, 0.1, 0.2)]
    config = plan.config({**plan.cells[1], **plan.draw(1, 0)[0]})
    assert (config.visibility_m, config.camera.latency_s) == (300.0, 0.1)
    assert (config.camera.rate_hz, config.camera.width, config.wind_m_s) == (20.0, 1280, 8.0)
    json.dumps(plan.as_json(), allow_nan=False)


def test_shards_hold_every_landing_of_every_cell_once(read):
    plan = read(PLAN)
    held = [(cell, n) for cell, numbers in map(plan.shard_landings, range(plan.shards)) for n in numbers]
    assert sorted(held) == [(cell, number) for cell in range(6) for number in range(5)]
    assert [plan.shard_landings(shard)[0] for shard in range(6)] == list(range(6))  # the cells in turn


def test_seeds_and_draws_are_of_the_plan_and_the_landing_alone(read):
    plan, same = read(PLAN), CampaignPlan(seed=3, ranges={"turbulence": (0.5, 2.0)})
    other = CampaignPlan(seed=4, ranges={"turbulence": (0.5, 2.0)})
    seeds = [plan.landing_seed(0, number) for number in range(300)]
    assert seeds == [same.landing_seed(0, number) for number in range(300)]
    others = *(other.landing_seed(0, number) for number in range(300)), *(plan.landing_seed(1, n) for n in range(300))
    assert len({*seeds, *others}) == 900
    assert max(*seeds, *others) < 2**53
    drawn = np.array([plan.draw(0, number)[0]["turbulence"] for number in range(300)])
    assert drawn.min() >= 0.5
    assert drawn.max() <= 2.0
    assert abs(drawn.mean() - 1.25) < 4 * 1.5 / np.sqrt(12 * 300)  # 4 sigma of the mean
    assert plan.draw(1, 7) == same.draw(1, 7) != plan.draw(0, 7)


def test_paired_cells_share_seeds_and_draws():
    plan = CampaignPlan(paired=True, factors={"sea_state": (2, 4)}, ranges={"turbulence": (0.5, 2.0)})
    assert plan.landing_seed(0, 7) == plan.landing_seed(1, 7) != plan.landing_seed(0, 8)
    assert plan.draw(0, 7) == plan.draw(1, 7) != plan.draw(0, 8)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("shards = 3", r"shards.*did you mean shard"),
        ("[factors]\nvisibility = [300]", r"visibility.*visibility_m"),
        ("[factors]\n'camera.rate' = [10]", r"camera\.rate.*rate_hz"),
        ("[factors]\nsea_state = []", r"sea_state.*\[\]"),
        ("[factors]\nsea_state = 3", r"sea_state.*3"),
        ("[factors]\nsea_state = [2, 9]", r"sea_state.*9"),
        ("[factors]\nsea_state = [2, 2]", r"sea_state.*\[2, 2\]"),
        ("[landing]\nsea_stat = 3", r"sea_stat.*sea_state"),
        ("[ranges]\nturbulence = [2.0, 0.5]", r"turbulence.*\[2\.0, 0\.5\]"),
        ("[ranges]\nturbulence = [1.0]", r"turbulence.*\[1\.0\]"),
        ("[ranges]\nturbulence = [1.0, inf]", r"turbulence.*inf"),
        ("[ranges]\nsea_state = [-1.0, 3.0]", r"sea_state.*-1\.0"),
        ("[ranges]\ncamera.width = [640, 1280]", r"camera\.width.*640\.0"),
        ("[factors]\nturbulence = [1]\n[ranges]\nturbulence = [1, 2]", "turbulence"),
        ("landings = 0", r"landings.*0"),
        ("landings = 1.5", r"landings.*1\.5"),
        ("landing = 5", "landing"),
        ("[importance]\nname = 'turbulenc'\nmean = 1\nsigma = 1\nlow = 0\nhigh = 3", r"turbulenc.*turbulence"),
        ("[importance]\nname = 'turbulence'\nmean = 1\nsigma = 0\nlow = 0\nhigh = 3", r"sigma.*0"),
        ("[importance]\nname = 'turbulence'\nmean = 1\nsigma = 1\nlow = 3\nhigh = 3", r"low.*3"),
    ],
)
def test_refused(read, text, named):
    with pytest.raises(ValueError, match=named):
        read(text)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_examples_can_be_flown(path):
    pytest.importorskip("jsbsim")
    check_plan(read_plan(path), check_landing)


def test_what_cannot_be_flown_is_refused_in_every_cell(read):
    checked = []
    check_plan(read(PLAN), checked.append)
    assert {(config.visibility_m, config.camera.latency_s) for config in checked} == {
        (v, t) for v in (300.0, np.inf) for t in (0.05, 0.1, 0.2)
    }
    assert {config.turbulence for config in checked} == {0.5, 2.0}
