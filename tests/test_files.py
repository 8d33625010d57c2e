import errno
import re

import pytest

from cli.bad_files import link_to, listen
from deckline.files import MOST_DEPTH, MOST_WORD, describe_error, name_in_errors, parse_toml, read_regular, shorten


@pytest.mark.parametrize("make", [listen, link_to("/dev/zero"), link_to("circle")], ids=["socket", "device", "circle"])
def test_what_is_no_regular_file_is_refused_and_not_waited_for(make, tmp_path):
    make(tmp_path / "circle")
    with pytest.raises(OSError, match=re.escape(str(tmp_path / "circle"))):
        read_regular(tmp_path / "circle")


@pytest.mark.parametrize(
    "key", ["a" + 200_000 * ".a", "[a" + 60 * " . 'b c'" + "]", 'x = {a."b".' + 60 * '"+".' + "c=1}"]
)
def test_keys_of_too_many_parts_are_refused_unparsed(key):
    with pytest.raises(ValueError, match=f"line 2.* {MOST_DEPTH} "):
        parse_toml(f"y = 1\n{key} = 1\n")


def test_dots_of_numbers_and_texts_are_no_keys():
    values = parse_toml(f"a = [{200 * '0.1, '}]\nb.c = 'x.y.z'\n")
    assert (len(values["a"]), values["b"]) == (200, {"c": "x.y.z"})


def test_a_long_text_loses_its_middle():
    assert shorten("a" * 9, 9) == "a" * 9
    assert shorten("abcdefghij", 8) == "abc...ij"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("two\nlines"), "two lines"),
        (MemoryError(), "MemoryError"),
        (OSError(errno.EFBIG, "File too large", "out/a.bin"), "out/a.bin: File too large"),
        (OSError(errno.EXDEV, "Invalid link", "a", None, "b"), "a -> b: Invalid link"),
        (OSError("no number"), "no number"),
    ],
)
def test_errors_are_one_line_with_the_files_name(error, line):
    assert describe_error(error) == line


def test_long_names_and_errors_are_shortened():
    line = describe_error(OSError(errno.ENAMETOOLONG, "File name too long", 5000 * "a"))
    assert line.endswith(": File name too long") and line.count("a") < MOST_WORD + 9
    assert len(describe_error(ValueError(5000 * "a b "))) == 2000


def test_an_error_of_the_system_without_a_name_gets_one(tmp_path):
    with pytest.raises(OSError) as found, name_in_errors(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert (found.value.errno, found.value.filename) == (errno.ENOSPC, str(tmp_path))
    with pytest.raises(OSError) as found, name_in_errors(tmp_path):
        raise OSError(errno.ENOENT, "No such file", "a")
    assert found.value.filename == "a"
