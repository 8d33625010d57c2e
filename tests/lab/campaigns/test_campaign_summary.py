"""What campaigns add up to: shares, intervals, weights, touchdowns, the page."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import stand_in
from scipy.stats import norm, truncnorm

from deckline_lab.campaigns.figures import hooks_on_deck, landings_by_ship
from deckline_lab.campaigns.importance import Importance
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.report import PAIRED, _figures, campaign_html, group_landings
from deckline_lab.campaigns.runner import run_campaign, shard_files
from deckline_lab.campaigns.shares import estimate_share
from deckline_lab.campaigns.summary import (
    GOOD,
    MISLEADING,
    NOT_MEASURED,
    FlownLanding,
    measures_misleading,
    read_landings,
    summarise,
    summarise_group,
    summary_tables,
    weighted_median,
)
from deckline_sim.landing.surroundings import surroundings
from deckline_sim.landing.touchdown import Outcome

GUSTS = Importance("turbulence", mean=1.0, sigma=0.3, low=0.0, high=3.0)
WIRE = FlownLanding(0, 1, {}, 1.0, Outcome.WIRE, 2.0, 0.5, 3.0, False, False, 700.0)


def test_no_event_has_the_bound_of_the_rule_of_three():
    share = estimate_share(np.zeros(10_000, bool))
    assert (share.hits, share.value, share.low) == (0, 0.0, 0.0)
    assert share.at_most == pytest.approx(1 - 0.05 ** (1 / 10_000), rel=1e-9)
    assert share.at_most == pytest.approx(3 / 10_000, rel=2e-3)
    assert share.high == pytest.approx(1 - 0.025 ** (1 / 10_000), rel=1e-9)
    assert estimate_share(np.ones(5, bool)).at_most == 1.0


def test_weights_are_the_ratio_of_the_densities():
    ends = (0 - 1) / 0.3, (3 - 1) / 0.3
    for value in (0.0, 0.4, 1.0, 1.7, 3.0):
        expected = truncnorm.pdf(value, *ends, loc=1.0, scale=0.3) * 3
        assert GUSTS.weight(value) == pytest.approx(expected, rel=1e-9)
    assert GUSTS.weight(3.1) == GUSTS.weight(-0.1) == 0.0
    assert GUSTS.greatest_weight == pytest.approx(GUSTS.weight(1.0))


@pytest.mark.parametrize("limit", [1.9, 2.1])
def test_a_rare_event_of_known_probability_lies_within_the_interval(limit):
    ends = (0 - 1) / 0.3, (3 - 1) / 0.3
    truth = truncnorm.sf(limit, *ends, loc=1.0, scale=0.3)  # 0.0013 and 0.00012
    density = norm(1.0, 0.3)
    inside = density.cdf(3) - density.cdf(0)
    missed, above, values = 0, 0, []
    for seed in range(400):
        drawn = np.random.default_rng(seed).uniform(0, 3, 400)
        weights = density.pdf(drawn) / inside * 3
        share = estimate_share(drawn > limit, weights, GUSTS.greatest_weight)
        missed += not share.low <= truth <= share.high
        above += truth > share.at_most
        values.append(share.value)
    assert np.mean(values) == pytest.approx(truth, abs=4 * np.std(values) / np.sqrt(400))
    assert missed <= 0.05 * 400
    assert above <= 0.05 * 400


def test_common_events_are_bounded_by_their_absence():
    happened = np.arange(1000) != 5
    share = estimate_share(happened, np.ones(1000), 1.0, common=True)
    rare = estimate_share(~happened, np.ones(1000), 1.0)
    assert (share.value, share.low, share.high) == pytest.approx((1 - rare.value, 1 - rare.high, 1 - rare.low))
    assert share.at_most >= share.value


def test_equal_weights_have_the_exact_bounds_of_a_poisson_count():
    share = estimate_share(np.arange(1000) < 4, np.ones(1000), 1.0)
    assert (1000 * share.low, 1000 * share.high) == pytest.approx((1.0899, 10.2416), abs=1e-3)  # Garwood's table, 4


def test_outcomes_and_touchdowns_of_a_group():
    places = ((0.0, -1.0), (4.0, 1.0), (8.0, 0.0))
    landings = [replace(WIRE, along_m=along, across_m=across) for along, across in places]
    away = replace(WIRE, along_m=None, across_m=None, sink_m_s=None, first_ok_m=None)
    landings += [
        replace(away, outcome=Outcome.WAVE_OFF, called_for=True),
        replace(away, outcome=Outcome.WAVE_OFF),
        replace(away, outcome=Outcome.RAMP_STRIKE, misleading=True),
    ]
    group = summarise_group(landings, {})
    assert [group.shares[event].hits for event in (GOOD, *Outcome, MISLEADING)] == [4, 3, 0, 2, 1, 0, 0, 0, 0, 1]
    assert group.touchdown.along_m == pytest.approx((4.0, 4.0))
    assert group.touchdown.across_m == pytest.approx((0.0, 1.0))
    assert (group.touchdown.landings, group.effective, group.first_ok_m, group.ok_landings) == (3, 6.0, 700.0, 3)
    assert summary_tables([group], False)[1].rows[0][-2:] == ("700", "3 of 6")


def test_a_cell_without_any_ok_has_no_median_distance():
    group = summarise_group([replace(WIRE, first_ok_m=None)] * 2, {})
    assert summary_tables([group], False)[1].rows[0][-2:] == ("-", "0 of 2")


def test_weighted_touchdowns_and_effective_landings():
    light = replace(WIRE, along_m=10.0, weight=0.5)
    group = summarise_group([WIRE, replace(WIRE, along_m=4.0), light, light], {}, 2.0)
    assert group.effective == pytest.approx(9 / 2.5)
    assert group.touchdown.along_m is not None
    assert group.touchdown.along_m[0] == pytest.approx((2 + 4 + 5 + 5) / 3)


def test_the_median_of_the_first_ok_is_weighted():
    places = ((100.0, 1.0), (200.0, 1.0), (700.0, 1.0), (800.0, 5.0))
    weighted = [replace(WIRE, first_ok_m=first_ok_m, weight=weight) for first_ok_m, weight in places]
    assert summarise_group(weighted, {}, 5.0).first_ok_m == 800.0
    assert summarise_group([replace(each, weight=1.0) for each in weighted], {}).first_ok_m == 450.0
    assert summarise_group([replace(WIRE, weight=0.0)], {}, 5.0).first_ok_m is None
    rng = np.random.default_rng(0)
    for count in range(1, 9):
        values = rng.integers(0, 4, count).tolist()
        assert weighted_median(values, [0.5] * count) == np.median(values)
        weights = rng.integers(1, 4, count)
        assert weighted_median(values, weights.tolist()) == np.median(np.repeat(values, weights))


@pytest.fixture
def flown(tmp_path):
    plan = CampaignPlan(landings=40, shard=20, factors={"visibility_m": (300, 1000)}, ranges={"sea_state": (2.0, 4.0)})
    run_campaign(plan, tmp_path, stand_in.fly, stand_in.accept, 1)
    return plan, tmp_path


def test_a_summary_counts_every_landing(flown):
    plan, out = flown
    landings = read_landings(plan, out)
    cells = summarise(plan, landings)
    assert [(cell.settings["visibility_m"], cell.landings) for cell in cells] == [(300, 40), (1000, 40)]
    for cell in cells:
        assert sum(cell.shares[outcome].hits for outcome in Outcome) == 40
    groups = group_landings(plan, landings)
    assert {(axis, series) for axis, series, _ in groups} == {
        (v, s) for v in ("300", "1000") for s in ("2 to 3", "3 to 4")
    }
    assert sum(summary.landings for _, _, summary in groups) == 80


def test_the_page_holds_pictures_and_no_address(flown):
    pytest.importorskip("matplotlib")
    plan, out = flown
    landings = read_landings(plan, out)
    page = campaign_html(plan, landings, "fog <1>", summary_tables(summarise(plan, landings), False), [])
    assert page.count("data:image/png;base64,") == 3
    assert "fog &lt;1&gt;" in page
    assert "http" not in page.replace("http-equiv", "")


def test_hooks_are_placed_from_the_ramp_of_their_ship():
    pytest.importorskip("matplotlib")
    plan = CampaignPlan(factors={"ship": ("cvn", "axial")}, ranges={"wind_m_s": (2.0, 25.0)})
    landings = [
        replace(WIRE, settings={"ship": ship, "wind_m_s": wind_m_s}, along_m=3.0, across_m=-0.5)
        for ship in ("cvn", "axial")
        for wind_m_s in (2.0, 25.0)
    ]
    landings.append(replace(landings[0], outcome=Outcome.WAVE_OFF, along_m=None, across_m=None))
    ships = landings_by_ship(plan, landings)
    assert [(ship, len(members)) for ship, members in ships.items()] == [("cvn", 3), ("axial", 2)]
    for ship, members in ships.items():
        aims_m, hooks = hooks_on_deck(plan, members, surroundings(plan.config({"ship": ship}), 0).deck)
        decks = [surroundings(plan.config(landing.settings), 0).deck for landing in members[:2]]
        assert aims_m == pytest.approx([deck.touchdown_m for deck in decks])
        np.testing.assert_allclose(hooks, [(deck.touchdown_m + 3.0, -0.5) for deck in decks])
        assert aims_m[0] - aims_m[1] == pytest.approx(0.28 * 23)
    page = campaign_html(plan, landings, "ships", [], [])
    assert page.count("data:image/png;base64,") == 4
    titles = [title for title, _, _ in islice(_figures(plan, landings), 2)]
    assert [title.split()[-1] for title in titles] == ["cvn", "axial"]


def test_paired_landings_are_not_pooled_into_bounds(flown):
    pytest.importorskip("matplotlib")
    plan, out = flown
    landings = read_landings(plan, out)
    tables = summary_tables(summarise(plan, landings), False)
    plans = plan, replace(plan, paired=True)
    counts = [campaign_html(each, landings, "fog", tables, []).count(PAIRED) for each in plans]
    assert counts == [0, 3]  # good, ramp strikes, misleading
    factors = dict(plan.factors)
    factors["navigation"] = ("good", "tactical")
    pooled = replace(plan, paired=True, factors=factors)
    assert campaign_html(pooled, landings, "fog", tables, []).count("data:image/png") == 2  # no shares by group


def test_modelled_guidance_measures_no_misleading_ok(tmp_path):
    pytest.importorskip("matplotlib")
    plan = CampaignPlan(landings=4, factors={"sight": ("points", "guidance")})
    run_campaign(plan, tmp_path, stand_in.fly, stand_in.accept, 1)
    landings = read_landings(plan, tmp_path)
    cells = summarise(plan, landings)
    assert [MISLEADING in cell.shares for cell in cells] == [True, False]
    outcomes, _ = summary_tables(cells, False)
    by_points, by_guidance = (row[-1] for row in outcomes.rows)
    assert (float(by_points), by_guidance) == (pytest.approx(100 * (1 - 0.05 ** (1 / 4)), rel=0.01), NOT_MEASURED)
    pages = [campaign_html(plan, landings[:count], "fog", [], []) for count in (4, 8)]
    assert [page.count(NOT_MEASURED) for page in pages] == [0, 1]
    assert measures_misleading("guidance", "navigation")


DAMAGE = {
    "cut": lambda data: data[:-30],
    "number": lambda data: data.replace(b'"number":0', b'"number":1'),
    "seed": lambda data: data.replace(b'"seed":', b'"seed":1', 1),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_shard_is_named(flown, damage):
    plan, out = flown
    path = shard_files(plan, out)[1]
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ValueError, match=path.name):
        read_landings(plan, out)


def test_importance_is_flown_with_weights(tmp_path):
    plan = CampaignPlan(landings=60, shard=30, importance=GUSTS)
    run_campaign(plan, tmp_path, stand_in.fly, stand_in.accept, 1)
    landings = read_landings(plan, tmp_path)
    assert all(each.weight == GUSTS.weight(each.settings["turbulence"]) for each in landings)
    (cell,) = summarise(plan, landings)
    weights = np.array([each.weight for each in landings])
    assert cell.effective == pytest.approx(weights.sum() ** 2 / (weights**2).sum())
    assert cell.effective < 60
