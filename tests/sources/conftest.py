"""Playing a source."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from trailmark.frames import Frame
from trailmark.interfaces import FrameSource, Session


@pytest.fixture
def play() -> Callable[..., list[Frame]]:
    """Start a source under a name and return its frames."""

    def played(source: FrameSource, name: str = "front") -> list[Frame]:
        source.start(Session(name=name))
        return list(source.frames())

    return played
