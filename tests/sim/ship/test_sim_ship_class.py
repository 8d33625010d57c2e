from dataclasses import replace

import pytest

from deckline.config_file import read_config
from deckline_sim.ship.ship_class import SHIP_CLASSES, SHIPS, LineStyle, ShipClass, load_class

CVN = (SHIPS / "cvn.toml").read_text(encoding="utf-8")
EDGE = load_class("cvn").plan.edge


def test_every_file_is_a_class():
    assert {path.name for path in SHIPS.iterdir()} == {f"{name}.toml" for name in SHIP_CLASSES}
    for name in SHIP_CLASSES:
        ship = load_class(name)
        assert (ship.hull is None) == ship.on_land == (name == "runway")


def test_an_unknown_class_is_named():
    with pytest.raises(ValueError, match=r"'paper', 'cvn', .*'kuz'"):
        load_class("kuz")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rail_m = 0.75", "rail = 0.75", r"plan\.edge\.rail\b.*rail_m"),
        ('kind = "ladder"', 'kind = "dots"', r"plan\.edge\.kind.*'ladder', 'stripe', 'double', 'dashed'.*'dots'"),
        ("[332.85, -11]]", "[330, -11]]", r"332\.85.*330"),
        (
            "[strip]",
            "[world_lines]\nleft = [0, 0]\nright = [0, 9]\nstart_x_m = 0\nlength_m = 9\n[strip]",
            "world_lines",
        ),
        ("length_m", "on_land = true\nlength_m", "on_land True"),
        ("[strip]", "[strip", "TOML"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in CVN
    (tmp_path / "mine.toml").write_text(CVN.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"mine\.toml: [^\n]*{message}[^\n]*$"):
        read_config(ShipClass, tmp_path / "mine.toml")


def test_impossible_styles_are_refused():
    with pytest.raises(ValueError, match=r"bar.*\(3.4, 0.75, 4.0, 3.6\)"):
        replace(EDGE, bar_m=4.0)
    with pytest.raises(ValueError, match=r"rgbs.*\(0.5, 0, 5.0, 0.0\)"):
        LineStyle(0.5, ())
    with pytest.raises(ValueError, match=r"gap_m.*\(0.5, 1, 5.0, -1.0\)"):
        LineStyle(0.5, ((1, 1, 1),), gap_m=-1.0)
