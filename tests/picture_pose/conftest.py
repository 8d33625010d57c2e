"""Trackers of pictures with a horizon and without."""

import pytest
from runway_picture import LEVEL, Follower, with_horizon


@pytest.fixture
def follower(monkeypatch):
    return with_horizon(monkeypatch)


@pytest.fixture
def blind(monkeypatch):
    """A follower that finds no horizon."""
    return Follower(LEVEL, monkeypatch)
