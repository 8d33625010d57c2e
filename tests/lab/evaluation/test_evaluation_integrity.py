import json
import re
from pathlib import Path

import pytest
from refused import refuse

from deckline.cli.main import main
from deckline.options import RunOptions
from deckline_lab.evaluation.approaches import FlightsConfig, PointNoise, fly_points
from deckline_lab.evaluation.integrity_faults import FAULTS, Runs
from deckline_lab.evaluation.integrity_runs import IntegrityConfig, flat_figures, integrity_tables
from deckline_lab.evaluation.integrity_score import NOMINAL, FaultRun, FrameState, flight_with, fly_run
from deckline_sim.landing.modelled_detector import point_flight
from golden import check_golden

CALM = RunOptions(grade="good", sea_state=0.0)
FLIGHTS = FlightsConfig(frames=16, range_m=(500.0, 60.0), visibility="clear", options=CALM)
SHORT = ("--frames", "6", "--range-m", "400", "200", "--fault", "swapped lines", "--runs", "1", "--nominal", "2")


def fly(run: FaultRun) -> list[FrameState]:
    sightings = list(fly_points(FLIGHTS.approach(run.number), FLIGHTS.run.sensors, PointNoise()))
    return fly_run(sightings, run, FLIGHTS, point_flight(FLIGHTS.run))


def test_a_nominal_flight_is_followed_to_decimetres():
    states = fly(FaultRun(NOMINAL, 0))
    assert len(states) == 16
    assert not any(state.faulty for state in states)
    settled = [state for state in states if state.lateral_m is not None][3:]
    assert len(settled) >= 10
    assert max(abs(state.lateral_m) for state in settled) < 1.0
    assert max(abs(state.height_m) for state in settled) < 1.0


def test_swapped_lines_are_not_followed():
    """The track leaves them out and coasts; its lines are not exchanged."""
    states = [m for m in fly(FaultRun("swapped lines", 0)) if m.faulty]
    assert 5 < len(states) < 14
    assert all(state.lateral_m is None or abs(state.lateral_m) < 3.0 for state in states)


def test_a_fault_of_the_stated_width_misstates_it_either_way():
    sightings = list(fly_points(FLIGHTS.approach(0), FLIGHTS.run.sensors, PointNoise()))
    models = point_flight(FLIGHTS.run)

    def stated(run):
        return flight_with(sightings, run, FLIGHTS, models).config.deck.width_m

    true_m = stated(FaultRun(NOMINAL, 0, "width"))
    shares = {round(stated(FaultRun("width 20% off", number)) / true_m, 6) for number in range(6)}
    assert shares == {0.8, 1.2}
    assert stated(FaultRun(NOMINAL, 0)) is None


def test_a_slow_flight_is_flown_slowly():
    slow = FlightsConfig(frames=3, range_m=(300.0, 100.0), visibility="clear", speed_m_s=20.0)
    times = [at.frame.time_s for at in fly_points(slow.approach(0), slow.run.sensors, PointNoise())]
    assert times[-1] == pytest.approx(10.0)


def run(*errors_m: float, faulty=True, flagged=False) -> list[FrameState]:
    return [FrameState(0.5 * k, faulty, flagged, error, 0.0, 1.0, 1.0) for k, error in enumerate(errors_m)]


def test_tables_of_known_runs():
    by_fault = {
        "foul line": [run(0.0, 0.5), run(9.0, 9.0, 9.0, 9.0)],
        NOMINAL: [
            [*run(0.1, faulty=False), FrameState(0.5, False, True, 0.1, 0.0, 1.0, 1.0, flags=["height"])],
            run(0.1, 1.5, faulty=False),
        ],
    }
    results = {"tables": integrity_tables(by_fault, 1.0), "figures": flat_figures(by_fault, 1.0)}
    check_golden(Path(__file__).parent / "golden" / "integrity.json", results)


def test_faults_that_the_same_flights_carry_are_no_new_flights():
    misled, good = run(9.0, 9.0, 9.0, 9.0), run(0.0, 0.5)
    titles = []
    for faults in (("foul line",), ("foul line", "catapult track", "frozen camera")):
        titles.append(integrity_tables({name: [misled] * 6 + [good] * 6 for name in faults}, 1.0)[0].title)
    assert titles[0].startswith("faults: 50.00 [") and titles[1].startswith("faults: 50.00 [")
    low, high = (float(text) for text in re.findall(r"\[(.*?), (.*?)\]", titles[1])[0])
    assert low < 30 and high > 70  # 36 independent runs: 33 to 67 %


def test_a_stopped_command_resumes(tmp_path, capsys):
    out, figures = tmp_path / "out", tmp_path / "figures.json"
    assert main(["eval", "integrity", *SHORT, "--out", str(out)]) == 0
    first = capsys.readouterr().out
    assert "swapped lines" in first
    lines = (out / "integrity.jsonl").read_text().splitlines()
    assert len(lines) == 1 + 3
    (out / "integrity.jsonl").write_text("\n".join(lines[:2]) + "\n" + lines[2][:40])
    again = ["eval", "integrity", *SHORT, "--out", str(out), "--json", str(figures), "--jobs", "2"]
    assert main([*again, "--markdown", str(tmp_path / "tables.md")]) == 0
    assert (out / "integrity.jsonl").read_text().splitlines() == lines
    assert json.loads(figures.read_text())["nominal.frames"] == 12
    assert "| swapped lines | 1 |" in (tmp_path / "tables.md").read_text()
    assert "seed 1000, not 7" in refuse(capsys, "integrity", *SHORT, "--out", out, "--seed", "7")


def test_all_faults_and_nominal_flights_are_wanted():
    config = IntegrityConfig(runs=2, nominal=3)
    wanted = config.wanted
    assert len(wanted) == 2 * len(config.faults) + 3
    assert config.faults == [name for name, fault in FAULTS.items() if Runs.MODELLED in fault.runs]
    assert {fault.runs for fault in FAULTS.values()} == {Runs.MODELLED, Runs.RENDERED, Runs.BOTH}
    assert len(set(wanted)) == len(wanted)
    twice = IntegrityConfig(runs=1, nominal=1, fault=("foul line", "foul line"))
    assert twice.wanted == [FaultRun(NOMINAL, 0), FaultRun("foul line", 0)]


def test_a_fault_without_frames_is_named():
    with pytest.raises(ValueError, match=r"swapped poses.* 0"):
        integrity_tables({"swapped poses": [run(0.1, faulty=False)]}, 1.0)
