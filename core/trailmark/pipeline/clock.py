"""The old place of `trailmark.clock`; its names work until 0.3 and warn."""

from __future__ import annotations

from typing import Any

from trailmark import clock
from trailmark.deprecation import deprecated_name


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {public: getattr(clock, public) for public in clock.__all__})
