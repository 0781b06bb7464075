"""Writes looks into a localizer map while a path is taught."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe
from trailmark_divs.eye import TURNING, Look
from trailmark_divs.taught_layout import (
    HEADINGS,
    LAYOUT,
    PICTURE_CLEAR,
    PICTURE_ROWS,
    PICTURE_UNITS,
    PICTURES,
    PROFILE_UNITS,
    PROFILES,
    RUNS,
    STAMPS,
    STATION_OFFSETS,
    SUMS,
    check_layout,
)

__all__ = ["KeyframeWriter"]

_BATCH = 16  # looks in a keyframe: a row of a store costs more than the sums of one look
_ROUNDING_M = 1e-6


class KeyframeWriter:
    """Writes looks into a localizer map, a few to a keyframe.

    Parameters
    ----------
    localizer_map : LocalizerMap
        Where to.
    picture_spacing_m : float
        Way between the small pictures that are kept, of looks that have one [m].
    """

    def __init__(self, localizer_map: LocalizerMap, picture_spacing_m: float = 0.1) -> None:
        self._localizer_map = localizer_map
        self._picture_spacing_m = picture_spacing_m
        self._next_picture_m = -math.inf
        self._looks: list[Look] = []
        self._pose = Pose2()
        self._first_run, self._start_rad = _last_of_map(localizer_map)

    def begin(self, document: Mapping[str, AnyArray], name: str) -> None:
        """Write the layout down, or check it against what was taught before."""
        check_layout(self._localizer_map, document, name)
        self._localizer_map.save(LAYOUT, document)

    def add(self, look: Look, pose_map_base: Pose2) -> None:
        """Remember a look; `pose_map_base` is where it was taken."""
        if not self._looks:
            self._pose = pose_map_base
        self._looks.append(look)
        if len(self._looks) >= _BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what is left."""
        if not self._looks:
            return
        looks, self._looks = self._looks, []
        station_m = looks[-1].travelled_m[1]
        sums = np.array([look.sums for look in looks])
        profiles = np.array([look.profile for look in looks]) * PROFILE_UNITS
        arrays: dict[str, AnyArray] = {
            SUMS: sums.astype(np.uint32 if sums.max() > np.iinfo(np.uint16).max else np.uint16),
            PROFILES: np.round(profiles).astype(np.uint16),
            RUNS: np.array([TURNING if look.run == TURNING else look.run + self._first_run for look in looks]),
            STATION_OFFSETS: np.array([look.travelled_m for look in looks]) - station_m,  # a path can be continued
            STAMPS: np.array([look.stamps_s for look in looks]),
            HEADINGS: np.array([look.heading_rad for look in looks]) + self._start_rad,
        } | self._pictures_of(looks)
        self._localizer_map.add(Keyframe(station_m, looks[-1].stamps_s[1], self._pose, arrays))

    def _pictures_of(self, looks: Sequence[Look]) -> dict[str, AnyArray]:
        """Return the small pictures that are kept of some looks, whose they are, and what they are worth."""
        kept = [row for row, look in enumerate(looks) if look.small.size and self._keeps_picture(look.travelled_m[1])]
        if not kept:
            return {}
        pictures = np.array([looks[row].small for row in kept]) * PICTURE_UNITS
        found: dict[str, AnyArray] = {
            PICTURES: np.round(pictures).astype(np.int8),
            PICTURE_ROWS: np.array(kept, dtype=np.int64),
        }
        if all(looks[row].clear.size for row in kept):
            found[PICTURE_CLEAR] = np.array([np.packbits(looks[row].clear) for row in kept])
        return found

    def _keeps_picture(self, travelled_m: float) -> bool:
        if travelled_m < self._next_picture_m:
            return False
        self._next_picture_m = travelled_m + self._picture_spacing_m - _ROUNDING_M
        return True


def _last_of_map(localizer_map: LocalizerMap) -> tuple[int, float]:
    """Return the first run number and heading of a teaching that goes on after what is in the localizer map."""
    keyframes = localizer_map.keyframes()
    if not keyframes:
        return 0, 0.0
    last_run = max(int(keyframe.arrays[RUNS].max()) for keyframe in keyframes)
    return last_run + 1, float(keyframes[-1].arrays[HEADINGS][-1])
