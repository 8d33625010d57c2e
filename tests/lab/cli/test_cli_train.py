"""`deckline train`: flags over a recipe, and first weights by name."""

from pathlib import Path

import pytest

from deckline.cli.main import main
from deckline.config import Models
from deckline.detect import DETECTORS, OnnxDetector
from deckline.extras import needs_extra
from deckline.runtime import shipped_weights
from deckline_lab.cli import train_detect
from deckline_lab.cli.recipe_flags import find_weights, make_recipe
from deckline_lab.cli.train_dehaze import DehazeFlags
from deckline_lab.cli.train_detect import DetectFlags
from deckline_lab.rivals import LAB_WEIGHTS
from deckline_lab.train.dehaze import DehazeTrainConfig
from deckline_lab.train.detect import DetectTrainConfig


@pytest.mark.parametrize("network", ["dehaze", "detect"])
def test_training_without_recordings_is_one_line(network, tmp_path, capsys):
    assert main(["train", network, "--out", str(tmp_path)]) == 2
    assert "deckline: error: no " in capsys.readouterr().err


@pytest.mark.parametrize("network", ["dehaze", "detect"])
def test_help_begins_with_two_examples_and_fits_on_two_screens(network, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["train", network, "--help"])
    assert ended.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 100
    assert [line.split()[:3] for line in lines[lines.index("examples:") + 1 :][:2]] == [
        ["deckline", "train", network]
    ] * 2


def test_flags_override_the_recipe_which_overrides_the_defaults(tmp_path):
    file = tmp_path / "recipe.toml"
    file.write_text('lr = 1e-3\nminutes = "none"\nprior = true\n[haze]\nprior_share = 0.25\n')
    config = make_recipe(DehazeTrainConfig, file, DehazeFlags(lr=2e-3, steps=5))
    assert (config.lr, config.steps, config.minutes, config.prior) == (2e-3, 5, None, True)
    assert config.haze.prior_share == 0.25
    assert config.batch == DehazeTrainConfig.batch
    assert make_recipe(DetectTrainConfig, None, DetectFlags(bf16=False)).bf16 is False
    assert make_recipe(DehazeTrainConfig, Path("paper-scene"), DehazeFlags(lr=3e-3)).haze.recorded_share == 1
    file.write_text("learning_rate = 1e-3\n")
    with pytest.raises(ValueError, match=r"recipe\.toml.*learning_rate"):
        make_recipe(DetectTrainConfig, file, DetectFlags())


def test_shipped_weights_are_those_that_fly(tmp_path, monkeypatch):
    """`train detect --start-from shipped` goes on from the network that `run` uses by default."""
    given = []
    monkeypatch.setattr(train_detect, "train_detect", lambda *args: given.extend(args))
    assert main(["train", "detect", str(tmp_path), "--out", str(tmp_path), "--start-from", "shipped"]) == 0
    flying = DETECTORS[Models.detector]()
    assert isinstance(flying, OnnxDetector)
    config, first = given[0], given[3]
    assert (config.network, first) == (Models.detector, flying.session.path)


def test_first_weights_have_the_names_of_shipped_models():
    assert find_weights("ufld", "hybrid") == shipped_weights("ufld")
    assert find_weights("paper-scene", "coarse-t") == LAB_WEIGHTS / "paper-scene.onnx"
    assert find_weights("runs/first", "hybrid") == Path("runs/first")
    assert find_weights(None, "hybrid") is None
    with pytest.raises(ValueError, match="enet-sad"):
        find_weights("shipped", "enet-sad")


def test_a_missing_module_of_our_own_stays_what_it_is():
    with pytest.raises(ModuleNotFoundError, match=r"deckline\.nothing"), needs_extra("train"):
        import deckline.nothing  # noqa: F401


def test_a_recipe_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"no recipe publishd: .*published"):
        make_recipe(DehazeTrainConfig, Path("publishd"), DehazeFlags())
