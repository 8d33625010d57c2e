from dataclasses import replace

import pytest

from deckline.sim.ship.ship_class import SHIP_CLASSES, SHIPS, LineStyle, Plan, load_class, read_class

CVN = (SHIPS / "cvn.toml").read_text(encoding="utf-8")


def refused(tmp_path, text):
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"^mine\.toml: [^\n]+$") as error:
        read_class(tmp_path / "mine.toml")
    return str(error.value)


@pytest.mark.parametrize("name", SHIP_CLASSES)
def test_every_class_loads(name):
    ship = load_class(name)
    assert ship.name == name
    assert ship.about.endswith(".")
    assert (ship.hull is None) == ship.on_land


def test_every_file_is_a_class():
    assert {path.name for path in SHIPS.iterdir()} == {f"{name}.toml" for name in SHIP_CLASSES}


def test_values_arrive_as_written():
    ship = load_class("cvn")
    assert ship.strip is not None
    assert ship.strip.port_angle_deg == 8.49
    assert ship.port_m[1] == (25.0, -21.0)
    assert isinstance(ship.port_m[0][0], float)  # written as an integer
    assert ship.plan.wires_m == (52.0, 64.4, 76.8)
    assert ship.plan.fouls[0][1].rgbs[0] == (0.6, 0.12, 0.1)
    assert ship.plan.panels[0].border is not None
    assert len(ship.plan.catapults) == 4


def test_an_unknown_class_is_named():
    with pytest.raises(ValueError, match=r"one of \('paper', 'cvn', .*got 'kuz'"):
        load_class("kuz")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rail_m = 0.75", "rail = 0.75", "unknown key plan.edge.rail, expected one of kind, width_m"),
        ("start_m = [2.5, 5.0]", "", "missing key strip.start_m"),
        ("length_m = 332.85 ", 'length_m = "long" ', "length_m must be a float, got 'long'"),
        ("stern_x_m = 2.0", "stern_x_m = true", "hull.stern_x_m must be a float, got True"),
        ("start_m = [2.5, 5.0]", "start_m = [2.5]", "strip.start_m must have 2 entries, got 1"),
        ("start_m = [2.5, 5.0]", "start_m = 2.5", "strip.start_m must be an array, got 2.5"),
        ('kind = "ladder"', 'kind = "dots"', "plan.edge.kind must be one of ('ladder', 'stripe', 'double', 'dashed')"),
        ("[332.85, -11]]", "[330, -11]]", "must run from x = 0 to 332.85 with growing x"),
        ("[hull]", "[place]\n[hul]", "unknown key hul"),
        (
            "[strip]",
            "[lines]\nleft_m = [[0, 0], [9, 0]]\nright_m = [[0, 9], [9, 9]]\n[strip]",
            "got ['strip', 'lines']",
        ),
        ("about =", "on_land = true\nabout =", "a hull belongs to a ship and none to a runway on land"),
        ("[strip]", "[strip", "Expected ']' at the end of a table"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, old, new, message):
    assert old in CVN
    assert message in refused(tmp_path, CVN.replace(old, new, 1))


EDGE = load_class("cvn").plan.edge


def test_both_edges_share_a_style_unless_the_right_one_has_its_own():
    other = replace(EDGE, kind="stripe")
    assert Plan(edge=EDGE).edges == (EDGE, EDGE)
    assert Plan(edge=EDGE, right_edge=other).edges == (EDGE, other)


def test_an_empty_plan_paints_nothing_beside_its_edges():
    plan = Plan(edge=EDGE)
    assert not any((plan.catapults, plan.panels, plan.spots, plan.stripes, plan.numbers, plan.wires_m, plan.fouls))
    assert plan.area_opacity == plan.ramp_m == plan.stern_m == plan.port_border_m == plan.starboard_border_m == 0.0


def test_impossible_styles_are_refused():
    with pytest.raises(ValueError, match=r"pitch > bar > 0, got width, rail, bar, pitch \(3.4, 0.75, 4.0, 3.6\)"):
        replace(EDGE, bar_m=4.0)
    with pytest.raises(ValueError, match=r"got 0 colours and \(0.5, 5.0, 0.0\)"):
        LineStyle(0.5, ())
    with pytest.raises(ValueError, match=r"dash > 0 and gap >= 0, got 1 colours and \(0.5, 5.0, -1.0\)"):
        LineStyle(0.5, ((1, 1, 1),), gap_m=-1.0)
