import numpy as np
import pytest

from deckline.evaluation.dehazing_measure import ImageScore, LineScore
from deckline.evaluation.dehazing_rows import ROWS, SETTINGS, Rows

WITH = {"every": 1, "dehazers": {"none": "deckline 1"}}


def score(key: str, visibility_m: float, lines: LineScore | None = None, film: str | None = None) -> ImageScore:
    return ImageScore(("/a", key), "none", visibility_m, {"psnr_db": 12.345678901234, "ssim": 0.5}, "left", lines, film)


def test_what_is_written_comes_back(tmp_path):
    lines = LineScore(True, np.array([0.123456789, 1234.5678]))
    with Rows(tmp_path, WITH) as rows:
        rows.add(score("0", np.inf, lines), "0.png", 0.1)
        rows.add(score("1", np.nan, film="rain"), "1.png", 0.1)
        rows.add(score("2", 640.0, LineScore(False, np.zeros(0))), "2.png", 0.1)
    with Rows(tmp_path, WITH) as rows:
        first, second, third = rows.scores.values()
    assert list(rows.scores) == [("/a", "0", "none"), ("/a", "1", "none"), ("/a", "2", "none")]
    assert np.isinf(first.visibility_m) and np.isnan(second.visibility_m) and third.visibility_m == 640.0
    assert first.figures == {"psnr_db": 12.345678901234, "ssim": 0.5} and first.note == "left"
    np.testing.assert_allclose(first.lines.distances_px, lines.distances_px, rtol=1e-5)
    assert first.film is None and second.film == "rain"
    assert first.lines.found and second.lines is None and len(third.lines.distances_px) == 0


def test_without_a_folder_rows_are_kept_in_memory_alone():
    with Rows(None, WITH) as rows:
        rows.add(score("0", 300.0), "0.png", 0.1)
    assert list(rows.scores) == [("/a", "0", "none")]


def test_another_model_under_a_known_name_is_refused(tmp_path):
    with Rows(tmp_path, WITH):
        pass
    with Rows(tmp_path, WITH | {"dehazers": {"net": "SHA-256 1"}}):
        pass
    with pytest.raises(ValueError, match=r'another model of net: "SHA-256 1", not "SHA-256 2"'):
        Rows(tmp_path, WITH | {"dehazers": {"net": "SHA-256 2"}})


def test_folders_of_others_and_damaged_ones_are_refused(tmp_path):
    (tmp_path / ROWS).write_text("")
    with pytest.raises(ValueError, match=r"without dehazing\.settings\.json"):
        Rows(tmp_path, WITH)
    (tmp_path / SETTINGS).write_text('{"every": 1')
    with pytest.raises(ValueError, match="is damaged: choose another folder"):
        Rows(tmp_path, WITH)
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="cannot be written"):
        Rows(tmp_path / "file", WITH)
