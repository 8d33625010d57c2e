"""The options --jobs and --ray of a command: who works."""

from typing import Annotated

import tyro

from deckline_sim.processes import Jobs, RayCluster, process_count

RayOption = Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[ADDRESS]", help_behavior_hint="")]


def choose_workers(ray: tuple[str, ...] | None, jobs: int) -> Jobs:
    """Who works: processes of this machine, or a Ray cluster.

    Args:
        ray: of --ray: an address, or nothing for a cluster that is started here; None: not asked for.
        jobs: processes, without a cluster; 0: one for every core.

    Raises:
        ValueError: more than one address, or negative jobs.
    """
    process_count(jobs)
    if ray is None:
        return jobs
    if len(ray) > 1:
        raise ValueError(f"--ray takes one address, got {' '.join(ray)}")
    return RayCluster(*ray)
