import os

import pytest

from deckline.processes import in_processes, process_count


def square(number):
    return number**2, sorted(os.sched_getaffinity(0)), os.getpid()


def die(number):
    os._exit(1)


def test_results_come_in_order_from_processes_on_their_own_cores():
    cores = process_count(0)
    found = list(in_processes(square, [3, 1, 2], 2))
    assert [(number, result[0]) for number, result in found] == [(3, 9), (1, 1), (2, 4)]
    for _, (_, own, pid) in found:
        assert pid != os.getpid()
        assert len(own) in {max(1, cores // 2), (cores + 1) // 2}
    by_process = {pid: set(own) for _, (_, own, pid) in found}
    if cores > 1 and len(by_process) == 2:
        first, second = by_process.values()
        assert not first & second


def test_a_process_that_dies_is_named():
    with pytest.raises(OSError, match="a process died"):
        list(in_processes(die, [1], 1))


def test_how_many():
    assert process_count(3) == 3
    assert process_count(0) == len(os.sched_getaffinity(0))
    with pytest.raises(ValueError, match="--jobs must not be negative, got -2"):
        process_count(-2)
