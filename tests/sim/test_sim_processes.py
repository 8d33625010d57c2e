"""One process pool: order, cores, errors; who works."""

import os
import struct
import sys
from pathlib import Path

import pytest

from deckline_sim.processes import RayCluster, map_ordered, process_count
from deckline_sim.workers import choose_workers


def square(number: int) -> tuple[int, list[int], int]:
    return number**2, sorted(os.sched_getaffinity(0)), os.getpid()


def die(number: int) -> None:
    os._exit(1)


def die_in_a_message(died: Path) -> str:
    if died.exists():
        return "done"
    died.touch()
    os.write(sys._getframe(1).f_locals["connection"].fileno(), struct.pack("!i", 1000) + b"half a message")
    os._exit(9)


def refuse(number: int) -> None:
    raise ValueError(f"no use for {number}")


def test_results_come_in_order_from_processes_on_their_own_cores():
    cores = process_count(0)
    results = list(map_ordered(square, [3, 1, 2, 5, 4, 6], 2))
    assert [value for value, _, _ in results] == [9, 1, 4, 25, 16, 36]
    by_process = {pid: set(share) for _, share, pid in results}
    assert os.getpid() not in by_process
    assert {len(share) for share in by_process.values()} <= {max(1, cores // 2), (cores + 1) // 2}
    if cores > 1 and len(by_process) == 2:
        first, second = by_process.values()
        assert not first & second


def test_one_job_is_done_here():
    assert [pid for _, _, pid in map_ordered(square, range(2))] == 2 * [os.getpid()]


@pytest.mark.parametrize(
    ("task", "kind", "named"), [(die, OSError, "a process died"), (refuse, ValueError, "no use for 7")]
)
def test_an_error_in_a_process_is_the_error_here(task, kind, named):
    with pytest.raises(kind, match=named):
        list(map_ordered(task, [7], 2))


def test_a_task_whose_process_died_in_the_middle_of_its_message_is_done_again(tmp_path, capsys):
    assert list(map_ordered(die_in_a_message, [tmp_path / "died"], 2)) == ["done"]
    assert "exit code 9" in capsys.readouterr().err


def test_how_many():
    assert process_count(3) == 3
    assert process_count(0) == len(os.sched_getaffinity(0))
    with pytest.raises(ValueError, match=r"jobs.*-2"):
        process_count(-2)


def test_workers():
    assert choose_workers(None, 3) == 3
    assert choose_workers((), 0) == RayCluster("")
    assert choose_workers(("head:6379",), 0) == RayCluster("head:6379")
    with pytest.raises(ValueError, match="a b"):
        choose_workers(("a", "b"), 0)
    with pytest.raises(ValueError, match=r"jobs.*-1"):
        choose_workers((), -1)
