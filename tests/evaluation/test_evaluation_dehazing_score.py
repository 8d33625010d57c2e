import dataclasses

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from approach_scene import STILL
from deckline.evaluation.dehazing_pairs import film_of, labelled_lines, seen_length_px, true_lines
from deckline.evaluation.dehazing_score import (
    ImageScore,
    restoration,
    score_lines,
    summarise,
    summarise_film,
    worse_lines,
)
from deckline.flight import FrameResult
from deckline.geometry import Camera, pose
from deckline.guide import guidance
from deckline.localize import localize
from deckline.types import Detection, Frame, LinePoints, Segment, Truth

CAMERA = Camera.from_fov(640, 360, np.pi / 2)
LEFT = Segment(np.array([0.0, -10.0, 0.0]), np.array([200.0, -10.0, 0.0]))
RIGHT = Segment(np.array([0.0, 10.0, 0.0]), np.array([200.0, 10.0, 0.0]))
GREY = np.full((360, 640, 3), 128, np.uint8)
FILMED = {"a": "dry and sharp", "b": "rain", "c": "rain", "d": None}


def frame_at(x_m: float = -100.0, **changes) -> Frame:
    truth = Truth(left=LEFT, right=RIGHT, visibility_m=800.0)
    frame = Frame("a.png", 0.0, GREY, CAMERA, world_from_body=pose([x_m, 0, -20], [1, 0, 0, 0]), deck_z_m=0.0)
    return dataclasses.replace(frame, **({"truth": truth} | changes))


def pixels(segment: Segment, count: int = 30) -> np.ndarray:
    along = segment.p0_m + np.linspace(0.05, 0.95, count)[:, None] * (segment.p1_m - segment.p0_m)
    frame = frame_at()
    return CAMERA.project(frame.world_from_camera.inv().apply(along))


def result_of(left: np.ndarray, right: np.ndarray) -> FrameResult:
    frame = frame_at()
    points = (LinePoints(px, np.ones(len(px)), np.full(len(px), 0.3)) for px in (left, right))
    detection = Detection(*points)
    estimate = localize(frame, detection, STILL, np.random.default_rng(0))
    return FrameResult(frame, GREY, detection, estimate, guidance(frame, estimate, None, STILL.approach), {})


def score(key: str, dehazer: str, psnr_db: float, visibility_m: float = 800.0, **more) -> ImageScore:
    return ImageScore("here", key, dehazer, visibility_m, {"psnr_db": psnr_db}, **more)


def test_figures_agree_with_scikit_image():
    rng = np.random.default_rng(0)
    clear = rng.integers(40, 200, (48, 64, 3)).astype(np.uint8)
    image = np.clip(clear + rng.normal(0, 12, clear.shape), 0, 255).astype(np.uint8)
    surface = np.zeros((48, 64), dtype=bool)
    surface[30:, 10:] = True
    found = restoration(image, clear, surface)
    assert found["psnr_db"] == pytest.approx(peak_signal_noise_ratio(clear, image), abs=1e-9)
    below = peak_signal_noise_ratio(clear[30:, 10:], image[30:, 10:])
    assert found["psnr_db_surface"] == pytest.approx(below, abs=1e-9)
    options = {"channel_axis": 2, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    assert found["ssim"] == pytest.approx(structural_similarity(clear, image, **options), abs=1e-6)


def test_an_untouched_picture_counts_60_db_and_what_does_not_exist_is_left_out():
    small = np.full((8, 20, 3), 7, np.uint8)
    assert restoration(small, small, None) == {"psnr_db": 60.0}
    assert restoration(small, small, np.zeros((8, 20), dtype=bool)) == {"psnr_db": 60.0}


def test_the_part_of_a_line_inside_the_image_is_measured():
    along = np.linspace(0, 1, 1001)[:, None]
    across = np.array([-100.0, 50.0]) + along * [1000.0, 0.0]  # enters at u = 0, leaves at u = 639
    assert seen_length_px(across, CAMERA) == pytest.approx(639.0)
    assert seen_length_px(np.full((10, 2), np.nan), CAMERA) == 0.0


def test_lines_behind_the_aircraft_or_a_speck_far_away_are_not_asked_for():
    assert true_lines(frame_at()) is not None
    assert true_lines(frame_at(x_m=300.0)) is None
    assert true_lines(frame_at(x_m=-9000.0)) is None  # 20 m high: the 200 m of the line are 0.02 px tall
    assert true_lines(frame_at(truth=None)) is None
    assert true_lines(frame_at(truth=Truth(visibility_m=500.0))) is None


def test_exact_points_are_found_with_no_error_and_shifted_ones_are_off_by_the_shift():
    left, right = pixels(LEFT), pixels(RIGHT)
    lines = true_lines(frame_at())
    found, distances_px = score_lines(result_of(left, right), lines)
    assert found
    np.testing.assert_allclose(distances_px, np.zeros(60), atol=1e-9)
    slope = np.diff(left[[0, -1]], axis=0)[0]
    normal = np.array([-slope[1], slope[0]]) / np.linalg.norm(slope)
    _, distances_px = score_lines(result_of(left + 3.0 * normal, right), lines)
    np.testing.assert_allclose(distances_px, [3.0] * 30 + [0.0] * 30, atol=1e-9)
    assert score_lines(result_of(np.zeros((0, 2)), np.zeros((0, 2))), lines) == (False, [])


def test_labelled_lines_give_the_same_distances_as_true_ones():
    truth, labelled = true_lines(frame_at()), labelled_lines({"left": pixels(LEFT), "right": pixels(RIGHT)}, CAMERA)
    points = np.array([[100.0, 300.0], [320.0, 200.0]])
    for side in ("left", "right"):
        np.testing.assert_allclose(labelled[side](points), truth[side](points), atol=1e-6)
    assert labelled_lines({"left": pixels(LEFT), "right": None}, CAMERA) is None
    assert labelled_lines({"left": pixels(LEFT), "right": pixels(RIGHT) + 1000.0}, CAMERA) is None


def test_means_and_paired_differences_of_known_numbers():
    hazy = [score(str(i), "none", 10.0 + i) for i in range(4)]
    better = [score(str(i), "net", 12.5 + i, note="left" if i == 3 else "") for i in range(4)]
    summary = summarise([*better, *hazy], "none", "none")["all"]
    assert summary["none"].means == {"psnr_db": 11.5} and summary["net"].means == {"psnr_db": 14.0}
    assert summary["none"].differences == {}
    gain = summary["net"].differences["psnr_db"]
    assert (gain.value, gain.low, gain.high, gain.images) == (2.5, 2.5, 2.5, 4)
    assert summary["net"].left_alone == 1 and summary["net"].images == 4


def test_only_images_measured_both_ways_are_paired():
    scores = [score("a", "none", 10.0), score("b", "none", 20.0), score("b", "net", 21.0), score("c", "net", 50.0)]
    gain = summarise(scores, "none", "none")["all"]["net"].differences["psnr_db"]
    assert (gain.value, gain.images) == (1.0, 1)


@pytest.mark.parametrize(
    ("visibility_m", "band"),
    [
        (150.0, "150-300 m"),
        (299.9, "150-300 m"),
        (300.0, "300-500 m"),
        (1000.0, "1000-3000 m"),
        (3000.0, "3000+ m"),
        (np.inf, "3000+ m"),
        (90.0, "0-150 m"),
    ],
)
def test_an_image_is_in_one_band(visibility_m, band):
    assert list(summarise([score("a", "none", 10.0, visibility_m)], "none", "none")) == ["all", band]


def test_unknown_visibility_counts_in_all_alone_and_nothing_is_refused():
    assert list(summarise([score("a", "none", 10.0, np.nan)], "none", "none")) == ["all"]
    with pytest.raises(ValueError, match="no image"):
        summarise([], "none", "none")


def test_line_figures_pool_all_points_and_compare_medians_image_by_image():
    scores = [score(str(i), "none", 10.0, found=True, distances_px=[1.0, 1.0, 4.0]) for i in range(10)]
    scores += [score(str(i), "net", 12.0, found=i < 5, distances_px=[2.0, 2.0]) for i in range(9)]
    scores += [score("9", "net", 12.0, found=False), score("10", "net", 12.0)]
    summary = summarise(scores, "none", "none")["all"]
    assert summary["none"].lines == {"found_rate": 1.0, "point_error_px.median": 1.0, "point_error_px.p95": 4.0}
    assert summary["net"].asked == 10 and summary["net"].images == 11
    assert summary["net"].lines["found_rate"] == 0.5
    found, farther = (summary["net"].line_differences[name] for name in ("found_rate", "point_error_px"))
    assert found.value == -0.5 and -0.9 <= found.low < found.high <= -0.1 and found.images == 10
    assert (farther.value, farther.images) == (1.0, 9)  # the tenth has no points


def test_higher_psnr_with_worse_lines_is_named_and_no_other():
    names = {"none": (10.0, True, 1.0), "worse": (15.0, False, 1.0), "farther": (15.0, True, 2.0)}
    names |= {"good": (15.0, True, 1.0), "lower": (9.0, False, 1.0)}
    scores = [
        score(str(i), name, psnr, found=found, distances_px=[px])
        for name, (psnr, found, px) in names.items()
        for i in range(12)
    ]
    assert worse_lines(summarise(scores, "none", "none")["all"], "none") == ["worse", "farther"]


def test_rain_and_blur_are_summed_up_apart():
    scores = [
        *(score(key, "none", 10.0 + index, film=film) for index, (key, film) in enumerate(FILMED.items())),
        *(score(key, "net", 20.0 + 2 * index, film=film) for index, (key, film) in enumerate(FILMED.items())),
    ]
    groups = summarise_film(scores, "none", "none")
    assert list(groups) == ["dry and sharp", "rain"]
    assert groups["rain"]["net"].means["psnr_db"] == pytest.approx(23.0)
    assert groups["rain"]["net"].differences["psnr_db"].value == pytest.approx(11.5)
    assert groups["dry and sharp"]["net"].images == 1
    assert summarise_film([one for one in scores if one.film != "rain"], "none", "none") == {}


@pytest.mark.parametrize(
    ("exposure", "film"),
    [
        ({"rain_mm_h": 0.0, "lens_drops": 0, "exposure_s": 0.0}, "dry and sharp"),
        ({"rain_mm_h": 4.0, "lens_drops": 0, "exposure_s": 0.0}, "rain"),
        ({"rain_mm_h": 0.0, "lens_drops": 3, "exposure_s": 0.0}, "rain"),
        ({"rain_mm_h": 0.0, "lens_drops": 0, "exposure_s": 0.01}, "motion blur"),
        ({"rain_mm_h": 9.0, "lens_drops": 0, "exposure_s": 0.01}, "rain and motion blur"),
        ({"rain_mm_h": 9.0, "lens_drops": 0}, None),
        ({"rain_mm_h": "much", "lens_drops": 0, "exposure_s": 0.01}, None),
        ("long", None),
    ],
)
def test_rain_and_blur_are_told_from_what_truth_holds(exposure, film):
    assert film_of({"exposure": exposure}) == film
    assert film_of({}) is None
