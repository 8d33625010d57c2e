"""Fixtures that trainings and the commands built on them share."""

import pytest

from deckline.detect.search import Search


@pytest.fixture
def no_tiles(monkeypatch):
    """Pictures are searched whole: a network of a few steps finds nothing, so that every tile would be searched."""
    monkeypatch.setattr(Search, "_search_tiles", lambda self, tilings=None: iter(()))
