"""Fixtures that trainings and the commands built on them share."""

import pytest

from deckline.detect.search import Search
from deckline_lab.train.curves import Curves


@pytest.fixture(autouse=True, scope="module")
def no_curves():
    """No picture of the losses is drawn, which takes longer than a training of a few steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Curves, "draw", lambda self: self.out)
        yield


@pytest.fixture
def no_tiles(monkeypatch):
    """Pictures are searched whole: a network of a few steps finds nothing, so that every tile would be searched."""
    monkeypatch.setattr(Search, "_search_tiles", lambda self, tilings=None: iter(()))
