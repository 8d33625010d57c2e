import math

import pytest

from deckline.app.simulate import parse_visibility


@pytest.mark.parametrize(
    ("text", "expected"),
    [("clear", (math.inf, math.inf)), ("800", (800.0, 800.0)), ("300..3000", (300.0, 3000.0))],
)
def test_visibility_is_one_value_a_range_or_clear(text, expected):
    assert parse_visibility(text) == expected


@pytest.mark.parametrize("text", ["", "fog", "3000..300", "0", "-5..10", "nan"])
def test_other_visibilities_are_refused_by_name(text):
    with pytest.raises(ValueError, match=f"visibility .* got {text!r}"):
        parse_visibility(text)
