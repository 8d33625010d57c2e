"""The lock files agree with each other and with what pyproject.toml asks for."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def pins(name):
    """Version by package."""
    return dict(re.findall(r"^([\w.-]+)(?:\[.*\])?==(\S+)", (ROOT / name).read_text(), re.M))


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-flight.lock"])
def test_what_flies_has_the_versions_that_are_tested(name):
    tested = pins("requirements-dev.lock") | pins("requirements.lock")
    assert pins(name).items() <= tested.items()


def test_the_flight_lock_has_all_that_the_extra_asks_for():
    found, parts = pins("requirements-flight.lock"), Requirement(PROJECT["optional-dependencies"]["flight"][0]).extras
    asked = [*PROJECT["dependencies"], *(line for part in parts for line in PROJECT["optional-dependencies"][part])]
    assert {"mavlink", "openvino", "dashboard", "metrics", "ros"} <= parts
    for requirement in map(Requirement, asked):
        assert found[requirement.name.lower()] in requirement.specifier
    assert "torch" not in found
