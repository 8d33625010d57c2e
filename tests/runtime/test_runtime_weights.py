"""Shipped weights: what is listed is what is loaded."""

import hashlib
from pathlib import Path

import pytest

from deckline.runtime.weights import sha256_of, shipped_models, shipped_weights

CONTENT = b"not really a network"
ENTRY = """
[[model]]
name = "small"
file = "small.onnx"
sha256 = "{sha256}"
kind = "dehaze"
command = "deckline train dehaze"
data = "preset train, seed 1"
seed = 1
steps = 10
hardware = "2 CPU cores"
date = "2024-01-01"
[model.figures]
"psnr_db.mean" = 21.5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "small.onnx").write_bytes(CONTENT)
    (tmp_path / "manifest.toml").write_text(ENTRY.format(sha256=hashlib.sha256(CONTENT).hexdigest()))
    return tmp_path


def test_listed_model_is_found_with_its_figures(folder: Path) -> None:
    assert shipped_weights("small", folder) == folder / "small.onnx"
    model = shipped_models(folder)["small"]
    assert model.figures["psnr_db.mean"] == 21.5
    assert (model.kind, model.seed, model.steps) == ("dehaze", 1, 10)


def test_tampered_file_is_refused_in_one_line(folder: Path) -> None:
    (folder / "small.onnx").write_bytes(CONTENT + b"!")
    found = sha256_of(folder / "small.onnx")
    with pytest.raises(ValueError, match=rf"small\.onnx.*{found}.*{hashlib.sha256(CONTENT).hexdigest()}") as caught:
        shipped_weights("small", folder)
    assert "\n" not in str(caught.value)


def test_missing_file_and_unknown_name(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"'large'.*\bsmall\b"):
        shipped_weights("large", folder)
    (folder / "small.onnx").unlink()
    with pytest.raises(ValueError, match=r"small\.onnx"):
        shipped_weights("small", folder)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (None, ""),
        ("[[model]", "line 1"),
        ('[[model]]\nname = "a"\n', "'a'.*'sha256'"),
        (ENTRY.format(sha256="0") + "\n[[model]]\ncolour = 'red'\n", "'colour'"),
        (ENTRY.format(sha256="0") * 2, "'small'"),
    ],
    ids=["missing", "no TOML", "missing keys", "unknown key", "twice"],
)
def test_a_bad_manifest_is_named(tmp_path: Path, text: str | None, named: str) -> None:
    if text is not None:
        (tmp_path / "manifest.toml").write_text(text)
    with pytest.raises(ValueError, match=rf"manifest\.toml.*{named}"):
        shipped_models(tmp_path)


def test_package_ships_what_its_manifest_lists() -> None:
    models = shipped_models()
    assert set(models) == {"hybrid", "hybrid-int8", "ufld", "coarse-t"}
    for name in models:
        assert shipped_weights(name).stat().st_size > 10_000
