import csv
import json
import os
import re
import signal
import threading
from dataclasses import replace

import av
import pytest

from approach_scene import STILL, Approach, ExactChain, chain
from deckline.config import Models, RunConfig
from deckline.config_file import read_config
from deckline.flight import Flight
from deckline.live.source import Playback
from deckline.report.advice import REMEDIES
from deckline.report.records import read_records
from deckline.report.run import run
from deckline.report.run_folder import UNFINISHED
from deckline.types import Reason
from picture_scene import picture_result

CONFIG = replace(STILL, models=Models(dehazer="none", detector="ufld"))
OUTPUTS = ["dehazing.jsonl", "guidance.csv", "guidance.jsonl", "overlay.mp4", "report.html", "run.toml"]


class Killed(BaseException):
    """Stands for a kill: nothing of the program catches it, as nothing could catch SIGKILL."""


class Breaking(ExactChain):
    """A chain that does something while it is at its frame number `at`, counted from 0."""

    def __init__(self, at, action, answer=chain):
        self._at, self._action, self._answer = at, action, answer

    def __call__(self, frame):
        self._at -= 1
        if self._at == -1:
            self._action()
        return self._answer(frame)


class Changed(ExactChain):
    """A chain that answers frames after a change."""

    def __init__(self, change):
        self._change = change

    def __call__(self, frame):
        return super().__call__(self._change(frame))


def follow(flight):
    """Answers that track what `chain` detects."""
    return lambda frame: flight(frame, detection=chain(frame).detection)


def press_ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)


def kill():
    raise Killed


class Out:
    """A run folder."""

    def __init__(self, path):
        self.path = path

    def run(self, source, answers=chain, **how):
        return run(source if isinstance(source, Approach) else Approach(source), answers, self.path, **how)

    @property
    def names(self):
        return sorted(path.name for path in self.path.iterdir())

    @property
    def contents(self):
        return {name: (self.path / name).read_bytes() for name in OUTPUTS}

    @property
    def pictures(self):
        with av.open(str(self.path / "overlay.mp4")) as container:
            return sum(1 for _ in container.decode(video=0))

    def records(self, name="guidance.jsonl"):
        return list(read_records(self.path / name))

    def files(self, name="guidance.jsonl"):
        return [record["file"] for record in self.records(name)]


@pytest.fixture
def out(tmp_path):
    return Out(tmp_path / "out")


def named(*indices):
    return [f"frame_{index:03d}.png" for index in indices]


def test_a_run_writes_whole_files_and_counts_every_frame(out, capsys):
    followed = Breaking(99, kill, follow(Flight.from_config(CONFIG)))
    followed.config = CONFIG
    summary = out.run(Approach(6, bad=(2,)), followed)
    assert (summary.exit_code, summary.frames, summary.counts["skipped"]) == (0, 6, 1)
    assert sorted(path.name for path in summary.written) == out.names == OUTPUTS
    assert read_config(RunConfig, out.path / "run.toml") == CONFIG
    assert out.files() == named(*range(6))
    assert out.records()[2] == {"file": "frame_002.png", "skipped": "cut short"}
    with (out.path / "guidance.csv").open(newline="", encoding="utf-8") as file:
        assert [row["file"] for row in csv.DictReader(file)] == out.files()
    assert out.files("dehazing.jsonl") == named(0, 1, 3, 4, 5)
    assert out.pictures == 5
    assert (out.path / "report.html").read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert "skipped frame_002.png: cut short" in capsys.readouterr().err


def test_a_view_watches_each_frame_with_its_record(out):
    watched = []
    out.run(Approach(3, bad=(1,)), views=(lambda result, record: watched.append((result, json.dumps(record))),))
    assert [json.loads(text) for _, text in watched] == out.records()
    assert not any("dehaze" in record.get("seconds", ()) for record in out.records())  # of the film
    assert [result and result.frame.file for result, _ in watched] == ["frame_000.png", None, "frame_002.png"]


def test_a_frame_that_a_stage_refuses_is_skipped_with_its_reason(out):
    def refuse():
        raise ValueError("image too\nsmall")

    assert out.run(3, Breaking(1, refuse)).counts["skipped"] == 1
    assert out.records()[1] == {"file": "frame_001.png", "skipped": "image too small"}


def test_ctrl_c_leaves_whole_files_and_resume_gives_the_whole_run(out, tmp_path, capsys):
    source, whole = Approach(12, bad=(3,)), Out(tmp_path / "whole")
    summary = out.run(source, Breaking(5, press_ctrl_c))
    assert summary.exit_code == 130
    assert sorted(path.name for path in summary.written) == OUTPUTS
    assert (len(out.files()), out.pictures) == (7, 6)
    assert "--resume" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert out.run(source, resume=True).exit_code == 0
    whole.run(source)
    assert out.records() == whole.records()
    assert out.pictures == 11
    assert out.files("dehazing.jsonl") == whole.files("dehazing.jsonl")
    assert not (out.path / UNFINISHED).exists()


@pytest.mark.parametrize("bad", [(), (4,)])
def test_a_resumed_run_flags_where_its_track_began_anew(out, bad):
    """Also where the first picture after the break is damaged."""
    first, second = (follow(Flight.from_config(CONFIG)) for _ in range(2))
    out.run(Approach(8, bad=bad), Breaking(3, press_ctrl_c, first))
    out.run(Approach(8, bad=bad), Breaking(8, kill, second), resume=True)
    tracks = [record["track"] for record in out.records() if "track" in record]
    after = 3 - len(bad)
    assert [[flag["name"] for flag in track["flags"]] for track in tracks] == [[]] * 4 + [["resumed"]] + [[]] * after
    assert [track["age_s"] for track in tracks][3:6] == [0.75, 0.0, 0.25]


def test_a_live_source_is_run_as_any_other(out, monkeypatch):
    monkeypatch.setattr(Playback, "wait_for_stop", lambda *_: False)
    summary = run(Playback(Approach(3, bad=(1,))), chain, out.path)
    assert (summary.exit_code, summary.frames, summary.counts["skipped"]) == (0, 3, 1)
    assert out.files() == named(0, 1, 2)
    with pytest.raises(ValueError, match="approach"):
        run(Playback(Approach(3)), chain, out.path, resume=True)


def test_a_killed_run_leaves_the_earlier_one_whole_and_can_be_resumed(out):
    out.run(3)
    before = out.contents
    with pytest.raises(Killed):
        out.run(8, Breaking(5, kill), overwrite=True)
    assert out.contents == before
    with (out.path / UNFINISHED / "guidance.jsonl").open("a") as file:
        file.write('{"file":"frame_005.png","sta')
    assert out.run(8, resume=True).counts["unverified"] == 8
    assert out.files() == named(*range(8))
    assert out.pictures == 8


def test_frames_whose_pictures_were_lost_are_shown_again_but_recorded_once(out):
    with pytest.raises(Killed):
        out.run(8, Breaking(6, kill))
    for piece in (out.path / UNFINISHED).glob("film-*.mp4"):
        piece.write_bytes(piece.read_bytes()[:100])
    out.run(8, resume=True)
    assert out.files() == out.files("dehazing.jsonl") == named(*range(8))
    assert out.pictures == 8


def test_a_run_without_any_usable_frame_ends_with_1_and_leaves_no_outputs_of_the_old_one(out):
    out.run(3)
    summary = out.run(Approach(2, bad=(0, 1)), overwrite=True)
    assert (summary.exit_code, summary.counts["skipped"]) == (1, 2)
    names = ["guidance.csv", "guidance.jsonl", "report.html", "run.toml"]  # without a frame there is no film
    assert out.names == sorted(path.name for path in summary.written) == names
    assert len(out.files()) == 2


def test_resuming_another_source_or_a_whole_run_is_refused(out):
    out.run(4, Breaking(1, press_ctrl_c))
    with pytest.raises(ValueError, match=rf"{out.path}.*frames 4.* 5"):
        out.run(5, resume=True)
    out.run(4, resume=True)
    with pytest.raises(ValueError, match=rf"{out.path}.*resume"):
        out.run(4, resume=True)


def test_an_older_result_is_replaced_only_when_asked_for(out):
    out.run(3)
    before = out.contents
    with pytest.raises(ValueError, match=rf"{out.path}.*--overwrite"):
        out.run(2)
    assert out.contents == before
    out.run(2, Breaking(0, press_ctrl_c), overwrite=True)
    with pytest.raises(ValueError, match=rf"{out.path}.*--resume.*--overwrite"):
        out.run(2)
    assert out.run(2, overwrite=True).frames == 2
    assert not (out.path / UNFINISHED).exists()


@pytest.mark.parametrize(("placed", "counts"), [(4, []), (2, ["4 of 6"])])
def test_the_terminal_names_why_most_frames_have_no_distances(out, capsys, placed, counts):
    out.run(6, Changed(lambda at: at if at.time_s < 0.25 * placed else replace(at, deck_z_m=None)))
    lines = [line for line in capsys.readouterr().err.splitlines() if "no distances" in line]
    assert [re.search(r"(\d of \d) frames.*--deck-z-m", line)[1] for line in lines] == counts


def test_the_terminal_names_why_most_frames_are_unverified_and_what_ends_it(out, capsys):
    out.run(Approach(6, bad=(2,)))
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("unverified")]
    assert "5 of 5" in line and line.endswith(f"{Reason.NO_SCALE}: {REMEDIES[Reason.NO_SCALE]}")


def test_ctrl_c_while_files_are_made_names_what_is_whole(out, monkeypatch):
    monkeypatch.setattr("deckline.report.writer.write_csv", lambda *_: press_ctrl_c())
    with pytest.raises(KeyboardInterrupt, match=r"guidance\.jsonl"):
        out.run(3)
    monkeypatch.undo()
    assert out.run(3, resume=True).counts["unverified"] == 3


def test_max_frames_counts_bad_frames_as_well(out):
    summary = out.run(Approach(6, bad=(0,)), max_frames=3)
    assert (summary.frames, summary.counts["skipped"]) == (3, 1)
    with pytest.raises(ValueError, match=r"max_frames.* 0"):
        out.run(6, max_frames=0)


def test_a_folder_that_cannot_be_made_is_named(out):
    out.path.write_text("in the way")
    with pytest.raises(ValueError, match="out/inside"):
        run(Approach(2), chain, out.path / "inside")


def test_a_run_works_outside_the_main_thread(out):
    codes = []
    thread = threading.Thread(target=lambda: codes.append(out.run(2).exit_code))
    thread.start()
    thread.join()
    assert codes == [0]


@pytest.mark.parametrize("in_widths", [True, False])
def test_the_terminal_does_not_miss_distances_that_the_picture_gives(out, capsys, in_widths):
    results = iter([picture_result(in_widths, index=index) for index in range(4)])

    class OfThePicture(ExactChain):
        def __call__(self, at, sides=()):
            return next(results)

    out.run(4, OfThePicture())
    errors = capsys.readouterr().err
    assert "no distances" not in errors
    reason = Reason.NO_WIDTH if in_widths else Reason.YOUNG_TRACK
    assert f"most often {reason}: {REMEDIES[reason]}" in errors
