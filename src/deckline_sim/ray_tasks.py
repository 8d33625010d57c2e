"""Tasks on a Ray cluster. Ray is an extra of its own; only this module imports it."""

import logging
import os
from collections.abc import Callable
from typing import Any

from deckline.extras import needs_extra
from deckline_sim.processes import Finished, ProcessDiedError, process_count

with needs_extra("ray"):
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Ray reads it when it is imported
    os.environ["RAY_ENABLE_UV_RUN_RUNTIME_ENV"] = "0"  # else a program of `uv run` is copied to every node
    # Ray's own 15 starves workers beside other programs: importing scipy then takes minutes instead of seconds.
    os.environ.setdefault("RAY_worker_niceness", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # the behaviour that Ray warns it will have
    import ray
    from ray.exceptions import RayError, RayTaskError

OBJECT_STORE_BYTES = 200 << 20  # of a cluster that is started here: results are small and taken at once
QUEUED = 2  # tasks in flight for every core of the cluster, so that no core waits for the next


class RayPool:
    """Tasks on the nodes of a cluster, a core each. Nothing is copied there: every node has deckline installed.

    Args:
        task: picklable, as are items and results.
        address: of a running cluster; empty: start one here.

    Raises:
        OSError: no cluster answers at the address.
    """

    def __init__(self, task: Callable[[Any], Any], address: str) -> None:
        # Without `local` Ray joins whatever cluster runs on this machine, or ran there last.
        here = {
            "address": "local",
            "num_cpus": process_count(0),
            "object_store_memory": OBJECT_STORE_BYTES,
            "include_dashboard": False,
        }
        where: dict[str, Any] = {"address": address} if address else here
        try:
            ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise OSError(f"no Ray cluster at {address or 'this machine'}: {error}") from error
        self.size = QUEUED * max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._task = ray.put(task)
        self._remote = ray.remote(num_cpus=1, max_retries=0)(_call)
        self._running: dict[Any, int] = {}  # reference to the result -> position of the task

    def submit(self, position: int, item: Any) -> None:
        """Begin a task on the cluster."""
        self._running[self._remote.remote(self._task, item)] = position

    def wait(self) -> list[Finished]:
        """The tasks that have ended; waits for one."""
        ready, _ = ray.wait(list(self._running), num_returns=1)
        return [_finished(self._running.pop(reference), reference) for reference in ready]

    def close(self) -> None:
        """Leave the cluster, which stops the tasks; end it if it was started here."""
        ray.shutdown()


def _call(task: Callable[[Any], Any], item: Any) -> Any:
    return task(item)


def _finished(position: int, reference: Any) -> Finished:
    try:
        return Finished(position, ray.get(reference), None)
    except RayTaskError as error:
        return Finished(position, None, error.cause if isinstance(error.cause, Exception) else error)
    except RayError as error:
        return Finished(position, None, ProcessDiedError(type(error).__name__))
