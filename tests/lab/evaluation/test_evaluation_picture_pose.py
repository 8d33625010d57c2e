"""A pose of the picture is compared with truth by values, never by coordinates of its own frame."""

import pytest

from approach_scene import STILL, chain, frame
from deckline_lab.evaluation.chain import score_frame
from deckline_lab.evaluation.integrity_score import state_of
from deckline_lab.evaluation.localization_score import frame_figures
from picture_scene import LENGTHS, picture_result

METRES = [f"guidance_error.{name}_m" for name in LENGTHS]
WIDTHS = [f"guidance_error.{name}_widths" for name in LENGTHS]


@pytest.mark.parametrize(("in_widths", "names"), [(True, WIDTHS), (False, METRES)])
def test_errors_of_its_lengths_are_scored_and_world_errors_of_its_lines_are_not(in_widths, names):
    errors = score_frame(picture_result(in_widths), STILL.approach).errors
    assert {name for name in errors if name.startswith("guidance_error") and name in METRES + WIDTHS} == set(names)
    assert not [name for name in errors if name.startswith(("direction_error", "lateral_error", "height_error"))]
    flown = score_frame(chain(frame()), STILL.approach).errors
    assert any(name.startswith("lateral_error_at_ramp_m") for name in flown)


def test_table_6_has_no_line_errors_of_it_and_the_pilots_are_those_of_navigation():
    result = picture_result(in_widths=False)
    found, flown = (frame_figures(one.frame, one.estimate.lines, 70.0) for one in (result, chain(frame())))
    assert "lateral_error_m.left" in flown and "lateral_error_m.left" not in found
    assert not [name for name in found if name.startswith("unit.")]
    assert found["centre.deviation_m"] == pytest.approx(flown["centre.deviation_m"], abs=1e-9)


@pytest.mark.parametrize("in_widths", [True, False])
def test_the_integrity_of_metres_is_scored_and_of_widths_is_not(in_widths):
    state = state_of(picture_result(in_widths), False, STILL.approach)
    assert (state.lateral_m is None, state.height_m is None) == (in_widths, in_widths)
