"""A calibration in words: its numbers, what is odd about them, and how they were checked."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark_calibration.checking import STRETCH_S, Calibration, neutral_values
from trailmark_calibration.drive import TwoLocalizers
from trailmark_calibration.fitting import Fit, KnownPlacement
from trailmark_calibration.model import DELAY, TURN, TURN_PER_M, WAY, YAW, MotionPairs, X, Y

__all__ = ["WORDS", "changes_in_words", "check_in_words", "headline", "line_of", "oddities_in_words"]

#: Of each number: name, unit, factor to it, digits, and what would tell it.
WORDS: dict[int, tuple[str, str, float, int, str]] = {
    WAY: ("scale of the way", "", 1.0, 4, "drive farther"),
    TURN: ("scale of turns", "", 1.0, 4, "turn more, both ways"),
    TURN_PER_M: ("bend of a straight way", " deg/m", math.degrees(1.0), 3, "drive farther, straight on too"),
    X: ("forward", " mm", 1e3, 1, "turn more"),
    Y: ("left", " mm", 1e3, 1, "turn more"),
    YAW: ("yaw", " deg", math.degrees(1.0), 3, "drive farther, straight on too"),
    DELAY: ("delay", " ms", 1e3, 1, "begin and end more turns"),
}


def headline(what: str, two: TwoLocalizers, pairs: MotionPairs, found: Fit) -> str:
    """Return what was asked of which drive."""
    driven_s = float((pairs.to_s - pairs.from_s).sum())
    return (
        f"{what}: {two.of!r} against {two.against!r}, {driven_s:.0f} s in motion, {found.n_pairs} intervals,"
        f" {found.n_outliers} left out as outliers"
    )


def line_of(found: Calibration, index: int) -> str:
    """Return a number with its uncertainty, or what would tell it."""
    name, unit, factor, digits, advice = WORDS[index]
    value, sigma = found.fit.values[index], found.fit.sigmas[index]
    value = math.remainder(value, 2.0 * math.pi) if index == YAW else value
    value = value if abs(value * factor) >= 0.5 * 10.0**-digits else 0.0  # no "-0.0"
    if not found.fit.is_told[index]:
        if found.rival is not None and found.rival.apart[index] > 0.0:
            return (
                f"  {name:24}this drive cannot tell it: it repeats itself, and a delay that is"
                f" {found.rival.nearest_s:.2f} s off explains it as well (+- {2 * sigma * factor:.2g}{unit}): turn"
                " irregularly"
            )
        if found.drift is not None and index == DELAY:
            advice = "it does not stay the same"
        if index in found.contradictions:  # more of the same drive tells no more
            advice = f"{found.contradictions[index].parts} contradict each other"
        return f"  {name:24}this drive cannot tell it (+- {2 * sigma * factor:.2g}{unit}): {advice}"
    line = f"  {name:24}{value * factor:.{digits}f} +- {2 * sigma * factor:.{digits}f}{unit} (95 %)"
    if index in found.contradictions:
        of = found.contradictions[index]
        line += f"; {of.parts} contradict each other, they are {of.sigmas:.0f} sigmas apart"
    return line


def oddities_in_words(found: Calibration, known: KnownPlacement, name_a: str, name_b: str) -> list[str]:
    """Return words for what is no small correction."""
    values, is_told = found.fit.values, found.fit.is_told
    lines = []
    if is_told[TURN] and values[TURN] < 0.0:
        lines.append(
            f"  {name_a!r} and {name_b!r} turn opposite ways: left and right wheel are swapped (or a sign of the turn),"
            f" or the sensor of {name_b!r} hangs upside down; one drive cannot tell which"
        )
    if is_told[YAW] and math.cos(values[YAW] - known.mounting[2]) < 0.0:
        lines.append(
            f"  {name_a!r} and {name_b!r} drive opposite ways: the sensor of {name_b!r} is the other way round than the"
            f" config says, or the way of {name_a!r} counts backwards; one drive cannot tell which"
        )
    return lines


def changes_in_words(found: Calibration, asked: Sequence[int], known: KnownPlacement) -> list[str]:
    """Return words for a delay that grows, and for numbers that change nothing."""
    lines = []
    if found.drift is not None:
        lines.append(
            "  the clocks run apart (by how much this does not tell): no one delay is right for all of the drive;"
            " synchronize them"
        )
    off = found.fit.values - neutral_values(known)
    off[YAW] = math.remainder(float(off[YAW]), 2.0 * math.pi)
    is_small = np.abs(off) < 2.0 * found.fit.sigmas
    if bool((found.fit.is_told & is_small)[list(asked)].all()):
        lines.append("  nothing to correct: what the config says is within the uncertainty of every number")
    return lines


def check_in_words(found: Calibration) -> list[str]:
    """Return words for how much better the numbers of one half of the drive are on the other."""
    check = found.check
    if check is None:
        return [
            "  NOT CHECKED, each half of the drive by itself tells too little: drive once more and compare before you"
            " paste"
        ]
    (before_m, before_rad), (after_m, after_rad) = check.before, check.after
    lines = [
        f"  checked on the other half of the drive: {STRETCH_S:g} s were wrong by {1e3 * before_m:.0f} mm and"
        f" {math.degrees(before_rad):.2f} deg (median of {check.n}), with these numbers by {1e3 * after_m:.0f} mm and"
        f" {math.degrees(after_rad):.2f} deg"
    ]
    if after_m > 1.02 * before_m and after_rad > 1.02 * before_rad:
        lines.append("  the numbers are no better than those of the config: keep what you have")
    return lines
