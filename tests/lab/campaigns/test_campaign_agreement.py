"""Two campaigns held against each other."""

import json

import numpy as np
import pytest

from deckline_lab.campaigns.agreement import agreement_table, plan_from_json, read_campaign
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.summary import FlownLanding
from deckline_sim.landing.touchdown import Outcome

PLAN = CampaignPlan(factors={"visibility_m": (500, np.inf), "sea_state": (2,)}, ranges={"wind_m_s": (2.0, 8.0)})


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
    return {row[0]: row for row in agreement_table(PLAN, first, PLAN, second).rows}


def test_landings_of_one_law_agree_and_moved_touchdowns_do_not():
    assert {row[-1] for row in rows(flown(1, 5.0), flown(2, 5.0)).values()} == {"yes"}
    clear, hazy = (rows(flown(1, 5.0), flown(2, 10.0))[f"visibility_m {v}, sea_state 2"] for v in ("inf", "500"))
    assert (clear[-1], hazy[-1]) == ("no", "yes")


def test_bolters_do_not_agree_with_wires():
    table = rows(flown(1, 5.0), flown(2, 5.0, wires=0.5))
    assert {row[-1] for row in table.values()} == {"no"}


def test_cells_are_matched_by_what_they_are():
    other = CampaignPlan(factors={"sea_state": (2,), "visibility_m": (500,)})
    with pytest.raises(ValueError, match="sea_state 2, visibility_m 500"):
        agreement_table(PLAN, flown(1, 5.0), other, [])


def test_a_plan_comes_back_from_its_file():
    table = json.loads(json.dumps(PLAN.as_json()))
    assert plan_from_json(table).as_json() == PLAN.as_json()


@pytest.mark.parametrize("text", ["[]", "{", '{"seed": 1}'])
def test_a_folder_without_a_campaign_is_named(tmp_path, text):
    (tmp_path / "plan.json").write_text(text)
    with pytest.raises(ValueError, match=r"plan\.json"):
        read_campaign(tmp_path)
