"""The report of a calibration: numbers with their uncertainty, those that stay undetermined, and warnings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.frames import SensorInfo
from trailmark_calibration.checking import Calibration, calibrate, told_values
from trailmark_calibration.config_lines import delay_lines, mounting_lines, odometry_lines, wheels_in_words
from trailmark_calibration.drive import Drive, TwoLocalizers
from trailmark_calibration.fitting import Fit, KnownPlacement
from trailmark_calibration.model import DELAY, NAMES, TURN, TURN_PER_M, WAY, YAW, MotionPairs, X, Y, pairs_of
from trailmark_calibration.tracks import track_of
from trailmark_calibration.units import refuse_one_recording, refuse_other_units
from trailmark_calibration.wording import (
    WORDS,
    changes_in_words,
    check_in_words,
    headline,
    line_of,
    oddities_in_words,
)

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


#: The numbers of each question.
_ASKED = {"odometry": (WAY, TURN, TURN_PER_M), "mounting": (X, Y, YAW), "delay": (DELAY,)}


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
    lines = [headline(question.what, two, pairs, found.fit), *(line_of(found, index) for index in asked)]
    lines += oddities_in_words(found, known, name_a, name_b)
    lines += changes_in_words(found, asked, known)
    lines += check_in_words(found) if is_told else []
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
            for index in WORDS
        },
        "check": check and {"before": list(check.before), "after": list(check.after), "stretches": check.n},
        "contradictions": {NAMES[index]: one.sigmas for index, one in found.contradictions.items()},
        "contradicting_parts": {NAMES[index]: one.parts for index, one in found.contradictions.items()},
        "ambiguous": found.rival is not None,
        "clocks_run_apart": found.drift is not None,
        "config": config_lines,
    }
