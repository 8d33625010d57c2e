"""Two campaigns held against each other."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp

from deckline_lab.campaigns.agreement import (
    agreement_tables,
    differing_settings,
    least_change,
    least_share_difference,
    plan_from_json,
    read_campaign,
    shared_cells,
)
from deckline_lab.campaigns.importance import Importance
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.summary import FlownLanding
from deckline_sim.landing.config import LandingCamera, LandingConfig
from deckline_sim.landing.touchdown import Outcome

PLAN = CampaignPlan(factors={"visibility_m": (500, np.inf), "sea_state": (2,)}, ranges={"wind_m_s": (2.0, 8.0)})

GUSTS = Importance("turbulence", mean=1.0, sigma=0.3, low=0.0, high=3.0)


def flown(seed: int, mean_m: float, wires: float = 1.0) -> list[FlownLanding]:
    rng = np.random.default_rng(seed)
    return [
        FlownLanding(
            cell,
            number,
            {},
            1.0,
            Outcome.WIRE if rng.random() < wires else Outcome.BOLTER,
            rng.normal(mean_m * cell, 4.0),
            rng.normal(0.0, 0.3),
            3.0,
            False,
            False,
            rng.normal(400.0, 20.0),
        )
        for cell in range(2)
        for number in range(60)
    ]


def rows(first, second):
    return {row[0]: row for row in agreement_tables(PLAN, first, PLAN, second)[0].rows}


def test_landings_of_one_law_agree_and_moved_touchdowns_do_not():
    assert {row[-1] for row in rows(flown(1, 5.0), flown(2, 5.0)).values()} == {"none found"}
    clear, hazy = (rows(flown(1, 5.0), flown(2, 10.0))[f"visibility_m {v}, sea_state 2"] for v in ("inf", "500"))
    assert (clear[-1], hazy[-1]) == ("found", "none found")


def test_landings_that_nobody_saw_are_no_test_and_one_side_alone_differs():
    seen = flown(1, 5.0)
    unseen = [replace(landing, first_ok_m=None) for landing in seen]
    assert all(row[-2] != "1.000" and row[-1] == "none found" for row in rows(unseen, unseen).values())
    assert all(row[-1] == "found" for row in rows(seen, unseen).values())


def test_bolters_do_not_agree_with_wires():
    table = rows(flown(1, 5.0), flown(2, 5.0, wires=0.5))
    assert {row[-1] for row in table.values()} == {"found"}


def test_cells_are_matched_by_what_they_are():
    turned = CampaignPlan(factors={"sea_state": (4.0, 2.0), "visibility_m": (500.0,)})
    assert shared_cells(PLAN, turned) == [(0, 1)]
    one = CampaignPlan(LandingConfig(sea_state=2.0, sight="guidance"), factors={"visibility_m": (np.inf,)})
    assert shared_cells(PLAN, one) == [(1, 0)]
    other = CampaignPlan(factors={"visibility_m": (700,)})
    with pytest.raises(ValueError, match="visibility_m 700"):
        agreement_tables(PLAN, flown(1, 5.0), other, [])


def test_other_differences_are_named():
    landing = LandingConfig(start_m=800.0, sight="guidance", camera=LandingCamera(rate_hz=20.0))
    other = CampaignPlan(landing, factors=PLAN.factors, ranges={"wind_m_s": (2.0, 9.0)})
    assert differing_settings(PLAN, PLAN) == []
    assert differing_settings(PLAN, other) == [
        "camera.rate_hz 10.0, of the other 20.0",
        "start_m 1500.0, of the other 800.0",
        "wind_m_s drawn from 2 to 8, of the other drawn from 2 to 9",
    ]


def test_weighted_campaigns_are_refused():
    weighted = CampaignPlan(factors=PLAN.factors, importance=GUSTS)
    for plans in ((PLAN, weighted), (weighted, PLAN)):
        with pytest.raises(ValueError, match=r"importance.*turbulence"):
            shared_cells(*plans)


@pytest.mark.parametrize(("first", "second"), [(17, 50), (60, 60)])
def test_the_least_changes_are_found_every_second_time(first, second):
    level, rng = 0.05 / 24, np.random.default_rng(4)
    shift, spread = (least_change(first, second, level, change) for change in ("shift", "spread"))
    for mean, sigma in ((shift, 1.0), (0.0, spread)):
        pairs = [(rng.normal(mean, sigma, first), rng.normal(0, 1, second)) for _ in range(400)]
        assert np.mean([ks_2samp(*pair).pvalue < level for pair in pairs]) == pytest.approx(0.5, abs=0.13)


def test_too_few_values_find_nothing():
    assert least_change(7, 50, 0.05, "shift") is None
    assert least_change(8, 8, 1e-5, "spread") is None


def test_the_least_difference_of_a_share_is_the_first_significant_count():
    assert least_share_difference(17, 50, 50, 0.05 / 24) == pytest.approx(5 / 17)  # 12 of 17 against 50 of 50
    assert least_share_difference(2, 50, 50, 1e-6) is None


def test_the_least_differences_stand_beside_the_tests():
    tests, least = agreement_tables(PLAN, flown(1, 5.0), PLAN, flown(2, 5.0))
    assert [row[0] for row in least.rows] == [row[0] for row in tests.rows]
    assert all(len(row) == len(least.columns) for row in least.rows)
    wire, along, across, first_ok, spread = map(float, least.rows[0][1:])
    assert 10 < wire < 30
    assert along / across == pytest.approx(4.0 / 0.3, rel=0.3)
    assert first_ok / along == pytest.approx(20.0 / 4.0, rel=0.3)
    assert spread > 2


@pytest.mark.parametrize("plan", [PLAN, CampaignPlan(importance=GUSTS)])
def test_a_plan_comes_back_from_its_file(plan):
    table = json.loads(json.dumps(plan.as_json()))
    assert plan_from_json(table).as_json() == plan.as_json()


@pytest.mark.parametrize("text", ["[]", "{", '{"seed": 1}'])
def test_a_folder_without_a_campaign_is_named(tmp_path, text):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(ValueError, match=r"plan\.json"):
        read_campaign(tmp_path)
