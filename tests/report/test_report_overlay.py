from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from approach_scene import CAMERA, chain, frame
from deckline.config import Approach
from deckline.dehaze import DehazeResult
from deckline.guide import guidance
from deckline.report import draw, instrument, overlay
from deckline.report.annotators import project_centre_line
from deckline.report.status import STATUS_COLOURS
from deckline.types import (
    DepthMode,
    Diagnostic,
    Guidance,
    LineVisibility,
    Protection,
    Reason,
    RunwayEstimate,
    RunwayLine,
    Status,
    TrackState,
    Value,
)
from picture_scene import picture_result


def guide(lateral_m=0.0, height_m=20.0, distance_m=250.0, **changes) -> Guidance:
    """What the real guidance makes of such a place."""
    covariance = np.diag([0.2**2, 0.01**2, 0.1**2])
    line = RunwayLine(np.array([-distance_m, 0.0, 0.0]), 0.0, covariance)
    ramp = RunwayEstimate(LineVisibility.BOTH, DepthMode.FINE, {}, {"centre": line}, np.zeros(3), 2.0)
    at = replace(frame(), world_from_body=RigidTransform.from_translation([-distance_m, lateral_m, -height_m]))
    return replace(guidance(at, ramp, None, Approach()), **changes)


def draw_panels(result, note=""):
    """The panels of a result whose picture is shown as it is."""
    return overlay.draw_panels(result, DehazeResult(result.frame.image_rgb, note))


def has(image, colour, tolerance=12) -> bool:
    return bool(np.any(np.all(np.abs(image.astype(int) - colour) <= tolerance, axis=2)))


def test_the_needles_are_fly_to():
    assert instrument.lateral_needle(guide(lateral_m=5.0)).value == -1.0  # right of the line: the line is to the left
    assert instrument.lateral_needle(guide(lateral_m=-10.0)).value == 2.0
    assert instrument.lateral_needle(guide(lateral_m=1000.0)).value == -instrument.FULL_SCALE_DOTS
    on_slope_m = np.tan(np.deg2rad(3.5)) * (250.0 + 70.0)
    assert instrument.glideslope_needle(guide(height_m=on_slope_m)).value == pytest.approx(0.0, abs=1e-12)
    one_dot_high_m = np.tan(np.deg2rad(3.85)) * (250.0 + 70.0)
    assert instrument.glideslope_needle(guide(height_m=one_dot_high_m)).value == pytest.approx(-1.0)
    assert instrument.glideslope_needle(guide(distance_m=-65.0)) is None  # over the touchdown point


def test_the_glideslope_band_is_the_spread_of_the_needle():
    rng = np.random.default_rng(0)
    drawn = [
        instrument.glideslope_needle(guide(height_m=20 + 0.1 * a, distance_m=250 + 2.0 * b)).value
        for a, b in rng.normal(0, 1, (400, 2))
    ]
    assert np.std(drawn) == pytest.approx(instrument.glideslope_needle(guide()).sigma, rel=0.1)


def test_unknown_is_a_flag_and_never_a_needle():
    nothing = Guidance(0.0, Status.NOT_SEEN, DepthMode.NONE, diagnostics=(Diagnostic(Reason.NO_LINE, "no line"),))
    assert instrument.lateral_needle(nothing) is None
    assert instrument.glideslope_needle(nothing) is None
    left, top, side = instrument.FACE
    face = instrument.draw_instrument(nothing)[top : top + side, left : left + side]
    assert has(face, draw.FLAG)
    assert not has(face, draw.NEEDLE)
    known = instrument.draw_instrument(guide())[top : top + side, left : left + side]
    assert has(known, draw.NEEDLE)
    assert not has(known, draw.FLAG)


def test_the_protection_level_stands_beside_the_needle_while_it_is_on_the_scale():
    assert instrument.lateral_limits_dots(guide(lateral_m=2.0)) is None
    near = guide(lateral_m=2.0, protection=Protection(5.0, 1.0, 0.02, None, 1e-7))
    assert instrument.lateral_limits_dots(near) == pytest.approx((-1.4, 0.6))
    assert (
        instrument.lateral_limits_dots(guide(lateral_m=2.0, protection=Protection(30.0, 1.0, 0.02, None, 1e-7))) is None
    )


def test_a_flag_is_red_and_goes_before_the_tracks_state():
    column = slice(instrument.FACE[0] + instrument.FACE[2], None)
    tracked = instrument.draw_instrument(guide(track=TrackState.TRACKING))[144:180, column]
    flags = (Diagnostic(Reason.HEIGHT, "2 m off"),)
    flagged = instrument.draw_instrument(guide(track=TrackState.TRACKING, flags=flags))[144:180, column]
    assert not has(tracked, draw.FLAG)
    assert has(flagged, draw.FLAG)
    assert (tracked != flagged).any()


@pytest.mark.parametrize("status", Status)
def test_a_status_has_its_colours_of_every_view(status):
    tag = instrument.draw_instrument(guide(status=status))[144:180, instrument.FACE[0] + instrument.FACE[2] :]
    assert has(tag, STATUS_COLOURS[status].fill, 3)


@given(lateral=st.floats(-1e4, 1e4), height=st.floats(-50, 1e3), distance=st.floats(-500, 1e5))
def test_any_guidance_can_be_drawn(lateral, height, distance):
    band = instrument.draw_instrument(guide(lateral, height, distance))
    assert band.shape == (instrument.BAND[1], instrument.BAND[0], 3)


@pytest.mark.parametrize("size", [(320, 180), (64, 48), (101, 37), (300, 900)])
@pytest.mark.parametrize("sides", [(), ("left",), ("left", "right")])
@pytest.mark.parametrize("pose", [True, False])
def test_the_overlay_has_one_even_size_and_leaves_the_result_alone(size, sides, pose):
    image = np.full((size[1], size[0], 3), 90, dtype=np.uint8)
    result = chain(replace(frame(pose=pose), camera=CAMERA.resized(*size), image_rgb=image), sides)
    panels = overlay.draw_panels(result, DehazeResult(image // 2))
    shown = overlay.draw_overlay(result.frame, result.guidance, panels)
    assert shown.shape == (overlay.OVERLAY_PX[1], overlay.OVERLAY_PX[0], 3) and shown.dtype == np.uint8
    assert not overlay.OVERLAY_PX[0] % 2 and not overlay.OVERLAY_PX[1] % 2
    assert (image == 90).all()
    if size == (320, 180):
        assert (has(panels.marked, draw.LEFT), has(panels.marked, draw.RIGHT)) == ("left" in sides, "right" in sides)


def test_a_frame_that_is_not_dehazed_is_shown_as_it_is_with_the_reason():
    panels = draw_panels(chain(frame()), note="not dehazed: no such image")
    assert panels.not_dehazed == "not dehazed: no such image"
    far = np.s_[: panels.hazy.shape[0] // 4, -panels.hazy.shape[1] // 4 :]
    np.testing.assert_array_equal(panels.marked[far], panels.hazy[far])


@given(words=st.text(alphabet="abc xyz", max_size=60), width=st.integers(40, 300))
def test_text_is_cut_to_its_room(words, width):
    assert draw.measure_text(draw.shorten(words, 14, width), 14) <= width
    assert all(draw.measure_text(row, 14) <= width for row in draw.wrap(words, 14, width, 2))


@pytest.mark.parametrize("in_widths", [True, False])
def test_a_pose_of_the_picture_leaves_no_tile_empty_and_is_tagged(in_widths, monkeypatch):
    result, words = picture_result(in_widths), []
    monkeypatch.setattr(instrument, "draw_text", lambda image, text, *rest: words.append(text) or 10)
    monkeypatch.setattr(instrument, "draw_tag", lambda image, text, *rest: words.append(text) or 10)
    instrument.draw_instrument(result.guidance)
    assert "not known" not in words and "POSE: PICTURE" in words
    assert sum(word == " m" for word in words) == (0 if in_widths else 3)
    assert sum(word.endswith(", WIDTHS") for word in words) == (3 if in_widths else 0)
    assert ("+0.19" if in_widths else "+3.0") in words
    dot = "0.25 widths" if in_widths else "5 m"
    assert f"dot {dot}" in words and any(f"Dot: {dot}," in word for word in words)
    assert ("LOC" in words, "GS" in words) == (False, in_widths)  # no aim point in widths: its place is in metres


def test_two_dots_in_widths_are_half_a_width():
    guided = picture_result().guidance
    edge = replace(guided, in_widths=replace(guided.in_widths, lateral_deviation=Value(0.5, 0.01)))
    assert instrument.lateral_needle(edge).value == -2.0
    assert instrument.lateral_limits_dots(edge) is None


@pytest.mark.parametrize("in_widths", [True, False])
def test_the_centre_line_is_drawn_where_a_pose_from_navigation_has_it(in_widths):
    picture, flown = picture_result(in_widths), chain(frame())
    ends = [project_centre_line(one.frame, one.estimate) for one in (picture, flown)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
