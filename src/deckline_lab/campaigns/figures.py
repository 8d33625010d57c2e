"""Pictures of a campaign's report: touchdowns on the deck's plan, their dispersion, shares of outcomes."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from deckline.extras import needs_extra
from deckline_lab.campaigns.plan import CampaignPlan
from deckline_lab.campaigns.summary import GOOD, CellSummary, FlownLanding, name_cell
from deckline_lab.statistics import CONFIDENCE
from deckline_sim.landing.deck import Deck
from deckline_sim.landing.surroundings import aim_m, over_deck_m_s, surroundings
from deckline_sim.landing.touchdown import Outcome

COLOURS = {
    Outcome.WIRE: "#0072b2",
    Outcome.BOLTER: "#e69f00",
    Outcome.HARD_LANDING: "#a01010",
    Outcome.OFF_CENTRE: "#cc79a7",
    Outcome.WAVE_OFF: "#56b4e9",
    Outcome.RAMP_STRIKE: "#b3245e",
    Outcome.WATER: "#555555",
}
SHOWN = (GOOD, Outcome.BOLTER, Outcome.WAVE_OFF, Outcome.RAMP_STRIKE)  # shares that have a panel
MARGIN_M = 25.0  # of deck around the touchdowns
PART = 0.98  # of the width between two groups that their series share
MOST_CELLS = 12  # ellipses that a picture can hold
WIDTH_IN, DPI = 11.0, 130
Points = NDArray[np.float64]
Group = tuple[str, str, CellSummary]  # on the axis, of the series, and its landings


def landings_by_ship(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> dict[str, list[FlownLanding]]:
    """The landings on each ship."""
    ships: dict[str, list[FlownLanding]] = {}
    for landing in landings:
        ships.setdefault(landing.settings.get("ship", plan.landing.ship), []).append(landing)
    return ships


def hooks_on_deck(plan: CampaignPlan, landings: Sequence[FlownLanding], deck: Deck) -> tuple[Points, Points]:
    """Touchdown points and hooks on one ship's deck; a touchdown point follows its landing's wind.

    Returns:
        (N,) touchdown point beyond the ramp, m, and (N, 2) hook beyond the ramp and right of the centre line, m, of the
        landings that touched the deck.
    """
    down = [landing for landing in landings if landing.along_m is not None]
    configs = (plan.config(landing.settings) for landing in down)
    aims_m = np.array([aim_m(deck.wires_m, over_deck_m_s(config)) for config in configs], dtype=np.float64)
    return aims_m, _touchdowns(down) + np.column_stack([aims_m, np.zeros(len(down))])


def draw_touchdowns(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> str:
    """Every touchdown of landings on one ship on the plan of its deck, from the left; PNG as base64 text."""
    figure, axis = open_figure(4.6)
    deck = surroundings(plan.config(landings[0].settings), 0).deck
    aims_m, points = hooks_on_deck(plan, landings, deck)
    ends_m = (aims_m.min(), aims_m.max()) if len(points) else (deck.touchdown_m,)
    draw_deck(axis, deck, 0.0, ends_m)
    outcomes = np.array([landing.outcome for landing in landings if landing.along_m is not None], dtype=str)
    for outcome, colour in COLOURS.items():
        of = points[outcomes == outcome]
        if len(of):
            axis.plot(*of.T, ".", color=colour, markersize=3, alpha=0.6, label=outcome.replace("_", " "))
    low, high = (points.min(0), points.max(0)) if len(points) else np.full((2, 2), (deck.touchdown_m, 0.0))
    axis.set(xlim=(low[0] - MARGIN_M, high[0] + MARGIN_M), ylim=(high[1] + MARGIN_M, low[1] - MARGIN_M))
    axis.set(aspect="equal", xlabel="beyond the ramp, m", ylabel="right of the centre line, m")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper right", fontsize="small", markerscale=3)
    return png_text(figure)


def draw_dispersion(plan: CampaignPlan, landings: Sequence[FlownLanding]) -> str:
    """The ellipse of 95 % of the touchdowns of each cell, if they are normally distributed; PNG as base64 text."""
    figure, axis = open_figure(4.6)
    radius = np.sqrt(chi2.ppf(CONFIDENCE, 2))
    turn = np.linspace(0, 2 * np.pi, 100)
    for number, cell in enumerate(plan.cells[:MOST_CELLS]):
        members = [landing for landing in landings if landing.cell == number and landing.along_m is not None]
        points, weights = _touchdowns(members), [landing.weight for landing in members]
        if len(points) < 3 or sum(weight > 0 for weight in weights) < 3:
            continue
        root = np.linalg.cholesky(np.cov(points.T, aweights=weights) + 1e-12 * np.eye(2))
        middle = np.average(points, axis=0, weights=weights)
        edge = middle + radius * np.column_stack([np.cos(turn), np.sin(turn)]) @ root.T
        (line,) = axis.plot(*edge.T, label=name_cell(dict(cell)))
        axis.plot(*middle, "+", color=line.get_color())
    axis.axhline(0, color="#888", linewidth=0.8)
    axis.axvline(0, color="#888", linewidth=0.8)
    axis.invert_yaxis()
    axis.set(xlabel="beyond the touchdown point, m", ylabel="right of the centre line, m")
    axis.grid(alpha=0.3)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.01, 0.5))
    return png_text(figure)


def draw_shares(groups: Sequence[Group], axis_name: str, series_name: str) -> str:
    """Shares with their 95 % intervals, a panel an event, a colour a series; PNG as base64 text."""
    figure, panels = open_figure(6.2, 2, 2)
    names = list(dict.fromkeys(name for name, _, _ in groups))
    series = list(dict.fromkeys(name for _, name, _ in groups))
    for panel, event in zip(panels.ravel(), SHOWN, strict=True):
        for number, one in enumerate(series):
            shift = (number + 0.5) / len(series) - 0.5 if len(series) > 1 else 0.0
            members = [(names.index(name), summary.shares[event]) for name, of, summary in groups if of == one]
            at = np.array([place + 0.6 * PART * shift for place, _ in members])
            values, low, high = 100 * np.array([(s.value, s.low, s.high) for _, s in members]).T
            reach = np.maximum(0.0, [values - low, high - values])
            panel.errorbar(at, values, reach, fmt="o", markersize=4, capsize=3, label=f"{series_name} {one}")
        panel.set_title(str(event).replace("_", " "), fontsize="medium")
        panel.set_xticks(range(len(names)), names)
        panel.set(xlim=(-0.5, len(names) - 0.5), ylabel="%", ylim=(None if event == GOOD else 0, None))
        panel.grid(axis="y", alpha=0.3)
    for panel in panels[-1]:
        panel.set_xlabel(axis_name)
    if len(series) > 1:
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside right center", fontsize="small")
    return png_text(figure)


def draw_deck(axis: Any, deck: Deck, origin_m: float, aims_m: Sequence[float]) -> None:
    """The deck from above in a plot whose axes are m beyond an origin and m right of the centre line.

    Args:
        axis: of the plot.
        deck: the ship.
        origin_m: beyond the ramp, along the centre line.
        aims_m: touchdown points to mark, beyond the ramp.
    """
    layout, turn = deck.layout, np.column_stack([deck.along, deck.right])
    origin = layout.centre_m[0] + origin_m * deck.along

    def place(points_m: Points) -> Points:
        return np.asarray((points_m - origin) @ turn)

    axis.fill(*place(layout.outline_m).T, facecolor="#e3e6ea", edgecolor="#8a94a0", linewidth=1)
    for line in (layout.left_m, layout.right_m):
        axis.plot(*place(line).T, color="#ffffff", linewidth=3)
    axis.plot(*place(layout.centre_m).T, color="#d9a400", linewidth=1, linestyle="--")
    for wire_m in deck.wires_m:
        half = layout.spacing_m / 2
        axis.plot(np.full(2, wire_m - origin_m), [-half, half], color="#555", linewidth=1)
    axis.plot(np.array(aims_m) - origin_m, np.zeros(len(aims_m)), "x-", color="#111", linewidth=1, markersize=8)


def _touchdowns(landings: Sequence[FlownLanding]) -> Points:
    """(N, 2) beyond the touchdown point and right of the centre line, m."""
    places = [(landing.along_m, landing.across_m) for landing in landings if landing.along_m is not None]
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def open_figure(height_in: float, *grid: int) -> tuple[Any, Any]:
    """A figure and its axes, one or a grid of rows and columns."""
    with needs_extra("viz"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")
    return figure, figure.subplots(*grid, squeeze=not grid)


def png_text(figure: Any) -> str:
    """A figure as PNG, base64."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return base64.b64encode(buffer.getvalue()).decode()
