"""Pictures of one landing for its report: touchdown on the deck's plan, approach profile, statuses."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deckline.report.status import STATUS_COLOURS
from deckline.types import Guidance, Status, Value
from deckline_lab.campaigns.figures import COLOURS, draw_deck, open_figure, png_text
from deckline_sim.landing.autopilot import COMMITTED_M, DECISION_M, WINDOW
from deckline_sim.landing.deviations import deviations
from deckline_sim.landing.film import FilmedLanding

DECK_X_M, DECK_Y_M = (-130.0, 110.0), (-45.0, 45.0)  # of the deck's plan that is shown
LEAST_REACH_M = (8.0, 4.0)  # of the axes of lateral deviation and height
MOST_REACH = 1.3  # of the axes, in the largest true deviation
TRUTH, MEASURED, LIMIT = "#c24e00", "#0072b2", "#b3245e"  # as in the report of a run


def draw_touchdown(filmed: FilmedLanding) -> str:
    """Path of the hook over the deck and its touchdown, from above; PNG as base64 text."""
    deck, landing = filmed.scene.deck, filmed.landing
    figure, axis = open_figure(4.6)
    draw_deck(axis, deck, deck.touchdown_m, (deck.touchdown_m,))
    path = true_deviations(filmed)
    axis.plot(-path[:, 1] - deck.touchdown_m, path[:, 2], color=TRUTH, linewidth=1.5, label="hook, true")
    contact = landing.touchdown
    if contact is not None:
        place = [contact.beyond_aim_m], [contact.right_m]
        name = str(landing.outcome).replace("_", " ")
        axis.plot(*place, "o", color=COLOURS[landing.outcome], markersize=9, label=f"touchdown: {name}")
    axis.set(xlim=DECK_X_M, ylim=DECK_Y_M[::-1], aspect="equal")
    axis.set(xlabel="beyond the touchdown point, m", ylabel="right of the centre line, m")
    axis.legend(loc="lower right", fontsize="small")
    return png_text(figure)


def draw_profile(filmed: FilmedLanding) -> str:
    """Lateral deviation and height above the glideslope over the distance; PNG as base64 text."""
    figure, axes = open_figure(6.4, 2, 1)
    truth, aim_m = true_deviations(filmed), filmed.scene.deck.touchdown_m
    answers = [answer for answer in filmed.answers if answer.lateral_deviation_m is not None]
    distance = np.interp([answer.time_s for answer in answers], truth[:, 0], truth[:, 1])
    lateral = _band([answer.lateral_deviation_m for answer in answers], _levels(answers, "lateral_m"))
    height = _band([answer.vertical_deviation_m for answer in answers], _levels(answers, "vertical_m"))
    for axis, column, band, least, least_m, rad in zip(
        axes[:, 0], (2, 3), (lateral, height), LEAST_REACH_M, *WINDOW, strict=True
    ):
        axis.fill_between(distance, band[:, 1], band[:, 2], color=MEASURED, alpha=0.18, label="protection level")
        axis.plot(distance, band[:, 0], ".", color=MEASURED, markersize=4, label="guidance")
        axis.plot(truth[:, 1], truth[:, column], color=TRUTH, linewidth=1.5, label="truth")
        to_go = np.linspace(COMMITTED_M, DECISION_M, 50)
        limit = np.maximum(least_m, np.tan(rad) * to_go)
        for side in (-1.0, 1.0):
            label = "wave-off beyond" if side > 0 else None
            axis.plot(to_go - aim_m, side * limit, "--", color=LIMIT, linewidth=1, label=label)
        reach = max(least, MOST_REACH * float(np.abs(truth[:, column]).max()))
        axis.set(xlim=(truth[:, 1].max(), truth[:, 1].min()), ylim=(-reach, reach))
        axis.grid(alpha=0.3)
    axes[0, 0].set(ylabel="right of the centre line, m")
    axes[0, 0].invert_yaxis()  # left is up, as the pilot's left is
    axes[1, 0].set(ylabel="above the glideslope, m", xlabel="distance to the ramp, m")
    axes[0, 0].legend(fontsize="small", ncols=4, loc="upper right")
    return png_text(figure)


def draw_statuses(answers: Sequence[Guidance]) -> str:
    """What guidance was worth, over time; PNG as base64 text."""
    figure, axis = open_figure(2.4)
    words = [str(status) for status in Status]
    for number, status in enumerate(Status):
        times = [answer.time_s for answer in answers if answer.status is status]
        colour = np.array(STATUS_COLOURS[status].fill) / 255
        axis.plot(times, np.full(len(times), number), "s", color=colour, markersize=5)
    axis.set_yticks(range(len(words)), words)
    axis.set(ylim=(len(words) - 0.5, -0.5), xlabel="time, s")
    axis.grid(axis="y", alpha=0.3)
    return png_text(figure)


def true_deviations(filmed: FilmedLanding) -> NDArray[np.float64]:
    """(N, 4) of the samples: time, s; distance to the ramp, right of the centre line, above the glideslope, m."""
    scene, rows = filmed.scene, []
    for sample in filmed.landing.samples:
        state = sample.state
        found = deviations(scene, sample.time_s, state.world_from_body, np.array(state.velocity_m_s))
        slope_m = (found.distance_m + scene.deck.touchdown_m) * scene.run.approach.slope
        rows.append((sample.time_s, found.distance_m, found.lateral_m, found.height_m - slope_m))
    return np.array(rows)


def _levels(answers: Sequence[Guidance], name: str) -> NDArray[np.float64]:
    """Protection levels (N,), m; NaN: not known."""
    return np.array([np.nan if a.protection is None else getattr(a.protection, name) for a in answers])


def _band(values: Sequence[Value | None], levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) of values: value, and the value less and plus its level; NaN: not known."""
    known = np.array([np.nan if value is None else value.value for value in values])
    return np.stack([known, known - levels, known + levels], axis=1)
