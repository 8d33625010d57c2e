"""The report: figures against hand-made truth, escaping, nothing from outside, and that a browser draws it."""

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deckline.recording import BadFrame
from deckline.report.figures import (
    band_rows,
    count_reasons,
    error_rows,
    false_lines,
    found_rate,
    number,
    percent,
    stage_seconds,
)
from deckline.report.html import report_html
from deckline.report.records import GUIDANCE, skipped_record

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


def test_errors_are_those_put_in():
    offsets = [0.1, -0.2, 0.3, -0.4, 1.0]
    rows = {name: values for name, *values in error_rows([record(offset) for offset in offsets])}
    p95 = f"{np.percentile(np.abs(offsets), 95):.2f} m"
    # A centre line measured too far right makes the aircraft seem too far left.
    assert rows["Lateral deviation"] == ["5", "0.30 m", p95, "−0.16 m", "80.0 %", "80.0 %"]
    assert rows["Left line, sideways at the ramp"] == ["5", "0.30 m", p95, "–", "–", "–"]
    assert rows["Centre line, direction"] == ["5", "0.00°", "0.00°", "–", "–", "–"]


def test_no_truth_no_errors():
    records = [record(truth=False)]
    assert error_rows(records) == []
    assert band_rows(records) == []
    assert found_rate(records) is None
    assert "Against truth" not in report(records)


def test_bands_hold_the_frames_of_their_distance():
    bands = band_rows([record(0.2, 150.0), record(0.4, 120.0), record(range_m=900.0, status="not seen")])
    assert [row[:5] for row in bands] == [
        ("100 to 200 m", "2", "100 %", "0.30 m", "0.39 m"),
        ("800 m and more", "1", "0 %", "–", "–"),
    ]


def test_found_rate_counts_only_frames_with_a_runway():
    empty = record(status="one line") | {"truth": {"has_runway": False}, "errors": None}
    records = [record(), record(status="one line"), record(), record(status="not seen"), empty]
    assert found_rate(records) == 0.5
    assert false_lines(records) == (1, 1)


def test_times_and_reasons():
    records = [record(pose=False), record(pose=False), record()]
    assert stage_seconds(records) == {"dehaze": 0.1, "detect": 0.05, "localize": 0.01, "guide": 0.001}
    assert count_reasons(records) == [("no pose", 2)]


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


def test_summary_tells_counts_and_errors():
    records = [record(0.25), record(-0.25), record(status="not seen"), SKIPPED]
    text = " ".join(Tags(report(records)).texts)
    for part in ("ok", "66.7 %", "0.25 m", "1 skipped", "cut", "Against truth", INFO["command"]):
        assert part in text


def test_flags_are_told_without_a_track_too():
    html = report([record() | {"flags": [{"name": "deck sign", "reason": "above the camera"}]}, record()])
    words = Tags(html).texts
    assert words[words.index("Flagged frames") + 1] == "1"
    assert words[words.index("deck sign: at first above the camera") + 1] == "1"
    assert [row["flags"] for row in embedded(html)["rows"]] == [["above the camera"], []]


@pytest.mark.parametrize(("name", "figure"), [("visibility_m", "900 m"), ("visibility_heights", "900 heights")])
def test_the_visibility_that_dehazing_told_is_told(name, figure):
    told = [record() | {name: {"value": value, "sigma": 80.0}} for value in (800.0, 900.0, 1000.0)]
    words = Tags(report([*told, record()])).texts
    assert words[words.index("Visibility") + 1] == figure
    assert "3 frames tell it" in words[words.index("Visibility") + 2]


def test_notes_stand_above_everything():
    html = report([record()], **{"note 1": "two cameras of different size", "frames": "1 of 9, stopped"})
    assert html.index("two cameras of different size") < html.index("What guidance is worth")
    assert "1 of 9, stopped; none skipped" in html


def test_data_behind_the_plots():
    data = embedded(report([record(0.5), SKIPPED], {0: (JPEG, JPEG + b"2")}))
    (picture,), rows = data["pictures"], data["rows"]
    assert [base64.b64decode(picture[name]) for name in ("hazy", "marked")] == [JPEG, JPEG + b"2"]
    assert data["titles"] == GUIDANCE
    assert rows[0]["guidance"]["lateral_deviation_m"]["value"] == pytest.approx(2.5)
    assert rows[0]["truth"]["lateral_deviation_m"] == pytest.approx(3.0)
    assert rows[0]["errors"]["lateral_deviation_m"] == pytest.approx(-0.5)
    assert rows[0]["left"] == {"points": 3, "kept": 2, "confidence": pytest.approx(0.7)}
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


@settings(max_examples=25, deadline=None)
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


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
@pytest.mark.parametrize(("pose", "plots"), [(True, 5), (False, 2)])
def test_a_browser_draws_it(tmp_path, pose, plots):
    records = [record(0.1 * k, 300.0 - 20 * k, pose=pose) for k in range(10)]
    page = tmp_path / "report.html"
    page.write_text(report(records, {0: (JPEG, JPEG), 5: (JPEG, JPEG)}), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom"]
    done = subprocess.run([CHROMIUM, *options, page.as_uri()], capture_output=True, text=True, timeout=60, check=True)
    drawn = done.stdout.split("<script")[0]
    assert drawn.count("<svg") == plots
    assert drawn.count('class="line') >= plots
    assert "NaN" not in drawn and "undefined" not in drawn
    assert "picture 2 of 2" in drawn
    assert "· 1700000003.076923 s ·" in drawn and ">1700000" not in drawn  # the axis begins at the first frame
    assert ("2.5 m right of the centre line" in drawn) == pose
    assert ("No deviation (no pose)" in drawn) == (not pose)
