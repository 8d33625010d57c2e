"""The report: figures against hand-made truth, escaping, nothing from outside, and that a browser draws it."""

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from approach_scene import STILL
from deckline.recording import BadFrame
from deckline.report.figures import band_rows, count_reasons, error_rows, false_lines, found_rate, number, percent
from deckline.report.html import report_html
from deckline.report.records import GUIDANCE, frame_record, skipped_record
from deckline.report.status import STATUS_COLOURS
from deckline.types import Status
from picture_scene import picture_result

CHROMIUM = shutil.which("chromium")
INFO = {"source": "flights/first", "command": "deckline run flights/first --out out", "date": "2024-06-24"}
JPEG = b"\xff\xd8 not a real picture \xff\xd9"
START_S = 1.7e9  # as a Unix time
SKIPPED = skipped_record(BadFrame("b.png", "cut"))


def record(offset_m=0.0, range_m=200.0, status="ok", truth=True, pose=True, file="a.png"):
    """What the report reads of a frame 3 m right of the centre line, which is measured `offset_m` too far right."""
    true = {"lateral_deviation_m": 3.0, "distance_to_ramp_m": range_m}
    placed = status == "ok" and pose
    measured = {"lateral_deviation_m": 3.0 - offset_m, "distance_to_ramp_m": range_m, "heading_error_deg": 0.0}
    seen = {"ok": ("left", "right"), "one line": ("left",), "not seen": ()}[status]
    line = {"points_px": [], "confidence": [0.5, 0.7, 0.9], "pixel_line": {"inliers": [True, True, False]}}
    errors = {
        "guidance": {"lateral_deviation_m": -offset_m if placed else None},
        "lateral_error_at_ramp_m": {"left": abs(offset_m) if placed else None},
        "direction_error_deg": {"centre": 0.0 if placed else None},
    }
    return {
        "file": file,
        "time_s": round(START_S + range_m / 65.0, 6),
        "status": status,
        "seen": {"ok": "both lines", "one line": "one line"}.get(status, "none"),
        "mode": "coarse" if pose else "none",
        "reason": "" if pose else "no pose",
        "reasons": [] if pose else ["no pose"],
        "lines": {side: line if side in seen else {} for side in ("left", "right")},
        "guidance": {name: {"value": value, "sigma": 0.4} if placed else None for name, value in measured.items()},
        "truth": {"has_runway": True, **true} if truth else None,
        "errors": errors if truth else None,
        "seconds": {"dehaze": 0.1, "detect": 0.05, "localize": 0.01, "guide": 0.001},
    }


def report(records, pictures=None, **info):
    counts = {}
    for one in records:
        kind = "skipped" if "skipped" in one else one["status"]
        counts[kind] = counts.get(kind, 0) + 1
    return report_html(INFO | info, records, pictures or {}, counts)


def embedded(html):
    """The data behind plots and slider."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)[1])


class Tags(HTMLParser):
    """Elements, addresses and visible text of a page."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.addresses, self.texts = [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]

    def handle_data(self, data):
        self.texts.append(data)


def cards(html):
    """Figure and detail of each card by its label."""
    found = re.findall(r'<p class="label">(.*?)</p><p class="figure">(.*?)</p><p class="detail">(.*?)</p>', html)
    return {label: (figure, detail) for label, figure, detail in found}


FLAG = [{"name": "deck sign", "reason": "above the camera"}]
OFFSETS_M = (0.1, -0.2, 0.3, -0.4, 1.0)
EMPTY = record(status="one line") | {"truth": {"has_runway": False}, "errors": None}


def test_the_tables_are_those_of_the_errors_put_in():
    near = [record(offset_m, 150.0) for offset_m in OFFSETS_M]
    records = [*near, record(range_m=900.0, status="not seen"), EMPTY]
    rows = {name: values for name, *values in error_rows(records)}
    # A centre line measured too far right makes the aircraft seem too far left.
    assert rows == {
        "Lateral deviation": ["5", "0.30 m", "0.88 m", "−0.16 m", "80.0 %", "80.0 %"],
        "Left line, sideways at the ramp": ["5", "0.30 m", "0.88 m", "–", "–", "–"],
        "Centre line, direction": ["5", "0.00°", "0.00°", "–", "–", "–"],
    }
    assert band_rows(records) == [
        ("100 to 200 m", "5", "100 %", "0.30 m", "0.88 m", "–", "–"),
        ("800 m and more", "1", "0 %", "–", "–", "–", "–"),
    ]
    assert (found_rate(records), false_lines(records)) == (5 / 6, (1, 1))


def test_no_truth_no_errors():
    records = [record(truth=False)]
    assert (error_rows(records), band_rows(records), found_rate(records)) == ([], [], None)
    assert "Against truth" not in Tags(report(records)).texts


def test_the_cards_of_a_run():
    flagged = record(-0.25) | {"flags": FLAG}
    html = report([record(0.25), flagged, record(status="not seen"), SKIPPED, EMPTY], frames="5 of 9, stopped")
    assert cards(html) == {
        "Frames": ("5", "5 of 9, stopped; 1 skipped"),
        "Both lines found": ("66.7 %", "of the frames that truly show a runway"),
        "Lateral error, median": ("0.25 m", "95 %: 0.25 m"),
        "Direction error, median": ("0.00°", "95 %: 0.00°"),
        "Flagged frames": ("1", ""),
        "False lines": ("1", "in 1 frames without a runway"),
        "Time per frame": ("161 ms", "dehaze 100, detect 50, localize 10, guide 1.0"),
    }
    words = Tags(html).texts
    assert words[words.index("deck sign: at first above the camera") + 1] == "1"
    assert [row.get("flags") for row in embedded(html)["rows"]] == [[], ["above the camera"], [], None, []]


@pytest.mark.parametrize(
    ("name", "figure", "detail"),
    [
        ("visibility_m", "900 m", "median of 3 frames, 1 sigma 80.0 m"),
        ("visibility_heights", "–", "--camera-height-m"),
    ],
)
def test_the_visibility_is_in_metres_or_names_what_to_state(name, figure, detail):
    found = [record() | {name: {"value": value, "sigma": 80.0}} for value in (800.0, 900.0, 1000.0)]
    in_the_film = report_html(INFO, [record()], {}, {"ok": 1}, found)
    for html in (report([*found, record()]), in_the_film):
        assert cards(html)["Visibility"][0] == figure
        assert detail in cards(html)["Visibility"][1]
    assert "Visibility" not in cards(report([record()]))


def test_reasons_are_counted():
    assert count_reasons([record(pose=False), record(pose=False), record()]) == [("no pose", 2)]


def test_every_status_has_its_colours_of_every_view():
    html = report([record(), SKIPPED])
    assert embedded(html)["statuses"] == [*map(str, Status), "skipped"]
    for word, colours in STATUS_COLOURS.items():
        fill, ink = colours.css
        assert f".{word.replace(' ', '-')} {{ --key: {fill}; --on-key: {ink}; }}" in html


@pytest.mark.parametrize(
    ("value", "unit", "sign", "text"),
    [
        (0.123, "m", False, "0.12 m"),
        (-12.34, "m", True, "−12.3 m"),
        (0.5, "°", True, "+0.50°"),
        (-0.001, "m", True, "0.00 m"),
        (345.6, "m", False, "346 m"),
        (None, "m", False, "–"),
    ],
)
def test_numbers_as_people_read_them(value, unit, sign, text):
    assert number(value, unit, sign) == text
    assert [percent(share) for share in (0.0, 1.0, 0.125, None)] == ["0 %", "100 %", "12.5 %", "–"]


def test_data_behind_the_plots():
    data = embedded(report([record(0.5), SKIPPED], {0: (JPEG, JPEG + b"2")}))
    (picture,), rows = data["pictures"], data["rows"]
    assert [base64.b64decode(picture[name]) for name in ("hazy", "marked")] == [JPEG, JPEG + b"2"]
    assert data["titles"] == GUIDANCE
    assert rows[0]["guidance"]["lateral_deviation_m"]["value"] == pytest.approx(2.5)
    assert rows[0]["truth"]["lateral_deviation_m"] == pytest.approx(3.0)
    assert rows[0]["errors"]["lateral_deviation_m"] == pytest.approx(-0.5)
    assert rows[0]["left"] == {"points": 3, "used": 2, "confidence": pytest.approx(0.7)}
    assert rows[0]["time_s"] == 1_700_000_003.076923
    assert rows[0]["seconds"] == pytest.approx(0.161)
    assert rows[1] == {"file": "b.png", "skipped": True}


def test_nothing_comes_from_outside():
    html = report([record()], {0: (JPEG, JPEG)})
    page = Tags(html)
    assert page.addresses == []
    assert not {"link", "iframe", "object", "embed"} & set(page.tags)
    assert "default-src 'none'" in html
    assert "@import" not in html and "url(" not in html and "fetch(" not in html


@settings(max_examples=8)
@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=30))
def test_texts_from_outside_stay_texts(text):
    plain = Tags(report([record(), skipped_record(BadFrame("b", "c"))], source="plain", **{"note 1": "n"}))
    text = f"{text}</script><img src=x>$heading"
    records = [record(file=text) | {"reason": "", "reasons": []}, skipped_record(BadFrame(text, text))]
    html = report(records, source=text, **{"note 1": text})
    page = Tags(html)
    assert page.tags == plain.tags
    assert page.addresses == []
    assert embedded(html)["rows"][0]["file"] == text
    assert page.texts.count(text) >= 4  # source, note twice, and the skipped frame's file or reason


def test_thinned_records_and_long_lists_say_so_and_an_empty_run_too():
    assert "2 of 5000 frames" in report_html(INFO, [record(), record()], {}, {"ok": 5000})
    records = [skipped_record(BadFrame(f"{k}.png", "cut")) for k in range(45)]
    page = report_html(INFO, records, {}, {"skipped": 70}).split("application/json")[0]
    assert "39.png" in page
    assert "40.png" not in page
    assert "30 more are not listed" in page
    assert "no frames" in report_html({}, [], {}, {})


@pytest.fixture
def draw(tmp_path):
    """What a browser makes of a page."""

    def dump(html):
        page = tmp_path / "report.html"
        page.write_text(html, encoding="utf-8")
        options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
        command = [CHROMIUM, *options, "--dump-dom", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        drawn = done.stdout.split("<script")[0]
        assert "NaN" not in drawn and "undefined" not in drawn
        return drawn

    if CHROMIUM is None:
        pytest.skip("Chromium is not installed")
    return dump


@pytest.mark.parametrize(("pose", "plots"), [(True, 5), (False, 2)])
def test_a_browser_draws_it(draw, pose, plots):
    records = [record(0.1 * k, 300.0 - 20 * k, pose=pose) for k in range(10)]
    drawn = draw(report(records, {0: (JPEG, JPEG), 5: (JPEG, JPEG)}))
    assert drawn.count("<svg") == plots
    assert drawn.count('class="line') >= plots
    assert "picture 2 of 2" in drawn
    assert "· 1700000003.076923 s ·" in drawn and ">1700000" not in drawn  # the axis begins at the first frame
    assert ("2.5 m right of the centre line" in drawn) == pose
    assert ("No deviation (no pose)" in drawn) == (not pose)


def picture_records(in_widths=True, count=10, **changes):
    results = (picture_result(in_widths, range_m=150.0 - 6.0 * k, index=k) for k in range(count))
    return [frame_record(result, STILL.approach) | changes for result in results]


def test_lengths_in_widths_have_their_tables_and_cards_and_their_own_mode():
    html = report(picture_records())
    assert "Lateral deviation, runway widths" in html and "Height above deck, runway widths" in html
    assert cards(html)["Lateral error, median"][0].endswith(" widths")
    assert "could be placed relative to the deck" not in html
    assert {row["mode"] for row in embedded(html)["rows"]} == {"width"}
    assert band_rows(picture_records())[0][3].endswith(" widths")
    blind = report(picture_records(truth=None, errors=None))
    assert cards(blind)["Lateral deviation, 1 sigma"][0].endswith(" widths")
    metres = report(picture_records(in_widths=False))
    assert "runway widths</th>" not in metres and cards(metres)["Lateral error, median"][0].endswith(" m")


def test_a_browser_plots_widths_where_metres_are_not_known(draw):
    drawn = draw(report(picture_records(truth=None, errors=None), {5: (JPEG, JPEG)}))
    assert "Height above deck, runway widths" in drawn and "0.19 runway widths right of the centre line" in drawn
