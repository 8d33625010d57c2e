"""Figures without a clear picture: against a closed form and a direct search, and what makes a picture worse."""

import numpy as np
import pytest
from level_deck import CAMERA, LEFT, RIGHT, frame_at

from deckline_lab.evaluation.no_reference import (
    BLOCK_PX,
    WORSE,
    no_reference_figures,
    no_reference_table,
    summarise_no_reference,
    visible_edges,
    visible_range_m,
)
from deckline_sim.visible_line import VisibleLine, find_visible_line


def step(left: int, right: int, shape: tuple[int, int] = (32, 48)) -> np.ndarray:
    """Two grey halves (H, W, 3)."""
    image = np.full((*shape, 3), left, np.uint8)
    image[:, shape[1] // 2 :] = right
    return image


def search_edges(grey: np.ndarray) -> np.ndarray:
    """The same by trying every threshold in every window."""
    height, width = grey.shape
    levels = np.maximum(grey, 1).astype(float)
    neighbours = [((v, u), (v + 1, u)) for v in range(height - 1) for u in range(width)]
    neighbours += [((v, u), (v, u + 1)) for v in range(height) for u in range(width - 1)]
    mask = np.zeros(grey.shape, bool)
    for top in range(-BLOCK_PX, height, BLOCK_PX):
        for left in range(-BLOCK_PX, width, BLOCK_PX):
            inside = [
                pair for pair in neighbours
                if 0 <= pair[0][0] - top < 2 * BLOCK_PX and 0 <= pair[0][1] - left < 2 * BLOCK_PX
            ]  # fmt: skip
            best, border = 0.0, []
            for s in range(1, 256):
                parted = [p for p in inside if min(levels[p[0]], levels[p[1]]) <= s < max(levels[p[0]], levels[p[1]])]
                ends = [sorted((levels[a], levels[b])) for a, b in parted]
                contrast = np.mean([min((s - a) / s, (b - s) / b) for a, b in ends]) if ends else 0.0
                if contrast > best + 1e-12:
                    best, border = contrast, parted
            if 2 * best > 0.05:
                for pair in border:
                    mask[pair[0]] = mask[pair[1]] = True
    return mask


@pytest.mark.parametrize("spread", [9, 12, 60])
def test_edges_are_those_of_a_direct_search(spread: int) -> None:
    grey = np.random.default_rng(spread).integers(100, 100 + spread, (13, 18)).astype(np.uint8)
    grey[:, 9:] += 15
    grey[0, 0] = 0
    found = visible_edges(grey)
    np.testing.assert_array_equal(found, search_edges(grey))
    assert found.any()


def test_a_step_is_visible_above_five_percent_of_contrast() -> None:
    """Two levels a < b have contrast 2 (1 - sqrt(a / b)) at the threshold sqrt(a b): 5 % at a / b = 0.951."""
    for low, seen in ((188, True), (192, False)):
        edges = visible_edges(step(low, 200)[..., 0])
        assert edges[:, 23:25].all() == edges.any() == seen
        assert not edges[:, :23].any() and not edges[:, 25:].any()


def test_figures_of_a_picture_whose_contrast_is_doubled() -> None:
    hazy = step(150, 170)
    hazy[:, 40:] = 165  # 3 % to its neighbour: not visible, 6 % when doubled
    image = (2 * (hazy.astype(int) - 120)).clip(0, 255).astype(np.uint8)
    image[0, :] = 255
    figures = no_reference_figures(image[1:], hazy[1:])
    assert figures["new_edges"] == pytest.approx(1.0)
    assert figures["gradient_ratio"] == pytest.approx(2.0)
    assert figures["newly_saturated"] == 0.0 and figures[WORSE] == 0.0
    assert figures["dark_channel"] < no_reference_figures(hazy[1:], hazy[1:])["dark_channel"]
    assert no_reference_figures(image, hazy)["newly_saturated"] == pytest.approx(1 / 32)


def test_an_untouched_picture_is_not_worse_and_a_flat_one_has_no_edges() -> None:
    hazy = step(100, 160)
    same = no_reference_figures(hazy, hazy)
    assert (same["new_edges"], same["gradient_ratio"], same["newly_saturated"], same[WORSE]) == (0.0, 1.0, 0.0, 0.0)
    assert same["dark_channel"] == pytest.approx(np.mean([100] * 31 + [160] * 17) / 255, abs=1e-6)
    flat = step(100, 100, (5, 7))
    assert no_reference_figures(flat, flat).keys() == {"newly_saturated", "dark_channel", "raised_noise", WORSE}


@pytest.mark.parametrize(
    "image", [step(130, 130), step(110, 150), step(0, 160), step(130, 190)], ids=["edges", "weak", "black", "fog"]
)
def test_lost_edges_weak_gradients_black_and_fog_are_worse(image: np.ndarray) -> None:
    assert no_reference_figures(image, step(100, 160))[WORSE] == 1.0


def test_the_worst_picture_is_the_lowest_gain_and_the_highest_loss() -> None:
    pictures = [{"new_edges": e, "newly_saturated": s, WORSE: w} for e, s, w in ((0.1, 0.3, 1.0), (0.5, 0.0, 0.0))]
    summary = summarise_no_reference([*pictures, {"newly_saturated": 0.1, WORSE: 1.0}])
    expected = {"new_edges.median": 0.3, "new_edges.worst": 0.1}
    assert summary == pytest.approx(
        expected | {"newly_saturated.median": 0.1, "newly_saturated.worst": 0.3, WORSE: 2.0}
    )
    (row,) = no_reference_table({"net": summary}).rows
    assert row == ("net", "+30.0 (+10.0)", "- (-)", "10.00 (30.00)", "- (-)", "- (-)", "2")


def draw_deck(contrast_to_m: float) -> tuple[np.ndarray, list[VisibleLine]]:
    """A grey deck whose lines, 2 m wide, are 20 % brighter up to a range and no brighter beyond; the lines."""
    frame = frame_at(-60.0)
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = frame.world_from_camera.rotation.apply(CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        away = rays * np.where(rays[:, 2] > 0, 20.0 / rays[:, 2], np.inf)[:, None]
        painted = (np.abs(np.abs(away[:, 1]) - 10.0) < 1.0) & (np.linalg.norm(away, axis=1) < contrast_to_m)
    image = np.repeat(np.where(painted, 108, 100).astype(np.uint8)[:, None], 3, axis=1)  # sRGB: 20 % more light
    lines = [find_visible_line(frame, segment, within_visibility=False) for segment in (LEFT, RIGHT)]
    return image.reshape(CAMERA.height, CAMERA.width, 3), [line for line in lines if line is not None]


@pytest.mark.parametrize("range_m", [120.0, 160.0, 200.0])
def test_lines_are_visible_as_far_as_they_have_contrast(range_m: float) -> None:
    """The contrast is a mean along an eighth of the line's image: the paint's end may seem as much farther."""
    image, lines = draw_deck(range_m)
    assert len(lines) == 2
    assert range_m <= visible_range_m(image, image, lines) < 1.07 * range_m


def test_lines_without_contrast_are_not_visible() -> None:
    seen, lines = draw_deck(200.0)
    flat, _ = draw_deck(0.0)
    assert visible_range_m(flat, flat, lines) == 0.0
    assert visible_range_m(seen, flat, lines) == 0.0, "what the hazy picture does not hold is no line"


def test_pictures_of_two_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"32, 48.*32, 50"):
        no_reference_figures(step(1, 2), step(1, 2, (32, 50)))
