"""Shards: the same bytes whoever flies them, whatever is killed."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import stand_in

import deckline_lab
from deckline_lab.campaigns.plan import read_plan
from deckline_lab.campaigns.runner import PLAN_FILE, SHARDS, fly_shard, run_campaign
from deckline_sim import processes, task_files

PLAN = """
seed = 7
landings = 30
shard = 5
[factors]
visibility_m = [300, 1000]
[ranges]
turbulence = [0.5, 2.0]
"""
PATHS = os.pathsep.join([str(Path(deckline_lab.__file__).parents[1]), str(Path(__file__).parent)])
LONGEST_S = 60.0


@pytest.fixture
def plan_file(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    return path


@pytest.fixture
def expected(plan_file):
    """The bytes of every shard."""
    plan = read_plan(plan_file)
    return {f"{shard:06d}.jsonl": fly_shard(shard, plan, stand_in.fly) for shard in range(plan.shards)}


def shards(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / SHARDS).glob("*.jsonl")}


def start(plan_file: Path, out: Path, jobs: str) -> "subprocess.Popen[bytes]":
    words = [sys.executable, stand_in.__file__, str(plan_file), str(out), jobs]
    return subprocess.Popen(words, env={**os.environ, "PYTHONPATH": PATHS}, stderr=subprocess.PIPE)


def test_a_line_holds_what_was_flown(expected, plan_file):
    plan = read_plan(plan_file)
    lines = [json.loads(line) for data in expected.values() for line in data.splitlines()]
    assert sorted((line["cell"], line["number"]) for line in lines) == [(c, n) for c in (0, 1) for n in range(30)]
    for line in lines:
        config = plan.config(line["settings"])
        assert config.visibility_m == (300.0, 1000.0)[line["cell"]]
        assert stand_in.fly(config, line["seed"]).record() == line["landing"]


def test_finished_shards_are_not_flown_again(tmp_path, plan_file, expected):
    plan, out, flown = read_plan(plan_file), tmp_path / "out", []

    def stop_at(count, config, seed):
        if len(flown) == count:
            raise KeyboardInterrupt
        flown.append((config.visibility_m, seed))
        return stand_in.fly(config, seed)

    with pytest.raises(KeyboardInterrupt, match="3 of 12"):
        run_campaign(plan, out, partial(stop_at, 17), stand_in.accept, 1)
    assert len(shards(out)) == 3
    del flown[15:]  # of the shard that was not finished
    run_campaign(plan, out, partial(stop_at, 1000), stand_in.accept, 1)
    assert len(flown) == len(set(flown)) == 60
    assert shards(out) == expected


def test_a_killed_head_loses_and_repeats_nothing(tmp_path, plan_file, expected):
    out, rng = tmp_path / "out", np.random.default_rng(1)
    for _ in range(2):
        before = shards(out)
        head = start(plan_file, out, "2")
        until = time.monotonic() + LONGEST_S
        more = len(before) + int(rng.integers(1, 3))
        while head.poll() is None and len(shards(out)) < more and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(float(rng.uniform(0, 0.02)))
        head.kill()
        head.communicate()
        assert set(before.items()) <= set(shards(out).items()) <= set(expected.items())
    run_campaign(read_plan(plan_file), out, stand_in.fly, stand_in.accept, 1)
    assert shards(out) == expected


def test_ctrl_c_leaves_whole_shards(tmp_path, plan_file, expected):
    head = start(plan_file, tmp_path / "out", "2")
    until = time.monotonic() + LONGEST_S
    while not shards(tmp_path / "out") and time.monotonic() < until:
        time.sleep(0.01)
    head.send_signal(signal.SIGINT)
    head.communicate(timeout=LONGEST_S)
    assert head.returncode != 0 or shards(tmp_path / "out") == expected
    assert set(shards(tmp_path / "out").items()) <= set(expected.items())


def test_a_dead_process_is_one_line_and_its_shard_is_flown_again(tmp_path, plan_file, expected, monkeypatch, capsys):
    plan, deadly = read_plan(plan_file), tmp_path / "seed"
    deadly.write_text(str(plan.landing_seed(0, 12)))
    monkeypatch.setenv(stand_in.DEADLY_SEED, str(deadly))
    run_campaign(plan, tmp_path / "out", stand_in.fly, stand_in.accept, 2)
    assert shards(tmp_path / "out") == expected
    lines = [line for line in capsys.readouterr().err.splitlines() if ".jsonl" in line]
    assert len(lines) == 1
    assert "exit code 9" in lines[0]


def die(config, seed):
    os._exit(9)


def test_a_shard_that_always_dies_is_named(tmp_path, plan_file, monkeypatch):
    monkeypatch.setattr(processes, "RETRIES", 1)
    with pytest.raises(OSError, match=r"00000\d\.jsonl.* 2 times"):
        run_campaign(read_plan(plan_file), tmp_path / "out", die, stand_in.accept, 2)
    assert shards(tmp_path / "out") == {}


def refuse(config, seed):
    raise ValueError(f"no lift at {config.turbulence:.3f}")


def test_a_landing_that_cannot_be_flown_is_named(tmp_path, plan_file):
    plan = read_plan(plan_file)
    with pytest.raises(ValueError, match=rf"cell 0.*{plan.landing_seed(0, 0)}.*no lift"):
        run_campaign(plan, tmp_path / "out", refuse, stand_in.accept, 1)


def test_an_aircraft_that_cannot_be_trimmed_is_refused_before_anything_is_flown(tmp_path, plan_file):
    def check(config):
        raise ValueError(f"{config.aircraft} cannot be trimmed")

    with pytest.raises(ValueError, match="A4"):
        run_campaign(read_plan(plan_file), tmp_path / "out", die, check, 1)
    assert not (tmp_path / "out").exists()


def test_a_full_disk_leaves_whole_shards(tmp_path, plan_file, expected, monkeypatch):
    written = []

    def fill(path, data):
        if len(written) == 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        written.append(path)
        path.write_bytes(data)

    monkeypatch.setattr(task_files, "write_atomic", fill)
    with pytest.raises(OSError, match=r"000004\.jsonl") as caught:
        run_campaign(read_plan(plan_file), tmp_path / "out", stand_in.fly, stand_in.accept, 1)
    assert caught.value.errno == errno.ENOSPC
    assert len(shards(tmp_path / "out")) == 4
    monkeypatch.undo()
    run_campaign(read_plan(plan_file), tmp_path / "out", stand_in.fly, stand_in.accept, 1)
    assert shards(tmp_path / "out") == expected


@pytest.mark.parametrize(("old", "new", "named"), [("seed = 7", "seed = 8", "seed"), ("2.0", "2.5", "ranges")])
def test_the_folder_of_another_plan_is_refused(tmp_path, plan_file, expected, old, new, named):
    out = tmp_path / "out"
    run_campaign(read_plan(plan_file), out, stand_in.fly, stand_in.accept, 1)
    plan_file.write_text(PLAN.replace(old, new))
    with pytest.raises(ValueError, match=f"out.*{named}"):
        run_campaign(read_plan(plan_file), out, stand_in.fly, stand_in.accept, 1)
    assert shards(out) == expected


def test_a_damaged_plan_file_is_refused(tmp_path, plan_file):
    out = tmp_path / "out"
    out.mkdir()
    (out / PLAN_FILE).write_text('{"seed": 7')
    with pytest.raises(ValueError, match=PLAN_FILE):
        run_campaign(read_plan(plan_file), out, stand_in.fly, stand_in.accept, 1)


def test_the_same_bytes_from_ray(tmp_path, plan_file, expected):
    pytest.importorskip("ray")
    head = start(plan_file, tmp_path / "out", "ray")
    _, errors = head.communicate(timeout=3 * LONGEST_S)
    assert head.returncode == 0, errors.decode()
    assert shards(tmp_path / "out") == expected
