"""The closed loop of the example: it lands where deckline guides, and waves off where it does not."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from airsim_serving import CONFIG, ask, connect, run_server

pytest.importorskip("cosysairsim")
SCRIPT = Path(__file__).parents[3] / "examples" / "09_airsim_closed_loop.py"


def fly(tmp_path, visibility_m, width=640):
    """The example's process, and the vehicle's last height, world z, m."""
    size = {"width": width, "height": width * 9 // 16}
    config = replace(CONFIG, **size, start_m=20.0, visibility_m=(visibility_m, visibility_m))
    with run_server(tmp_path, config, speed=20.0) as server:
        words = [sys.executable, str(SCRIPT), str(server.port)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=240, check=False)
        with connect(server.port) as peer:
            pose = ask(peer, "simGetVehiclePose")[1]
    return done, pose["position"]["z_val"]


def test_it_lands_near_the_touchdown_point(tmp_path):
    done, _ = fly(tmp_path, 1000.0)
    assert done.returncode == 0, done.stderr
    place, off = done.stdout.splitlines()[-1].split(", ")
    assert place == "on Deck" and float(off.split()[0]) < 3.0


def test_it_waves_off_where_it_sees_nothing(tmp_path):
    done, z_m = fly(tmp_path, 10.0, width=160)
    assert done.returncode == 1
    assert z_m < -30.0  # it began 6 m over the deck and has climbed
