import json
import math
import re

import pytest

from deckline_lab.evaluation.store import Store

MADE_WITH = {"seed": 3, "range_m": (800.0, 20.0), "models": {"a": "1"}}
NAME = "rows.jsonl"


def open_store(out, extendable=None, **changes) -> Store:
    return Store(out, NAME, MADE_WITH | changes, extendable)


def test_a_store_resumes_after_a_line_that_was_cut_short(tmp_path):
    open_store(tmp_path).add(("a", 0), {"range_m": math.inf, "errors": [1.0, 2.0]})
    with (tmp_path / NAME).open("a") as file:
        file.write('{"key": ["a", 1], "row": [2.')
    store = open_store(tmp_path)
    assert store.rows == {("a", 0): {"range_m": math.inf, "errors": [1.0, 2.0]}}
    store.add(("a", 1), {"range_m": math.nan})
    assert list(open_store(tmp_path).rows) == [("a", 0), ("a", 1)]
    lines = (tmp_path / NAME).read_text().splitlines()
    assert [next(iter(json.loads(line))) for line in lines] == ["settings", "key", "key"]


def test_other_settings_and_other_files_are_refused(tmp_path):
    open_store(tmp_path)
    with pytest.raises(ValueError, match=r"seed 3, not 4"):
        open_store(tmp_path, seed=4)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / NAME).write_text('{"file": "a.png", "status": "ok"}\n')
    with pytest.raises(ValueError, match=NAME):
        open_store(tmp_path / "other")
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match=re.escape(str(tmp_path / "file"))):
        open_store(tmp_path / "file")


def test_entries_may_be_added_to_one_setting_and_none_may_change(tmp_path):
    open_store(tmp_path, "models")
    open_store(tmp_path, "models", models={"b": "2"})
    open_store(tmp_path, "models", models={"a": "1", "b": "2"})
    with pytest.raises(ValueError, match=r'models b "2", not "3"'):
        open_store(tmp_path, "models", models={"b": "3"})
    with pytest.raises(ValueError, match=r"seed 3, not 4"):
        open_store(tmp_path, "models", models={"b": "2"}, seed=4)


def test_without_a_folder_rows_are_in_memory_alone_and_an_interruption_reports_it(tmp_path):
    store = open_store(None)
    store.add(("a", 0), [1.0])
    assert store.rows == {("a", 0): [1.0]}
    with pytest.raises(KeyboardInterrupt, match="--out"), store:
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt, match=NAME), open_store(tmp_path):
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    "line", ["7", '{"settings": 7}', '{"settings": {"b": ""}}', '{"key": 1, "row": 2}', 2000 * "["]
)
def test_rows_of_something_else_are_refused(tmp_path, line):
    (tmp_path / "rows.jsonl").write_text(f"{line}\n")
    with pytest.raises(ValueError, match=r"rows\.jsonl"):
        Store(tmp_path, "rows.jsonl", {"a": 1, "b": {}}, "b")
