"""The manifests' commands run: each is one command line of the present options, with the settings that its file stores.

A word in capitals stands for something that the entry's note names; every other recording is a path.
"""

import json
import re
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from deckline.cli.main import main
from deckline.config import Engine
from deckline.runtime import ShippedModel, load_session, shipped_models, shipped_weights
from deckline.runtime.weights import WEIGHTS
from deckline_lab.cli import train_dehaze, train_detect
from deckline_lab.rivals import LAB_WEIGHTS

QUANTIZED = {"hybrid-int8": "hybrid"}  # no training: made from another model's file
MODELS = [
    (folder, model)
    for folder in (WEIGHTS, LAB_WEIGHTS)
    for model in shipped_models(folder).values()
    if model.name not in QUANTIZED
]
COARSE = {"network", "size", "unshuffle"}  # is network = "coarse-t" since
SHAPE = {"head", "grid", "channels", "fc_hidden", "pretrained", "frozen_blocks"}  # is network = "ufld" and its shape
FORMER = {  # what a file stores by a name that no present setting has
    "coarse-t": COARSE,
    "paper-scene": COARSE,
    "ufld": {"losses.similarity", *(f"network.{name}" for name in SHAPE)},
}
ROOT = Path(__file__).parents[3]
PLACEHOLDER, PATH = r"[A-Z]+", r"[\w.-]+(/[\w.-]+)+"


@pytest.fixture(params=MODELS, ids=lambda item: item[1].name)
def shipped(request: pytest.FixtureRequest) -> tuple[Path, ShippedModel]:
    return request.param


def read_command(command: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, list[str]]:
    """The recipe and the recordings of a training's command line, which begins no training."""
    given: list[Any] = []
    for module, name in ((train_dehaze, "train_dehaze"), (train_detect, "train_detect")):
        monkeypatch.setattr(module, name, lambda *args: given.extend(args))
    program, *words = shlex.split(command)
    assert (program, main(words)) == ("deckline", 0)
    return given[0], [str(path) for path in given[1]]


def flatten(settings: dict[str, Any], depth: int = 2) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in settings.items():
        inner = flatten(value, depth - 1) if isinstance(value, dict) and depth > 1 else None
        flat |= {key: value} if inner is None else {f"{key}.{name}": item for name, item in inner.items()}
    return flat


def test_it_parses_with_the_settings_that_its_file_stores(
    shipped: tuple[Path, ShippedModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, model = shipped
    recipe, _ = read_command(model.command, monkeypatch)
    stored = flatten(load_session(shipped_weights(model.name, folder), Engine(threads=1)).config["recipe"])
    present = flatten(json.loads(json.dumps(asdict(recipe))))
    missing = object()
    assert {key for key, value in stored.items() if present.get(key, missing) != value} == FORMER.get(model.name, set())
    assert recipe.network in (model.name, "coarse-t")
    assert recipe.seed == model.seed


def test_its_words_are_paths_or_explained(shipped: tuple[Path, ShippedModel], monkeypatch: pytest.MonkeyPatch) -> None:
    _, model = shipped
    _, recordings = read_command(model.command, monkeypatch)
    assert all(re.fullmatch(f"{PLACEHOLDER}|{PATH}", name) for name in recordings)
    placeholders = [word for word in shlex.split(model.command) if re.fullmatch(PLACEHOLDER, word)]
    assert all(re.search(rf"\b{word} (is|are)\b", model.note) for word in placeholders)


@pytest.mark.parametrize(("name", "source"), QUANTIZED.items())
def test_a_quantized_model_is_made_by_a_script_and_stores_what_its_source_does(name: str, source: str) -> None:
    program, script, path, *_ = shlex.split(shipped_models()[name].command)
    assert program == "python" and (ROOT / script).is_file() and ROOT / path == shipped_weights(source)
    one, other = (load_session(shipped_weights(each), Engine(threads=1)).config for each in (name, source))
    assert one == other
