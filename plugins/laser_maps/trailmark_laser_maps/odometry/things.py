"""The old place of `trailmark.geometry.scans.things`; its names work until 0.3 and warn."""

from __future__ import annotations

from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark.geometry.scans import things


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {public: getattr(things, public) for public in things.__all__})
