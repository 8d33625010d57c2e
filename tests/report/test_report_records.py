import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from approach_scene import HEIGHT_M, LATERAL_M, STILL, chain, frame
from deckline.config import Approach
from deckline.dehaze import DEHAZERS, DehazeResult
from deckline.flight import Flight
from deckline.recording import BadFrame
from deckline.report import records as report_records
from deckline.report.records import (
    COLUMNS,
    dehazing_record,
    keep_whole_lines,
    lookup,
    read_records,
    skipped_record,
    to_line,
    write_csv,
)
from deckline.types import Diagnostic, EdgeKind, Reason, Value
from picture_scene import LENGTHS, WIDTH_M, picture_result


def frame_record(result):
    return report_records.frame_record(result, Approach())


def test_numbers_are_those_of_the_scene_in_degrees_and_metres():
    result = chain(frame())
    record = frame_record(result)
    assert (record["status"], record["seen"], record["mode"]) == ("unverified", "both lines", "coarse")
    values = {name: entry["value"] for name, entry in record["guidance"].items() if entry is not None}
    assert values["lateral_deviation_m"] == pytest.approx(LATERAL_M, abs=1e-3)
    assert values["heading_error_deg"] == pytest.approx(math.degrees(0.02), abs=1e-3)
    assert values["height_above_deck_m"] == pytest.approx(HEIGHT_M, abs=1e-6)
    ramp = record["guidance"]["distance_to_ramp_m"]
    assert abs(ramp["value"] - 120.0) < 2 * ramp["sigma"]  # the ramp lies somewhere before the nearest row
    left = record["lines"]["left"]
    assert left["world"]["height_m"] == pytest.approx(-20.0)
    assert left["world"]["azimuth_deg"] == pytest.approx(0.0, abs=1e-3)
    assert np.shape(left["world"]["covariance"]) == (3, 3)
    assert np.allclose(left["points_px"], result.detection.left.points_px)
    assert len(left["confidence"]) == len(left["sigma_px"]) == len(left["pixel_line"]["inliers"]) == 20


def test_truth_and_errors_stand_beside_the_estimate():
    record = frame_record(chain(frame()))
    truth, errors = record["truth"], record["errors"]
    assert truth["lateral_deviation_m"] == pytest.approx(LATERAL_M)
    assert truth["range_to_ramp_m"] == pytest.approx(math.hypot(120.0, LATERAL_M))
    assert truth["visibility_m"] is None
    assert truth["clear_air"] is True
    assert set(errors["direction_error_deg"]) == {"left", "right", "centre"}
    assert errors["lateral_error_at_ramp_m"]["centre"] == pytest.approx(0.0, abs=1e-3)
    measured = {name: record["guidance"][name]["value"] for name in ("distance_to_ramp_m", "vertical_deviation_m")}
    above_slope_m = HEIGHT_M - (120.0 + 70.0) * math.tan(math.radians(3.5))
    assert truth["vertical_deviation_m"] == pytest.approx(above_slope_m)
    assert truth["lateral_deviation_deg"] == pytest.approx(math.degrees(math.atan2(LATERAL_M, 190.0)))
    assert errors["guidance"]["distance_to_ramp_m"] == pytest.approx(measured["distance_to_ramp_m"] - 120.0)
    assert errors["guidance"]["vertical_deviation_m"] == pytest.approx(measured["vertical_deviation_m"] - above_slope_m)


def test_the_kind_of_edge_and_the_number_of_joined_frames_are_written(tmp_path):
    result = chain(frame())
    known = replace(result, detection=replace(result.detection, edge=EdgeKind.PAVEMENT, frames=8))
    records = [frame_record(result), frame_record(known)]
    assert [(record["edge"], record["frames_joined"]) for record in records] == [(None, 1), ("pavement", 8)]
    assert [row["frames_joined"] for row in read_table(tmp_path / "table.csv", records)] == ["1", "8"]


def test_times_keep_their_microseconds_in_record_and_table(tmp_path):
    times = [1_700_000_000.123456, 1_700_000_000.123457]
    records = [frame_record(chain(replace(frame(), time_s=time_s))) for time_s in times]
    assert [record["time_s"] for record in records] == times
    rows = read_table(tmp_path / "guidance.csv", map(json.loads, map(to_line, records)))
    assert [row["time_s"] for row in rows] == ["1700000000.123456", "1700000000.123457"]


def test_what_does_not_exist_is_null_and_never_zero():
    record = frame_record(chain(frame(pose=False)))
    assert record["mode"] == "none"
    assert str(Reason.NO_POSE) in record["reasons"]
    assert set(record["guidance"].values()) == {None}
    assert record["truth"] is None
    assert record["errors"] is None
    unseen = frame_record(chain(frame(), sides=()))
    assert unseen["status"] == "not seen"
    assert unseen["lines"]["left"]["points_px"] == []
    assert unseen["lines"]["left"]["world"] is None
    assert unseen["errors"]["direction_error_deg"] == {"left": None, "right": None, "centre": None}
    deckless = frame_record(chain(frame(runway=False), sides=()))
    assert (deckless["truth"]["has_runway"], deckless["truth"]["range_to_ramp_m"]) == (False, None)
    assert deckless["errors"] is None


@pytest.mark.parametrize("sides", [(), ("left",), ("left", "right")])
def test_a_line_is_strict_json_and_comes_back_equal(sides, tmp_path):
    records = [frame_record(chain(frame(), sides)), skipped_record(BadFrame('odd "name"\n.png', "cut short"))]
    path = tmp_path / "guidance.jsonl"
    path.write_text("".join(map(to_line, records)), encoding="utf-8")
    assert len(path.read_text(encoding="utf-8").splitlines()) == 2
    assert list(read_records(path)) == records


def test_a_number_that_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="JSON"):
        to_line({"file": "a", "time_s": math.nan})


@given(cut=st.integers(min_value=0, max_value=400), most=st.none() | st.integers(0, 12))
def test_a_file_cut_anywhere_keeps_exactly_its_whole_lines(cut, most, tmp_path_factory):
    lines = [to_line({"file": f"{i}.png", "skipped": "x" * i}).encode() for i in range(10)]
    whole = b"".join(lines)
    path = tmp_path_factory.mktemp("cut") / "guidance.jsonl"
    path.write_bytes(whole[:cut])
    expected = sum(len(b"".join(lines[: i + 1])) <= cut for i in range(10 if most is None else min(most, 10)))
    assert keep_whole_lines(path, most) == expected
    assert path.read_bytes() == b"".join(lines[:expected])


def test_the_table_has_a_row_a_frame_and_empty_cells_for_what_is_missing(tmp_path):
    records = [frame_record(chain(frame())), skipped_record(BadFrame("b.png", "cut short"))]
    good, bad = read_table(tmp_path / "guidance.csv", records)
    assert float(good["lateral_deviation_m"]) == records[0]["guidance"]["lateral_deviation_m"]["value"]
    assert float(good["lateral_deviation_sigma_m"]) > 0
    ends = [float(good[f"right_{axis}_px"]) for axis in ("u0", "v0", "u1", "v1")]
    assert ends == np.ravel(records[0]["lines"]["right"]["pixel_line"]["ends_px"]).tolist()
    assert float(good["left_y_m"]) == pytest.approx(-8.0, abs=1e-3)
    assert float(good["centre_direction_error_deg"]) == records[0]["errors"]["direction_error_deg"]["centre"]
    assert bad["skipped"] == "cut short"
    assert {value for name, value in bad.items() if name not in ("file", "skipped")} == {""}


def read_table(path, records):
    """The rows of guidance.csv made of the records."""
    write_csv(path, records)
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def tracked(blind=()):
    """Results of four frames 15 m apart, followed; frames whose number is in `blind` show nothing."""
    frames = [frame(index, 150.0 - 15.0 * index) for index in range(4)]
    sides = [() if at.file in blind else ("left", "right") for at in frames]
    detections = iter([chain(*pair).detection for pair in zip(frames, sides, strict=True)])
    flight = Flight(STILL, DEHAZERS["none"](), lambda picture, box: next(detections))
    return [flight(at) for at in frames]


def test_every_column_is_found_in_a_whole_record():
    result = tracked()[-1]
    dehazed = DehazeResult(result.frame.image_rgb, visibility_m=Value(900.0, 80.0))
    record = frame_record(replace(result, dehazed=dehazed, seconds={**result.seconds, "dehaze": 0.1}))
    records = record, frame_record(picture_result())
    empty = [name for name, keys in COLUMNS.items() if all(lookup(one, keys) is None for one in records)]
    assert sorted(empty) == ["edge", "skipped"]  # these detections do not state what the edge is


VALUE = {"value": 900.0, "sigma": 80.0}


@pytest.mark.parametrize(
    ("dehazed", "written"),
    [
        ({}, (None, None, None)),
        ({"visibility_m": Value(900.0, 80.0)}, (None, VALUE, None)),
        ({"visibility_heights": Value(900.0, 80.0)}, (None, None, VALUE)),
        ({"note": "not dehazed: no haze"}, ("not dehazed: no haze", None, None)),
    ],
)
def test_what_the_chain_dehazes_is_written(dehazed, written):
    keys = ("not_dehazed", "visibility_m", "visibility_heights")
    assert set(dehazing_record(None)) == set(keys) and set(dehazing_record(None).values()) == {None}
    result = chain(frame())
    record = frame_record(replace(result, dehazed=DehazeResult(result.frame.image_rgb, **dehazed)))
    assert tuple(record[key] for key in keys) == written


def test_a_track_stands_in_the_record_with_its_bounds_rates_and_flags(tmp_path):
    result = tracked(blind=("frame_003.png",))[-1]
    flag = Diagnostic(Reason.HEIGHT, "2 m off")
    result = replace(result, track=replace(result.track, flags=(flag,)))
    record = frame_record(result)
    assert (record["status"], record["seen"]) == ("coasting", "none")
    assert record["track"]["state"] == "coasting"
    assert record["track"]["flags"] == [{"name": "height", "reason": "2 m off"}]
    assert record["track"]["lines"]["centre"]["height_m"] == pytest.approx(-20.0, abs=0.2)
    assert record["protection"]["lateral_m"] == pytest.approx(result.guidance.protection.lateral_m)
    assert record["guidance"]["height_rate_m_s"]["value"] == pytest.approx(0.0, abs=0.5)
    assert record["guidance"]["closing_m_s"]["value"] == pytest.approx(60.0, abs=5.0)
    (row,) = read_table(tmp_path / "guidance.csv", [record])
    assert (row["track_state"], row["track_flags"], row["track_excluded"]) == ("coasting", "height", "")
    assert float(row["height_rate_sigma_m_s"]) > 0


def test_a_way_that_ends_early_leads_to_nothing():
    record = {"flags": [{"name": "x"}], "status": 7}
    assert report_records.lookup(record, ("flags", 0, "name")) == "x"
    for way in (("flags", 1), ("flags", "name"), ("status", "name"), ("none", 0)):
        assert report_records.lookup(record, way) is None


def test_a_pose_of_the_picture_gives_widths_and_their_errors_and_no_metres():
    record = frame_record(picture_result())
    assert record["pose_source"] == "picture"
    values = record["guidance"]
    assert values["lateral_deviation_widths"]["value"] == pytest.approx(LATERAL_M / WIDTH_M, abs=1e-3)
    assert values["height_above_deck_widths"]["value"] == pytest.approx(HEIGHT_M / WIDTH_M, abs=1e-3)
    assert values["height_above_deck_widths"]["sigma"] > 0
    assert all(values[f"{name}_m"] is None for name in LENGTHS)
    assert record["truth"]["distance_to_ramp_widths"] == pytest.approx(120.0 / WIDTH_M)
    assert record["truth"]["range_to_ramp_m"] == pytest.approx(math.hypot(120.0, LATERAL_M))
    errors = record["errors"]
    measured = values["distance_to_ramp_widths"]["value"]
    assert errors["guidance"]["distance_to_ramp_widths"] == pytest.approx(measured - 120.0 / WIDTH_M)
    assert errors["guidance"]["lateral_deviation_m"] is None
    assert errors["guidance"]["heading_error_deg"] == pytest.approx(0.0, abs=1e-3)
    assert set(errors["lateral_error_at_ramp_m"].values()) == {None}  # its lines lie in the runway's own frame
    assert (record["lines"]["left"]["world"], record["lines"]["centre"]["world"], record["ramp"]) == (None, None, None)
    assert set(record["track"]["lines"].values()) == {None}


def test_a_pose_of_the_picture_with_a_stated_width_has_metres_and_errors_of_its_values_alone():
    record = frame_record(picture_result(in_widths=False))
    assert record["errors"]["guidance"]["lateral_deviation_m"] == pytest.approx(0.0, abs=1e-3)
    assert record["guidance"]["lateral_deviation_widths"] is None
    assert set(record["errors"]["direction_error_deg"].values()) == {None}
    assert record["lines"]["left"]["world"]["point_m"][1] == pytest.approx(-8.0, abs=1e-2)


def test_a_pose_of_the_picture_is_never_the_true_pose():
    result = picture_result(in_widths=False)
    blind = replace(result, frame=replace(result.frame, truth=replace(result.frame.truth, world_from_body=None)))
    record = frame_record(blind)
    assert blind.frame.true_world_from_camera is None
    assert record["truth"]["range_to_ramp_m"] is None and record["truth"]["lateral_deviation_m"] is None
    assert set(record["errors"]["guidance"].values()) == {None}
