"""Checks that two localizers measure motion in one unit, and are two recordings rather than one."""

from __future__ import annotations

import math

import numpy as np

from trailmark.errors import DataError
from trailmark_calibration.model import MotionPairs
from trailmark_calibration.starting import do_turns_agree
from trailmark_calibration.tracks import ComparedTrack

__all__ = ["refuse_one_recording", "refuse_other_units"]

#: Factors from one unit to the unit of Trailmark, [rad] and [m], and what it is when a scale is that.
_TURNS = {math.radians(1.0): "degrees where radians are meant"}
_WAYS = {1e-3: "millimetres where metres are meant", 1e-2: "centimetres where metres are meant"}
#: A scale so near to one of them, as a share, is no wheel.
_NEAR = 0.25
#: What two sensors have drifted apart by after a minute at least; a copy never does, however it was rounded [m, rad].
_COPIED_M, _COPIED_RAD = 0.003, 0.002
_SAME_STAMP_S = 1e-4


def refuse_one_recording(a: ComparedTrack, b: ComparedTrack, name_a: str, name_b: str) -> None:
    """Raise where two localizers say the same at the same time: nothing can be learnt from that.

    A copy may be rounded, scaled or reversed: its way and its heading never part from those of the original.

    Raises
    ------
    DataError
        If they do.
    """
    if len(a) == len(b) and np.array_equal(a.stamp_s, b.stamp_s) and np.array_equal(a.twists, b.twists):
        raise DataError(
            f"{name_a!r} and {name_b!r} are the same recording, to the last digit: compare with a sensor that measures"
            " by itself"
        )
    if _is_copy(a, b):
        raise DataError(
            f"{name_a!r} and {name_b!r} never part, as one recording and a copy of it that was rounded, scaled or"
            " reversed: compare with a sensor that measures by itself"
        )


def _is_copy(a: ComparedTrack, b: ComparedTrack) -> bool:
    """Return whether ways and headings are the same numbers times a factor, at the same stamps."""
    if len(a) != len(b) or not np.allclose(a.stamp_s, b.stamp_s, rtol=0.0, atol=_SAME_STAMP_S):
        return False
    if not (a.measures_way and b.measures_way):
        return False
    for column, copied in ((0, _COPIED_M), (2, _COPIED_RAD)):
        first, second = np.cumsum(a.twists[:, column]), np.cumsum(b.twists[:, column])
        factor = float(first @ second) / max(float(first @ first), 1e-12)
        if float(np.std(second - factor * first)) > copied:
            return False
    return True


def refuse_other_units(pairs: MotionPairs, name_a: str, name_b: str, longest_delay_s: float) -> None:
    """Raise where the motions of one localizer are as many times those of the other as one unit is of another.

    Raises
    ------
    DataError
        If one tells degrees for radians, or millimetres for metres.
    """
    (ways_a, turns_a), (ways_b, turns_b) = (_rates(track) for track in (pairs.a, pairs.b))
    kinds = []
    if do_turns_agree(pairs.a, pairs.b, longest_delay_s):  # or they are noise, of any size
        kinds.append(("turns", turns_b / turns_a, _TURNS))
    if pairs.a.measures_way and pairs.b.measures_way and ways_a > 0.0:
        kinds.append(("ways", ways_b / ways_a, _WAYS))
    for kind, size, units in kinds:
        for factor, words in units.items():
            for name, one in ((name_a, size), (name_b, 1.0 / size if size else 0.0)):
                if abs(one / factor - 1.0) < _NEAR:
                    raise DataError(
                        f"{kind} by {name!r} are {1.0 / one:.4g} times what the other tells: it tells {words}; mend"
                        " the unit in its data or its driver, that is no calibration"
                    )


def _rates(track: ComparedTrack) -> tuple[float, float]:
    """Return a high speed and a high rate of turn of a track, whatever its delay: they do not wrap, as angles do."""
    rates = track.twists / (track.stamp_s - track.since_s)[:, None]
    return float(np.quantile(np.hypot(rates[:, 0], rates[:, 1]), 0.9)), float(np.quantile(np.abs(rates[:, 2]), 0.9))
