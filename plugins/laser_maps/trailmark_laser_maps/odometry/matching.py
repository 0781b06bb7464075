"""The old place of `trailmark.geometry.scans.local_map`; its names work until 0.3 and warn."""

from __future__ import annotations

from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark.geometry.scans import local_map


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {public: getattr(local_map, public) for public in local_map.__all__})
