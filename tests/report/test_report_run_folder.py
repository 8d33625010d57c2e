import os

import numpy as np
import pytest

from deckline.files import lock_folder
from deckline.report.overlay import Panels
from deckline.report.run_folder import (
    JSONL,
    MOST_PICTURES,
    VIDEO,
    PictureSample,
    check_apart,
    resume_folder,
    start_folder,
)

SMALL = Panels(np.zeros((8, 8, 3), dtype=np.uint8), np.zeros((8, 8, 3), dtype=np.uint8))


@pytest.mark.parametrize("count", [1, MOST_PICTURES, MOST_PICTURES + 1, 1000])
def test_pictures_are_few_and_evenly_spread_however_long_the_run(tmp_path, count):
    sample = PictureSample(tmp_path / "pictures")
    for index in range(count):
        sample.add(index, SMALL)
    indices = sample.indices()
    assert min(count, MOST_PICTURES // 2) <= len(indices) <= MOST_PICTURES
    assert indices[0] == 0
    assert len(set(np.diff(indices))) <= 1
    assert len(list((tmp_path / "pictures").iterdir())) == 2 * len(indices)
    assert all(jpeg.startswith(b"\xff\xd8") for index in indices for jpeg in sample.read(index))


def test_a_sample_taken_over_goes_on_as_if_never_stopped(tmp_path):
    whole, stopped = PictureSample(tmp_path / "a"), PictureSample(tmp_path / "b")
    for index in range(300):
        whole.add(index, SMALL)
        if index == 200:
            stopped = PictureSample(tmp_path / "b")
        stopped.add(index, SMALL)
    assert stopped.indices() == whole.indices()


@pytest.mark.parametrize("name", [VIDEO, "report.html", ".unfinished"])
def test_what_no_run_wrote_is_never_replaced(tmp_path, name):
    (tmp_path / name).mkdir() if name == ".unfinished" else (tmp_path / name).write_text("mine")
    with pytest.raises(ValueError, match=name):
        start_folder(tmp_path, {}, overwrite=True)
    with pytest.raises(ValueError, match=str(tmp_path)):
        resume_folder(tmp_path, {})
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_an_older_run_is_replaced_but_no_link_in_it(tmp_path):
    out, secret = tmp_path / "out", tmp_path / "secret"
    out.mkdir()
    secret.write_text("mine")
    (out / JSONL).touch()
    start_folder(out, {"a": "1"}, overwrite=True).finish()
    (out / VIDEO).symlink_to(secret)
    with pytest.raises(ValueError, match=VIDEO):
        start_folder(out, {}, overwrite=True)
    (out / VIDEO).unlink()
    (out / "run.toml").symlink_to(tmp_path / "nowhere")
    with pytest.raises(ValueError, match=str(out)):
        start_folder(out, {})


def test_a_source_among_the_results_is_refused(tmp_path):
    with pytest.raises(ValueError, match=VIDEO):
        check_apart(tmp_path / "x" / ".." / VIDEO, tmp_path)
    check_apart(tmp_path / "film.mp4", tmp_path)


def test_a_folder_has_one_writer_at_a_time(tmp_path):
    out = tmp_path / "out"
    with lock_folder(out), pytest.raises(ValueError, match=str(out)), lock_folder(out):
        pass
    with lock_folder(tmp_path / "out"):
        assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("state", ["{", "[]", "{}", "1" * 400])
def test_a_damaged_state_is_no_run_to_resume(tmp_path, state):
    start_folder(tmp_path, {"a": "1"})
    (tmp_path / ".unfinished" / "run.json").write_text(state)
    with pytest.raises(ValueError, match=r"run\.json"):
        resume_folder(tmp_path, {"a": "1"})


@pytest.mark.parametrize("line", ["0", "[]", "text", "\xff", 2000 * "["])
def test_a_line_that_is_no_record_is_not_resumed_from(tmp_path, line):
    start_folder(tmp_path, {"a": "1"})
    (tmp_path / JSONL).write_text(f"{line}\n")
    with pytest.raises(ValueError, match=r"guidance\.jsonl line 1"):
        resume_folder(tmp_path, {"a": "1"})


def test_records_in_a_fifo_are_not_waited_for(tmp_path):
    start_folder(tmp_path, {"a": "1"})
    (tmp_path / JSONL).unlink()
    os.mkfifo(tmp_path / JSONL)
    with pytest.raises(ValueError, match=str(tmp_path)):
        resume_folder(tmp_path, {"a": "1"})
