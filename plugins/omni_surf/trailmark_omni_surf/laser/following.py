"""The old place of `told_fit`, which works from here until 0.3 and warns.

What followed scans is `trailmark.estimation.scan_following` now; it takes other rules, so its names are not given here.
"""

from __future__ import annotations

from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark_omni_surf.laser import told_fit as home


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"told_fit": home.told_fit})
