import csv
import json
import os
import re
import signal
import threading
from dataclasses import replace

import av
import pytest

from approach_scene import STILL, Approach, chain
from deckline.config import Models, RunConfig
from deckline.config_file import read_config
from deckline.flight import Flight
from deckline.report.run import run
from deckline.report.run_folder import UNFINISHED

CONFIG = replace(STILL, models=Models(dehazer="none", detector="ufld"))
OUTPUTS = ["guidance.csv", "guidance.jsonl", "overlay.mp4", "report.html", "run.toml"]


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it, as nothing could catch SIGKILL."""


def records(out):
    return [json.loads(line) for line in (out / "guidance.jsonl").read_text(encoding="utf-8").splitlines()]


def without_times(found):
    return [{key: value for key, value in record.items() if key != "seconds"} for record in found]


def pictures(out) -> int:
    with av.open(str(out / "overlay.mp4")) as container:
        return sum(1 for _ in container.decode(video=0))


def contents(out):
    return {name: (out / name).read_bytes() for name in OUTPUTS}


def breaking(at: int, action, chain=chain):
    """A chain that does something while it is at its frame number `at`, counted from 0."""
    seen = iter(range(10_000))

    def broken(frame):
        if next(seen) == at:
            action()
        return chain(frame)

    return broken


def follow(flight):
    """A chain that tracks what `chain` detects."""
    return lambda frame: flight(frame, detection=chain(frame).detection)


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def kill():
    raise Killed


def test_a_run_writes_whole_files_and_counts_every_frame(tmp_path, capsys):
    out = tmp_path / "new" / "out"
    summary = run(Approach(6, bad=(2,)), chain, out, config=CONFIG)
    assert summary.exit_code == 0
    assert {kind: count for kind, count in summary.counts.items() if count} == {"unverified": 5, "skipped": 1}
    assert sorted(path.name for path in summary.written) == OUTPUTS
    assert sorted(path.name for path in out.iterdir()) == OUTPUTS
    assert read_config(RunConfig, out / "run.toml") == CONFIG
    assert [record["file"] for record in records(out)] == [f"frame_{i:03d}.png" for i in range(6)]
    assert records(out)[2] == {"file": "frame_002.png", "skipped": "cut short"}
    with (out / "guidance.csv").open(newline="", encoding="utf-8") as file:
        assert [row["file"] for row in csv.DictReader(file)] == [record["file"] for record in records(out)]
    assert pictures(out) == 5
    assert (out / "report.html").read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert "skipped frame_002.png: cut short" in capsys.readouterr().err


def test_a_view_watches_each_frame_with_its_record(tmp_path):
    seen = []
    run(Approach(3, bad=(1,)), chain, tmp_path, config=CONFIG, views=(lambda *frame: seen.append(frame),))
    assert [record["file"] for _, record in seen] == [record["file"] for record in records(tmp_path)]
    assert [result and result.frame.file for result, _ in seen] == ["frame_000.png", None, "frame_002.png"]


def test_a_frame_that_a_stage_refuses_is_skipped_with_its_reason(tmp_path):
    def refuse():
        raise ValueError("image too\nsmall")

    summary = run(Approach(3), breaking(1, refuse), tmp_path)
    assert summary.counts["skipped"] == 1
    assert records(tmp_path)[1] == {"file": "frame_001.png", "skipped": "image too small"}


def test_ctrl_c_leaves_whole_files_and_resume_gives_the_whole_run(tmp_path, capsys):
    source = Approach(12, bad=(3,))
    summary = run(source, breaking(5, press_ctrl_c), tmp_path / "a")
    assert summary.exit_code == 130
    assert sorted(path.name for path in summary.written) == OUTPUTS
    assert len(records(tmp_path / "a")) == 7
    assert pictures(tmp_path / "a") == 6
    assert "--resume" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    resumed = run(source, chain, tmp_path / "a", resume=True)
    assert resumed.exit_code == 0
    run(source, chain, tmp_path / "b")
    assert without_times(records(tmp_path / "a")) == without_times(records(tmp_path / "b"))
    assert pictures(tmp_path / "a") == 11
    assert not (tmp_path / "a" / UNFINISHED).exists()


def test_a_resumed_run_says_where_its_track_began_anew(tmp_path):
    first, second = (follow(Flight.from_config(CONFIG)) for _ in range(2))
    run(Approach(8), breaking(3, press_ctrl_c, first), tmp_path)
    run(Approach(8), breaking(8, kill, second), tmp_path, resume=True)
    flags = [[flag["name"] for flag in record["track"]["flags"]] for record in records(tmp_path)]
    assert flags == [[], [], [], [], ["resumed"], [], [], []]
    assert [record["track"]["age_s"] for record in records(tmp_path)][3:6] == [0.75, 0.0, 0.25]


def test_lines_can_be_read_while_the_run_goes_on(tmp_path):
    counts = []

    def look(frame):
        counts.append(len(records(tmp_path)))
        return chain(frame)

    run(Approach(4), look, tmp_path)
    assert counts == [0, 1, 2, 3]


def test_a_killed_run_leaves_the_earlier_one_whole_and_can_be_resumed(tmp_path):
    run(Approach(3), chain, tmp_path)
    before = contents(tmp_path)
    with pytest.raises(Killed):
        run(Approach(8), breaking(5, kill), tmp_path, overwrite=True)
    assert contents(tmp_path) == before
    with (tmp_path / UNFINISHED / "guidance.jsonl").open("a") as file:
        file.write('{"file":"frame_005.png","sta')
    summary = run(Approach(8), chain, tmp_path, resume=True)
    assert summary.counts["unverified"] == 8
    assert [record["file"] for record in records(tmp_path)] == [f"frame_{i:03d}.png" for i in range(8)]
    assert pictures(tmp_path) == 8


def test_frames_whose_pictures_were_lost_are_shown_again_but_recorded_once(tmp_path):
    with pytest.raises(Killed):
        run(Approach(8), breaking(6, kill), tmp_path)
    for piece in (tmp_path / UNFINISHED).glob("film-*.mp4"):
        piece.write_bytes(piece.read_bytes()[:100])
    run(Approach(8), chain, tmp_path, resume=True)
    assert [record["file"] for record in records(tmp_path)] == [f"frame_{i:03d}.png" for i in range(8)]
    assert pictures(tmp_path) == 8


def test_a_run_without_any_usable_frame_ends_with_1_and_leaves_no_outputs_of_the_old_one(tmp_path):
    run(Approach(3), chain, tmp_path)
    summary = run(Approach(2, bad=(0, 1)), chain, tmp_path, overwrite=True)
    assert (summary.exit_code, summary.counts["skipped"]) == (1, 2)
    names = ["guidance.csv", "guidance.jsonl", "report.html", "run.toml"]  # without a frame there is no film
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in summary.written) == names
    assert len(records(tmp_path)) == 2


def test_resuming_another_source_or_a_whole_run_is_refused(tmp_path):
    run(Approach(4), breaking(1, press_ctrl_c), tmp_path)
    with pytest.raises(ValueError, match=rf"{tmp_path}.*frames 4.* 5"):
        run(Approach(5), chain, tmp_path, resume=True)
    run(Approach(4), chain, tmp_path, resume=True)
    with pytest.raises(ValueError, match=rf"{tmp_path}.*resume"):
        run(Approach(4), chain, tmp_path, resume=True)


def test_an_older_result_is_replaced_only_when_asked_for(tmp_path):
    run(Approach(3), chain, tmp_path)
    before = contents(tmp_path)
    with pytest.raises(ValueError, match=rf"{tmp_path}.*--overwrite"):
        run(Approach(2), chain, tmp_path)
    assert contents(tmp_path) == before
    run(Approach(2), breaking(0, press_ctrl_c), tmp_path, overwrite=True)
    with pytest.raises(ValueError, match=rf"{tmp_path}.*--resume.*--overwrite"):
        run(Approach(2), chain, tmp_path)
    assert run(Approach(2), chain, tmp_path, overwrite=True).frames == 2
    assert not (tmp_path / UNFINISHED).exists()


@pytest.mark.parametrize(("placed", "said"), [(4, []), (2, ["4 of 6"])])
def test_the_terminal_says_why_most_frames_have_no_distances(tmp_path, capsys, placed, said):
    def blind_from(at):
        return chain(at if at.time_s < 0.25 * placed else replace(at, deck_z_m=None))

    run(Approach(6), blind_from, tmp_path)
    lines = [line for line in capsys.readouterr().err.splitlines() if "no distances" in line]
    assert [re.search(r"(\d of \d) frames.*--deck-z-m", line)[1] for line in lines] == said


def test_ctrl_c_while_files_are_made_says_what_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("deckline.report.run.write_csv", lambda *_: press_ctrl_c())
    with pytest.raises(KeyboardInterrupt, match=r"guidance\.jsonl"):
        run(Approach(3), chain, tmp_path)
    monkeypatch.undo()
    assert run(Approach(3), chain, tmp_path, resume=True).counts["unverified"] == 3


def test_max_frames_counts_bad_frames_as_well(tmp_path):
    summary = run(Approach(6, bad=(0,)), chain, tmp_path, max_frames=3)
    assert summary.frames == 3
    assert summary.counts["skipped"] == 1
    with pytest.raises(ValueError, match=r"max_frames.* 0"):
        run(Approach(6), chain, tmp_path, max_frames=0)


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match="file/out"):
        run(Approach(2), chain, tmp_path / "file" / "out")


def test_a_run_works_outside_the_main_thread(tmp_path):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(run(Approach(2), chain, tmp_path).exit_code))
    thread.start()
    thread.join()
    assert codes == [0]
