import math

import pytest

from golden import UPDATE, check_golden

STORED = {"rows": [["left", "0.1 [0.0, 2e-3]"]], "mean": 2.0, "count": 3, "none": None, "most": math.inf}


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setenv(UPDATE, "1")
    check_golden(tmp_path / "golden" / "a.json", STORED)
    monkeypatch.delenv(UPDATE)
    return tmp_path / "golden" / "a.json"


def test_the_same_values_pass_and_rounding_does(path):
    check_golden(path, STORED)
    check_golden(path, STORED | {"mean": 2.0 * (1 + 1e-9), "rows": (("left", "0.1 [0.0, 0.002]"),)})


@pytest.mark.parametrize(
    "change",
    [
        {"mean": 2.001},
        {"count": 4},
        {"none": 0},
        {"most": -math.inf},
        {"rows": [["left", "0.1 [0.0, 3e-3]"]]},
        {"rows": [["right", "0.1 [0.0, 2e-3]"]]},
        {"rows": [["left"]]},
        {"more": 1},
    ],
)
def test_a_change_fails(path, change):
    with pytest.raises(AssertionError):
        check_golden(path, STORED | change)
