import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deckline.geometry import pose
from deckline.recording import RecordingError
from deckline.recording.scene_file import (
    format_entry,
    format_scene,
    get_clear_image,
    read_scene,
    truth_from_mapping,
    truth_to_mapping,
)
from deckline.types import Segment, Truth

number = st.floats(-1e9, 1e9)
segment = st.none() | st.builds(
    lambda p0, p1: Segment(np.array(p0), np.array(p1)),
    st.tuples(number, number, number),
    st.tuples(number, number, number),
)
truths = st.builds(
    Truth,
    left=segment,
    right=segment,
    visibility_m=st.none() | st.floats(1.0, math.inf),
    airlight_rgb=st.none() | st.tuples(number, number, number),
)


@given(truths)
def test_truth_round_trip(truth):
    text = json.dumps(truth_to_mapping(truth, None), allow_nan=False)
    back = truth_from_mapping(json.loads(text))
    assert (back.visibility_m, back.airlight_rgb) == (truth.visibility_m, truth.airlight_rgb)
    for side in ("left", "right"):
        before, after = getattr(truth, side), getattr(back, side)
        assert (before is None) == (after is None)
        if before is not None:
            np.testing.assert_array_equal([after.p0_m, after.p1_m], [before.p0_m, before.p1_m])


def test_poses_and_conditions_round_trip():
    rolled = pose([1.0, -2.0, 3.5], [0.5, 0.1, -0.7, 0.5])
    truth = Truth(world_from_ship=rolled, world_from_body=rolled.inv(), conditions={"air": {"rain_mm_h": 3.0}})
    back = truth_from_mapping(json.loads(json.dumps(truth_to_mapping(truth, None), allow_nan=False)))
    np.testing.assert_allclose(back.world_from_ship.as_matrix(), rolled.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(back.world_from_body.as_matrix(), rolled.inv().as_matrix(), atol=1e-12)
    assert back.conditions == {"air": {"rain_mm_h": 3.0}}
    assert truth_from_mapping({"left": None, "right": None, "visibility_m": None}).visibility_m is None


UPSIDE = {"translation_m": [0, 0, 0], "quaternion_wxyz": [0, 1, 0, 0]}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([], r"truth.*\[\]"),
        ({"left": {"p0_m": [1, 2, 3]}}, "truth.left.*p1_m"),
        ({"left": {"p0_m": [1, 2], "p1_m": [1, 2, 3]}}, r"truth.left.p0_m.*\[1, 2\]"),
        ({"visibility_m": -5}, "truth.visibility_m.*-5"),
        ({"airlight_rgb": "grey"}, "truth.airlight_rgb.*'grey'"),
        ({"conditions": []}, r"truth.conditions.*\[\]"),
        ({"centre_painted": 3}, "truth.centre_painted.*3"),
        ({"world_from_ship": {"translation_m": [0, 0, 0]}}, "truth.world_from_ship: quaternion_wxyz"),
        ({"world_from_body": UPSIDE | {"quaternion_wxyz": [0, 0, 0, 0]}}, "truth.world_from_body: quaternion"),
        ({"world_from_body": UPSIDE | {"angle": 3}}, "truth.world_from_body: .*angle"),
    ],
)
def test_bad_truth_says_what_is_wrong(values, message):
    with pytest.raises(ValueError, match=message):
        truth_from_mapping(values)


@pytest.mark.parametrize("name", ["/etc/passwd", "../a.png", "clear/../../a.png", "C:\\a.png", "..\\a.png", "", 3])
def test_clear_image_stays_inside_the_recording(name):
    with pytest.raises(ValueError, match="clear_image"):
        get_clear_image({"clear_image": name})


def test_text_is_json_with_the_promised_keys(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(
        format_scene(None, {"a.png": format_entry({"deck_z_m": -17.0}), "b.png": format_entry({})}, {"seed": 3})
    )
    assert json.loads(path.read_text()) == {
        "format": "deckline-scene",
        "version": 1,
        "seed": 3,
        "camera": None,
        "frames": {"a.png": {"deck_z_m": -17.0}, "b.png": {}},
    }
    scene = read_scene(path)
    assert (scene.camera, scene.extra) == (None, {"seed": 3})


def test_nan_never_reaches_the_file():
    with pytest.raises(RecordingError, match="JSON"):
        format_scene(None, {}, {"gust": math.nan})
    with pytest.raises(RecordingError, match="JSON"):
        format_entry({"truth": {"visibility_m": math.inf}})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "scene.json.*JSON"),
        ("[]", "deckline-scene"),
        ('{"format": "deckline-scene", "version": 2}', "version 2.* 1"),
        ('{"format": "deckline-scene", "version": 1, "frames": []}', "frames.*list"),
        ('{"format": "deckline-scene", "version": 1, "camera": {"width": 3}}', "camera: height, fx, fy, cx, cy"),
    ],
)
def test_bad_scene_file_says_what_is_wrong(tmp_path, text, message):
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_scene(path)
