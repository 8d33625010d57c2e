"""What a result was made with: the very files, each once."""

import tomllib
from pathlib import Path

from deckline.config import Models, RunConfig
from deckline.config_file import config_from_table
from deckline.detect.prior import RunwaySurvey
from deckline.flight import Flight
from deckline.report.provenance import settings_of
from deckline.runtime import sha256_of, shipped_weights


def test_a_network_is_named_by_the_one_file_that_it_runs() -> None:
    """Several shipped networks dehaze; only the one in use belongs into a report."""
    settings = settings_of(Flight.from_config(RunConfig(models=Models(dehazer="coarse-t", detector="ufld"))))
    for stage, name, model in (("dehazer", "coarse-t", "coarse-t"), ("detector", "ufld", "ufld")):
        path = shipped_weights(model)
        assert settings[stage] == f"{name} ({path.name}, SHA-256 {sha256_of(path)})"


def test_a_file_is_named_as_given_and_a_method_without_weights_by_its_name() -> None:
    given = str(Path(shipped_weights("ufld")))
    settings = settings_of(Flight.from_config(RunConfig(models=Models(dehazer="veil", detector=given))))
    assert settings["detector"] == f"{given} (SHA-256 {sha256_of(Path(given))})"
    assert settings["dehazer"] == "veil"


def test_the_configuration_is_told_as_toml_that_reads_back() -> None:
    config = RunConfig(models=Models("none", "ufld"), survey=RunwaySurvey((1.0, 2.0, -20.0), heading_deg=30.0))
    text = settings_of(Flight.from_config(config))["configuration"]
    assert config_from_table(RunConfig, tomllib.loads(text)) == config
