import json

import pytest

from deckline.evaluation.localization_book import Book

MADE_WITH = {"seed": 3, "range_m": (800.0, 20.0)}


def test_a_book_goes_on_where_it_was(tmp_path):
    Book(tmp_path, "runs.jsonl", MADE_WITH).add("approach 0", [{"range_m": 5.0}])
    again = Book(tmp_path, "runs.jsonl", MADE_WITH)
    assert again.runs == {"approach 0": [{"range_m": 5.0}]}
    again.add("approach 1", [])
    assert list(Book(tmp_path, "runs.jsonl", MADE_WITH).runs) == ["approach 0", "approach 1"]


def test_half_a_line_is_cut_off(tmp_path):
    Book(tmp_path, "runs.jsonl", MADE_WITH).add("approach 0", [1.0])
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write('{"file": "approach 1", "run": [2.')
    book = Book(tmp_path, "runs.jsonl", MADE_WITH)
    assert list(book.runs) == ["approach 0"]
    book.add("approach 1", [2.0])
    rows = [json.loads(line) for line in (tmp_path / "runs.jsonl").read_text().splitlines()]
    assert [row["file"] for row in rows] == ["settings", "approach 0", "approach 1"]


def test_other_settings_and_other_files_are_refused(tmp_path):
    Book(tmp_path, "runs.jsonl", MADE_WITH)
    with pytest.raises(ValueError, match="with seed 3, not 4: choose another folder"):
        Book(tmp_path, "runs.jsonl", MADE_WITH | {"seed": 4})
    (tmp_path / "other.jsonl").write_text('{"file": "a.png", "status": "ok"}\n')
    with pytest.raises(ValueError, match="something else"):
        Book(tmp_path, "other.jsonl", MADE_WITH)
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="not JSON compliant"):
        Book(tmp_path, "runs.jsonl", MADE_WITH).add("approach 0", [float("nan")])
    with pytest.raises(ValueError, match="cannot be written"):
        Book(tmp_path / "file", "runs.jsonl", MADE_WITH)


def test_without_a_folder_nothing_is_written(tmp_path):
    book = Book(None, "runs.jsonl", MADE_WITH)
    book.add("approach 0", [1.0])
    assert book.runs == {"approach 0": [1.0]}
    assert list(tmp_path.iterdir()) == []
