"""`deckline campaign`."""

import json
from dataclasses import asdict
from pathlib import Path

import tyro

from deckline.atomic import write_atomic
from deckline.config_file import settings_to_json
from deckline.files import print_line, printable
from deckline_lab.campaigns.agreement import (
    DIFFERING,
    NOTE,
    agreement_tables,
    differing_settings,
    read_campaign,
    shared_cells,
)
from deckline_lab.campaigns.landings import check_landing, fly_landing
from deckline_lab.campaigns.plan import read_plan
from deckline_lab.campaigns.report import REPORT_FILE, campaign_html
from deckline_lab.campaigns.runner import run_campaign
from deckline_lab.campaigns.summary import (
    NOTES,
    SUMMARY_FILE,
    WEIGHTED_NOTE,
    FlownLanding,
    read_landings,
    summarise,
    summary_tables,
)
from deckline_lab.evaluation.tables import made_with, print_tables
from deckline_sim.workers import RayOption, choose_workers


def campaign(
    plan: tyro.conf.Positional[Path],
    out: Path,
    ray: RayOption = None,
    jobs: int = 0,
    against: Path | None = None,
    films: bool = False,
) -> int:
    """Fly a campaign of landings, and write what it adds up to.

    A stopped campaign goes on where it was when the same command is given again; finished shards are not flown again.

    Args:
        plan: TOML file of the campaign.
        out: folder of the shards, summary.json and report.html.
        ray: fly as Ray tasks, on the cluster at ADDRESS (HOST:PORT, or auto), without it on one that is started here.
        jobs: processes, without --ray; 0: one for every core.
        against: folder of a campaign to compare with, in the cells that both have.
        films: also film the first landing of every outcome, some minutes each.
    """
    flown, workers = read_plan(plan), choose_workers(ray, jobs)
    other = None if against is None else read_campaign(against)
    if other is not None:
        shared_cells(flown, other[0])  # refuses a campaign without any, before hours are flown
    run_campaign(flown, out, fly_landing, check_landing, workers)
    landings = read_landings(flown, out)
    cells, weighted = summarise(flown, landings), flown.importance is not None
    title = f"{plan.stem}: {len(landings)} landings, {len(cells)} cells, seen by {flown.landing.sight}"
    tables, notes = summary_tables(cells, weighted), [NOTES, *([WEIGHTED_NOTE] if weighted else [])]
    if other is not None:
        tables += agreement_tables(flown, landings, *other)
        differing = differing_settings(flown, other[0])
        notes += [NOTE, *([f"{DIFFERING}{'; '.join(differing)}."] if differing else [])]
    print_tables(title, made_with(), tables, notes)
    summary = {"title": title, "made_with": made_with(), "cells": [settings_to_json(asdict(cell)) for cell in cells]}
    write_atomic(out / SUMMARY_FILE, (json.dumps(summary, indent=1, allow_nan=False) + "\n").encode())
    print(printable(out / SUMMARY_FILE))
    filmed: list[tuple[FlownLanding, Path]] = []
    if films:
        from deckline_lab.campaigns.filmed import film_outcomes  # needs OpenGL

        filmed = list(film_outcomes(flown, landings, out))
    try:
        page = campaign_html(flown, landings, plan.stem, tables, notes, filmed)
    except ImportError as error:
        print_line(f"no {REPORT_FILE}: {error}")
        return 0
    write_atomic(out / REPORT_FILE, page.encode())
    print(printable(out / REPORT_FILE))
    return 0


COMMANDS = {"campaign": campaign}
EXAMPLES = {
    "deckline campaign": (
        "deckline campaign examples/campaigns/fog.toml --out fog",
        "deckline campaign examples/campaigns/fog.toml --out fog --ray 10.0.0.1:6379",
        "deckline campaign examples/campaigns/points.toml --out points --against rendered",
    ),
}
