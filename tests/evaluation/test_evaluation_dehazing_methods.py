import numpy as np
import pytest
from hazy_recording import pictures, write_network

from deckline.evaluation.dehazing_methods import build_dehazer, by_name, model_of
from deckline.runtime import sha256_of, shipped_weights


def test_two_files_of_one_name_are_refused(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder / "net").mkdir(parents=True)
    files = [str(tmp_path / folder / "net" / "dehaze.onnx") for folder in ("a", "b")]
    assert by_name(["none", files[0], files[0]]) == {"none": "none", "net": files[0]}
    with pytest.raises(ValueError, match="would both be called net"):
        by_name(files)


def test_full_size_networks_see_the_whole_picture_and_coarse_ones_what_they_are_made_for(tmp_path):
    path = str(write_network(tmp_path / "net" / "dehaze.onnx"))
    image = pictures(0)[0]
    assert not np.array_equal(build_dehazer(path)(image), image)
    np.testing.assert_array_equal(build_dehazer(path, full_size=True)(image), image)
    shipped = str(shipped_weights("coarse-t"))
    used = build_dehazer(shipped)
    assert used.coarse
    assert build_dehazer(shipped, full_size=True).working_long_side_px == used.working_long_side_px


def test_a_model_is_its_weights_or_the_code_that_dehazes(tmp_path, monkeypatch):
    path = write_network(tmp_path / "net" / "dehaze.onnx")
    assert model_of(build_dehazer(str(path))) == f"weights {sha256_of(path)}"
    own = model_of(build_dehazer("geometry"))
    assert own == model_of(build_dehazer("dark-channel"))
    (tmp_path / "__init__.py").write_text("changed = True\n")
    monkeypatch.setattr("deckline.dehaze.__file__", str(tmp_path / "__init__.py"))
    assert model_of(build_dehazer("geometry")) != own
