import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.recording import RecordingError
from deckline.recording.text_table import MOST_COLUMNS, MOST_FILES, MOST_LINE_BYTES, MOST_ROWS, TextTable, read_table


def table(tmp_path, text, delimiter=","):
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return TextTable(path, delimiter)


def test_rows_are_cells_by_column_with_the_numbers_of_their_lines(tmp_path):
    found = table(tmp_path, b'\xef\xbb\xbf a , b\r\n1, x \r\n\r\n , \r\n"2,5","y"\r\n3')
    assert list(found) == [(2, {"a": "1", "b": "x"}), (5, {"a": "2,5", "b": "y"}), (6, {"a": "3"})]
    assert (len(found), found.header) == (3, ["a", "b"])
    assert list(found.texts("b")) == ["x", "y", ""]
    assert list(found.texts("c")) == ["", "", ""]
    np.testing.assert_array_equal(found.numbers(["a", "b"]), [[1, np.nan], [np.nan, np.nan], [3, np.nan]])
    assert [line for line, _ in found.take(np.array([True, False, True]))] == [2, 6]


@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=True)] * 3), min_size=1, max_size=9))
def test_numbers_are_those_that_python_reads(tmp_path_factory, rows):
    text = "a\tb\tc\n" + "".join("\t".join(map(repr, row)) + "\n" for row in rows)
    found = table(tmp_path_factory.mktemp("table"), text, "\t")
    np.testing.assert_array_equal(found.numbers(["c", "a"]), [(c, a) for a, _, c in rows])
    some = np.arange(len(rows)) % 2 == 0
    np.testing.assert_array_equal(found.take(some).numbers(["a"])[:, 0], [a for a, _, _ in rows[::2]])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "empty"),
        ("a,b\n", "zero frames"),
        ("a\n1\n", "column b"),
        ("a,b,b\n1,2,3\n", "column b"),
        (b"a,b\n\xff,1\n", "line 2"),
        ("a,b\n" + "x" * (MOST_LINE_BYTES + 1), rf"line 2: .*{MOST_LINE_BYTES + 1:,}.*{MOST_LINE_BYTES:,}"),
        ("a,b" + MOST_COLUMNS * "," + "\n1,2\n", rf"{MOST_COLUMNS + 2:,}.*{MOST_COLUMNS:,}"),
        ("a,b\n" + (MOST_ROWS + 1) * "1\n", rf"{MOST_ROWS + 1:,}.*{MOST_ROWS:,}"),
    ],
    ids=lambda value: str(value)[:9],
)
def test_tables_that_cannot_be_used_name_line_and_bound(tmp_path, text, named):
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RecordingError, match=rf"table\.csv.*{named}"):
        list(read_table(path, ",", ("a", "b"))[0])


def test_files_have_one_row_each_and_are_not_too_many(tmp_path):
    assert table(tmp_path, "file\na\nb\n").index_files() == {"a": 0, "b": 1}
    with pytest.raises(RecordingError, match=r"2 and 4.*'a'"):
        table(tmp_path, "file\na\nb\na\n").index_files()
    with pytest.raises(RecordingError, match=f"{MOST_FILES + 1:,}"):
        table(tmp_path, "file\n" + (MOST_FILES + 1) * "a\n").index_files()
