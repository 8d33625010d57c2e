"""Fly a campaign: a pure function makes the bytes of every shard, which become files that are never made twice.

OUT/plan.json               the plan and the version that flies it
OUT/shards/000123.jsonl     one line a landing: cell, number, seed, settings that vary, weight, what became of it
"""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from deckline import __version__
from deckline.atomic import write_atomic
from deckline.config_file import settings_to_json
from deckline.files import lock_folder, name_in_errors, parse_plain, read_regular
from deckline_lab.campaigns.plan import CampaignPlan, check_plan
from deckline_sim.landing.config import LandingConfig
from deckline_sim.processes import Jobs
from deckline_sim.progress import progress
from deckline_sim.task_files import write_missing

PLAN_FILE, SHARDS = "plan.json", "shards"


class Flown(Protocol):
    """A landing that was flown."""

    def record(self) -> Mapping[str, Any]:
        """JSON values of what became of it."""
        ...


Fly = Callable[[LandingConfig, int], Flown]  # one landing of a config and a seed


def run_campaign(
    plan: CampaignPlan, out: Path, fly: Fly, check: Callable[[LandingConfig], None], jobs: Jobs = 0
) -> None:
    """Fly what of the plan has not been flown.

    Args:
        plan: the campaign.
        out: folder, made when missing.
        fly: one landing; importable by name unless jobs is 1. It has no randomness but its seed's.
        check: refuses a landing that cannot be flown, before any is.
        jobs: who flies.

    Raises:
        ValueError: the folder belongs to another plan, or a landing cannot be flown.
        OSError: the disk refuses, or a process died again and again.
        KeyboardInterrupt: Ctrl-C; its text says how far the campaign is.
    """
    check_plan(plan, check)
    with lock_folder(out), name_in_errors(out):
        _claim_folder(plan, out)
        files = shard_files(plan, out)
        try:
            run_shards(partial(fly_shard, plan=plan, fly=fly), plan, out, jobs)
        except KeyboardInterrupt:
            done = sum(path.exists() for path in files)
            raise KeyboardInterrupt(f"{out} holds {done} of {plan.shards} shards; the same command goes on") from None


def run_shards(make: Callable[[int], bytes], plan: CampaignPlan, out: Path, jobs: Jobs) -> None:
    """Write the shards that are missing, `make(shard)` each, with a bar on the screen."""
    files = dict(zip(shard_files(plan, out), range(plan.shards), strict=True))
    (out / SHARDS).mkdir(exist_ok=True)
    sizes = [len(plan.shard_landings(shard)[1]) for shard in range(plan.shards)]
    done = sum(sizes[shard] for path, shard in files.items() if path.exists())
    with progress("landing", sum(sizes), done, "landings") as advance:
        write_missing(make, files, jobs, lambda shard: advance(sizes[shard]))


def shard_files(plan: CampaignPlan, out: Path) -> list[Path]:
    """Where the shards lie, in order."""
    return [out / SHARDS / f"{shard:06d}.jsonl" for shard in range(plan.shards)]


def fly_shard(shard: int, plan: CampaignPlan, fly: Fly) -> bytes:
    """The bytes of a shard: the same wherever and whenever it is flown.

    Raises:
        ValueError: a landing cannot be flown; names its cell and seed.
    """
    cell, numbers = plan.shard_landings(shard)
    return b"".join(_fly_line(cell, number, plan, fly) for number in numbers)


def _fly_line(cell: int, number: int, plan: CampaignPlan, fly: Fly) -> bytes:
    seed = plan.landing_seed(cell, number)
    drawn, weight = plan.draw(cell, number)
    settings = {**plan.cells[cell], **drawn}
    try:
        landing = fly(plan.config(settings), seed).record()
    except ValueError as error:
        raise ValueError(f"landing {number} of cell {cell} ({settings}), seed {seed}: {error}") from error
    line = {"cell": cell, "number": number, "seed": seed, "settings": settings}
    line |= {} if plan.importance is None else {"weight": weight}
    text = json.dumps(settings_to_json({**line, "landing": landing}), allow_nan=False, separators=(",", ":"))
    return text.encode() + b"\n"


def _claim_folder(plan: CampaignPlan, out: Path) -> None:
    """Write the plan into the folder, or refuse the folder of another plan."""
    path = out / PLAN_FILE
    wanted = {"deckline": __version__, **plan.as_json()}
    if not path.exists():
        if (out / SHARDS).exists():
            raise ValueError(f"{out}: holds shards without {PLAN_FILE}: choose another folder")
        write_atomic(path, (json.dumps(wanted, indent=1, allow_nan=False) + "\n").encode())
        return
    try:
        known = parse_plain(json.loads, read_regular(path).decode())
    except ValueError as error:  # neither JSON nor text
        raise ValueError(f"{path} is damaged ({error}): choose another folder") from None
    names = wanted if isinstance(known, dict) else {}
    changed = [name for name in names if known.get(name) != wanted[name]]
    if changed or not names or known.keys() != wanted.keys():
        raise ValueError(f"{out} belongs to another plan ({', '.join(changed) or PLAN_FILE}): choose another folder")
