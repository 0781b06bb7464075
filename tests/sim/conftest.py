"""What the tests of the simulator share."""

from __future__ import annotations

import pytest

from trailmark_sim.ground import tiles


@pytest.fixture(autouse=True)
def freshly_painted(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Every camera paints its own floor: tests compare what was painted in different ways."""
    tiles._spare.clear()
    if "lends_tiles" not in request.fixturenames:
        monkeypatch.setattr(tiles, "_keep", lambda key, store: None)


@pytest.fixture
def lends_tiles() -> None:
    """A camera leaves its tiles to the next, as in a program."""
