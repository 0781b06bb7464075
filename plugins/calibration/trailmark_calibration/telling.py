"""The report of a calibration: numbers with their uncertainty, those that stay undetermined, and warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo
from trailmark_calibration.checking import STRETCH_S, Calibration, calibrate, neutral_values, told_values
from trailmark_calibration.config_lines import delay_lines, mounting_lines, odometry_lines, wheels_in_words
from trailmark_calibration.drive import Drive, TwoLocalizers
from trailmark_calibration.fitting import Fit, KnownPlacement
from trailmark_calibration.model import DELAY, NAMES, TURN, TURN_PER_M, WAY, YAW, MotionPairs, X, Y, pairs_of
from trailmark_calibration.tracks import track_of
from trailmark_calibration.units import refuse_one_recording, refuse_other_units

__all__ = ["Answer", "Question", "answer"]


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of a drive.

    Attributes
    ----------
    what : {"odometry", "mounting", "delay"}
        Which numbers.
    two : TwoLocalizers
        Who is calibrated, against whom.
    sensor : str or None
        Whose mounting; None: the only one of the localizer.
    track_m : float or None
        Distance of the wheels [m].
    interval_s, longest_delay_s : float
        Length of what is compared; no longer delay is looked for [s].
    """

    what: Literal["odometry", "mounting", "delay"]
    two: TwoLocalizers
    sensor: str | None = None
    track_m: float | None = None
    interval_s: float = 0.5
    longest_delay_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Answer:
    """What is printed.

    Attributes
    ----------
    is_told : bool
        Whether the drive tells any of the numbers.
    lines, config_lines : list of str
        For a person, and for the config.
    document : mapping
        For a program.
    """

    is_told: bool
    lines: list[str]
    config_lines: list[str]
    document: Mapping[str, Any]


#: The numbers of each question; name, unit, factor to it, digits, and what would tell them.
_ASKED = {"odometry": (WAY, TURN, TURN_PER_M), "mounting": (X, Y, YAW), "delay": (DELAY,)}
_WORDS: dict[int, tuple[str, str, float, int, str]] = {
    WAY: ("scale of the way", "", 1.0, 4, "drive farther"),
    TURN: ("scale of turns", "", 1.0, 4, "turn more, both ways"),
    TURN_PER_M: ("bend of a straight way", " deg/m", math.degrees(1.0), 3, "drive farther, straight on too"),
    X: ("forward", " mm", 1e3, 1, "turn more"),
    Y: ("left", " mm", 1e3, 1, "turn more"),
    YAW: ("yaw", " deg", math.degrees(1.0), 3, "drive farther, straight on too"),
    DELAY: ("delay", " ms", 1e3, 1, "begin and end more turns"),
}


def answer(question: Question, drive: Drive) -> Answer:
    """Return what a drive says to a question.

    Raises
    ------
    ConfigError
        If it is not clear which sensor is meant.
    DataError
        If the drive is too short, or the localizers do not move as one body.
    """
    two, is_odometry = question.two, question.what == "odometry"
    name_a, name_b = (two.of, two.against) if is_odometry else (two.against, two.of)
    sensor = _sensor(question, drive, name_b)
    mounting = np.zeros(3) if sensor is None else _in_plane(sensor)
    a = track_of(name_a, drive.said[name_a])
    b = track_of(name_b, drive.said[name_b]).seen_from(mounting)
    refuse_one_recording(a, track_of(name_b, drive.said[name_b]), name_a, name_b)
    pairs = pairs_of(a, b, question.interval_s, question.track_m)
    known, asked = KnownPlacement(mounting, question.longest_delay_s), _ASKED[question.what]
    refuse_other_units(pairs, name_a, name_b, question.longest_delay_s)
    found = calibrate(pairs, known, asked)
    is_told = bool(found.fit.is_told[list(asked)].any())
    lines = [_headline(question, pairs, found.fit), *(_line(found, index) for index in asked)]
    lines += _oddities(found, known, name_a, name_b)
    lines += _changes_in_words(found, asked, known)
    lines += _check_in_words(found) if is_told else []
    config_lines: list[str] = []
    if is_told:
        extra, config_lines = _for_the_config(
            question, drive, sensor, pairs, (found.fit, told_values(found.fit, known))
        )
        lines += extra
    return Answer(is_told, lines, config_lines, _document(question, found, config_lines))


def _sensor(question: Question, drive: Drive, localizer: str) -> SensorInfo | None:
    """Return the sensor whose place the motions of a localizer depend on; None: it has none, or only odometry."""
    sensors = {info.name: info for info in drive.sensors_of(localizer) if info.kind != "odometry"}
    if question.what != "mounting":
        return next(iter(sensors.values())) if len(sensors) == 1 else None
    if question.sensor is not None and question.sensor not in sensors:
        raise ConfigError(
            f"{localizer!r} looks at no sensor {question.sensor!r}, but at {', '.join(sensors) or 'none'}"
        )
    if question.sensor is None and len(sensors) != 1:
        names = ", ".join(sensors) or "none that is mounted (odometry is of base), or the source cannot be opened"
        raise ConfigError(
            f"which sensor of {localizer!r} is meant is not clear, it looks at {names}; --sensor names it"
        )
    return sensors[question.sensor or next(iter(sensors))]


def _in_plane(sensor: SensorInfo) -> Floats:
    pose = sensor.pose_base_sensor
    return np.array([pose.x, pose.y, pose.yaw])


def _headline(question: Question, pairs: MotionPairs, found: Fit) -> str:
    two = question.two
    driven_s = float((pairs.to_s - pairs.from_s).sum())
    return (
        f"{question.what}: {two.of!r} against {two.against!r}, {driven_s:.0f} s in motion, {found.n_pairs} intervals,"
        f" {found.n_outliers} left out as outliers"
    )


def _line(found: Calibration, index: int) -> str:
    name, unit, factor, digits, advice = _WORDS[index]
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
        return f"  {name:24}this drive cannot tell it (+- {2 * sigma * factor:.2g}{unit}): {advice}"
    line = f"  {name:24}{value * factor:.{digits}f} +- {2 * sigma * factor:.{digits}f}{unit} (95 %)"
    if index in found.contradictions:
        line += f"; the halves of the drive are {found.contradictions[index]:.0f} sigmas apart"
    return line


def _oddities(found: Calibration, known: KnownPlacement, name_a: str, name_b: str) -> list[str]:
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


def _changes_in_words(found: Calibration, asked: Sequence[int], known: KnownPlacement) -> list[str]:
    """Return words for a delay that grows, and for numbers that change nothing."""
    lines = []
    if found.drift is not None:
        lines.append(
            f"  the clocks run apart by about {abs(60e3 * found.drift.rate):.0f} ms a minute,"
            f" {1e3 * found.drift.whole_s:.0f} ms over the drive: no one delay is right for all of it; synchronize them"
        )
    off = found.fit.values - neutral_values(known)
    off[YAW] = math.remainder(float(off[YAW]), 2.0 * math.pi)
    is_small = np.abs(off) < 2.0 * found.fit.sigmas
    if bool((found.fit.is_told & is_small)[list(asked)].all()):
        lines.append("  nothing to correct: what the config says is within the uncertainty of every number")
    return lines


def _check_in_words(found: Calibration) -> list[str]:
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


def _for_the_config(
    question: Question, drive: Drive, sensor: SensorInfo | None, pairs: MotionPairs, found: tuple[Fit, Floats]
) -> tuple[list[str], list[str]]:
    """Return what else there is to say, and the lines for the config."""
    fit, numbers = found
    if question.what == "odometry":
        return wheels_in_words(pairs, numbers), odometry_lines(drive.config, question.two.of, pairs, numbers)
    if question.what == "mounting":
        assert sensor is not None
        return [], mounting_lines(drive.config, sensor, numbers, fit.is_told)
    sources = [
        {drive.source_of[info.name] for info in drive.sensors_of(name) if info.name in drive.source_of}
        for name in (question.two.of, question.two.against)
    ]
    own = sources[0] - sources[1]
    if len(own) == 1:
        return [], delay_lines(drive.config, own.pop(), numbers)
    shared = ", ".join(sorted(sources[0])) or "unknown"
    return [
        f"  both come from one source ({shared}), whose time_offset_s would move both: give {question.two.of!r} a"
        f" source of its own, the same recording once more, with time_offset_s: {numbers[DELAY]:.4f}"
    ], []


def _document(question: Question, found: Calibration, config_lines: list[str]) -> dict[str, Any]:
    fit, check = found.fit, found.check
    return {
        "what": question.what,
        "of": question.two.of,
        "against": question.two.against,
        "intervals": fit.n_pairs,
        "outliers": fit.n_outliers,
        "numbers": {
            NAMES[index]: {
                "value": float(math.remainder(fit.values[index], 2 * math.pi) if index == YAW else fit.values[index]),
                "sigma": float(fit.sigmas[index]),
                "told": bool(fit.is_told[index]),
                "asked": index in _ASKED[question.what],
            }
            for index in _WORDS
        },
        "check": check and {"before": list(check.before), "after": list(check.after), "stretches": check.n},
        "contradictions": {NAMES[index]: sigmas for index, sigmas in found.contradictions.items()},
        "ambiguous": found.rival is not None,
        "clock_drift": found.drift and found.drift.rate,
        "config": config_lines,
    }
