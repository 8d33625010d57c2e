"""The list of photographs without a runway, and the script that fetches them."""

import hashlib
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deckline.recording.images import read_image
from deckline_lab.labels import read_labels

SCRIPTS = Path(__file__).parents[3] / "scripts"
PACKAGES = tomllib.loads((SCRIPTS / "photographs.toml").read_text(encoding="utf-8"))["package"]
PICTURES = [picture for package in PACKAGES for picture in package["pictures"]]


def test_pictures_are_listed_once_with_their_licence_and_no_photographer_both_judges_and_teaches():
    assert len({picture["sha256"] for picture in PICTURES}) == len(PICTURES)
    assert all(picture["licence"] and picture["author"] for picture in PICTURES)
    assert not any(word in picture["licence"].split("-") for picture in PICTURES for word in ("NC", "ND"))
    judged = [picture for picture in PICTURES if picture["use"] == "judge"]
    assert len(judged) >= 300 and {picture["kind"] for picture in judged} == {"sea", "coast", "land", "town", "sky"}
    people: dict[str, set[str]] = {"train": set(), "judge": set()}
    for picture in PICTURES:
        if "contributors" not in picture["author"] and "copyright" not in picture["author"]:
            people[picture["use"]].add(picture["author"].lower())
    assert not people["train"] & people["judge"]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> dict:
    """The script; each package unpacks to one picture of 3000 x 60 px."""
    names = runpy.run_path(str(SCRIPTS / "fetch_photographs.py"))

    def unpack(command: list[str]) -> None:
        if command[0] == "dpkg-deb":
            Path(command[-1]).mkdir()
            Image.fromarray(np.full((60, 3000, 3), 90, np.uint8)).save(Path(command[-1]) / "a.png")

    monkeypatch.setitem(names["fetch_package"].__globals__, "run", unpack)
    return names


def make_package(sha256: str) -> dict:
    picture = {"use": "judge", "kind": "sea", "licence": "CC0", "author": "A", "file": "a.png", "sha256": sha256}
    return {"name": "p", "version": "1", "url": "http://p", "sha256": "0", "pictures": [picture]}


def test_pictures_are_reduced_and_listed_without_lines(script: dict, tmp_path: Path):
    Image.fromarray(np.full((60, 3000, 3), 90, np.uint8)).save(tmp_path / "a.png")
    package = make_package(hashlib.sha256((tmp_path / "a.png").read_bytes()).hexdigest())
    for use in ("train", "judge"):
        (tmp_path / use).mkdir()
    script["fetch_package"](package, tmp_path)
    target = script["get_target"](package["pictures"][0], tmp_path)
    assert read_image(target).shape == (51, 2560, 3)
    script["write_lists"]([package], tmp_path)
    assert read_labels(tmp_path / "judge" / "labels.json") == {target.name: {"left": None, "right": None}}
    assert f"| {target.name} | A | CC0 | p 1 | a.png |" in (tmp_path / "LICENCES.md").read_text()


def test_another_file_than_listed_is_refused(script: dict, tmp_path: Path):
    with pytest.raises(ValueError, match=r"a\.png is not the file"):
        script["fetch_package"](make_package("0" * 64), tmp_path)
