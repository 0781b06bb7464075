"""What is kept of a taught path in its localizer map: the layout of the columns, and the arrays of a keyframe."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.errors import ConfigError
from trailmark.interfaces import LocalizerMap
from trailmark_divs.layout import ColumnLayout
from trailmark_divs.options import THRESHOLDS, Threshold

__all__ = [
    "HEADINGS",
    "LAYOUT",
    "PICTURES",
    "PICTURE_CLEAR",
    "PICTURE_ROWS",
    "PICTURE_UNITS",
    "PROFILES",
    "PROFILE_UNITS",
    "RUNS",
    "STAMPS",
    "STATION_OFFSETS",
    "SUMS",
    "check_layout",
    "layout_document",
]

#: Arrays of a keyframe, one row a look: column sums, brightness profiles, straight pieces of the path, ...
SUMS, PROFILES, RUNS = "sums", "profiles", "runs"
#: ... stations of both pictures less that of the keyframe [m], their stamps [s], headings [rad].
STATION_OFFSETS, STAMPS, HEADINGS = "ways", "stamps", "headings"

#: Some looks have a small picture too: these, and which looks they belong to.
PICTURES, PICTURE_ROWS = "pictures", "picture_rows"

#: Which pixels of a small picture are not over-exposed, eight to a byte; maps of earlier versions have none.
PICTURE_CLEAR = "picture_clear"

#: A profile is stored in 1/256 grey level, a small picture in a byte a pixel.
PROFILE_UNITS, PICTURE_UNITS = 256.0, 127.0

#: Name of the layout in the localizer map.
LAYOUT = "layout"

_THRESHOLD = "threshold"
# Maps that do not tell theirs were taught with what was the default then.
_UNTOLD = {_THRESHOLD: np.array([THRESHOLDS.index("otsu")])}


def layout_document(
    layout: ColumnLayout, region: tuple[float, float], lens_radius: float | None, threshold: Threshold
) -> dict[str, Any]:
    """Return what must be the same in teaching and replaying, as arrays for a localizer map."""
    return {
        "columns": np.array([layout.n_columns]),
        "region": np.array(region, dtype=np.float64),
        "lens_radius": np.array([lens_radius or 0.0]),
        _THRESHOLD: np.array([THRESHOLDS.index(threshold)]),
    }


def check_layout(localizer_map: LocalizerMap, document: Mapping[str, AnyArray], name: str) -> None:
    """Refuse to compare columns that do not show the same.

    Raises
    ------
    ConfigError
        If the path was taught with other columns, another region, mask or threshold.
    """
    stored = localizer_map.load(LAYOUT)
    if stored is None:
        return
    taught = {**_UNTOLD, **stored}
    for key, value in document.items():
        if not np.array_equal(taught[key], value):
            raise ConfigError(
                f"{name}: the path was taught with {key} {_option_as_text(key, taught[key])},"
                f" but the config says {_option_as_text(key, value)};"
                f" set {key} back, or teach the path anew"
            )


def _option_as_text(key: str, value: AnyArray) -> str:
    if key == _THRESHOLD:
        return THRESHOLDS[int(value[0])]
    return ", ".join(f"{item:g}" for item in value.tolist())
