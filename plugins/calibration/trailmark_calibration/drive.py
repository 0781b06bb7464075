"""The drive of a calibration: what two localizers of a config, or of a recorded run, say of it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from trailmark.config import RunConfig, load_run_config
from trailmark.config.base import sensor_roles
from trailmark.config.checks import sensors_of
from trailmark.config.roles import resolve_all_roles
from trailmark.errors import ConfigError, DataError, TrailmarkError
from trailmark.estimates import Estimate, Fix, Lost, Motion
from trailmark.evaluation.estimates_table import EstimateTable, read_estimates
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.interruption import ending_signal
from trailmark.pipeline import Pipeline, build_parts, build_sources
from trailmark.plugins import Plugins

__all__ = [
    "Drive",
    "TwoLocalizers",
    "choose_two",
    "observe_drive",
    "read_localizers",
    "read_run",
    "reads_wheels_alone",
    "restricted_to",
]

logger = logging.getLogger(__name__)

_TAKES_NOTHING = {"plugin": "dead_reckoning", "use": []}


@dataclass(frozen=True, slots=True)
class TwoLocalizers:
    """The localizer that is calibrated, and the one that it is compared with.

    Attributes
    ----------
    of : str
        Name in the config of the one that is calibrated.
    against : str
        Name in the config of the reference.
    """

    of: str
    against: str


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What was said on a drive.

    Attributes
    ----------
    said : mapping of str to sequence of Estimate
        By localizer.
    config : RunConfig
        With every role of its localizers filled.
    sensors : mapping of str to SensorInfo
        As the run knew them.
    source_of : mapping of str to str
        Which source gives each sensor.
    """

    said: Mapping[str, Sequence[Estimate]]
    config: RunConfig
    sensors: Mapping[str, SensorInfo]
    source_of: Mapping[str, str]

    def sensors_of(self, localizer: str) -> list[SensorInfo]:
        """Return the sensors that a localizer looks at."""
        names = sensors_of(self.config.localizers[localizer].config)
        return [self.sensors[name] for name in names if name in self.sensors]


def reads_wheels_alone(config: RunConfig, name: str) -> bool:
    """Return whether a localizer looks at odometry and at nothing else."""
    kinds = [role.kinds for role in sensor_roles(type(config.localizers[name].config)).values()]
    return bool(kinds) and all(of == ("odometry",) for of in kinds)


def choose_two(config: RunConfig, of: str | None, against: str | None, *, of_wheels: bool) -> TwoLocalizers:
    """Return the two localizers to compare: as named, or, of wheels and one other, which is which.

    Parameters
    ----------
    config : RunConfig
        Names the localizers.
    of, against : str or None
        As the user said.
    of_wheels : bool
        Whether wheels are calibrated, or the other one.

    Raises
    ------
    ConfigError
        If it is not clear who is meant.
    """
    names = list(config.localizers)
    for name in (of, against):
        if name is not None and name not in names:
            raise ConfigError(f"no localizer is called {name!r}; the config has {', '.join(names) or 'none'}")
    if len(names) < 2:
        raise ConfigError(f"two localizers are compared, and the config has {', '.join(names) or 'none'}")
    wheels = {name for name in names if reads_wheels_alone(config, name)}
    candidates = {
        "of": [name for name in names if (name in wheels) == of_wheels and name != against],
        "against": [name for name in names if (name in wheels) != of_wheels and name != of],
    }
    found = {"of": of, "against": against}
    for option, given in found.items():
        fitting = candidates[option]
        if given is None and len(fitting) != 1:
            raise ConfigError(f"say which localizer is meant with --{option}: {', '.join(fitting or names)}")
        found[option] = given or fitting[0]
    if found["of"] == found["against"]:
        raise ConfigError(f"{found['of']!r} cannot be compared with itself")
    return TwoLocalizers(str(found["of"]), str(found["against"]))


def observe_drive(config: RunConfig, two: TwoLocalizers) -> Drive:
    """Run two localizers of a config over its sources, in mode track, and return what they say; nothing is written.

    Raises
    ------
    ConfigError
        If the config has no source, or its parts do not fit together.
    RunError, DataError
        If the run fails.
    KeyboardInterrupt
        If the run is interrupted, unless all its sources are live: a drive of a robot is ended so.
    """
    if not config.sources:
        raise ConfigError("the config has no source: a recording, a robot or a simulated world")
    parts = build_parts(config.with_mode("track"))
    said: dict[str, list[Estimate]] = {two.of: [], two.against: []}
    with Pipeline(replace(parts, sinks=MappingProxyType({}))) as pipeline:
        for step in pipeline:
            for record in step.estimates:
                if record.source in said:
                    said[record.source].append(record.estimate)
        sensors = pipeline.sensors
        if pipeline.result.status == "interrupted" and not all(source.is_live for source in parts.sources):
            raise ending_signal() or KeyboardInterrupt
    source_of = {sensor: source.name for source in parts.sources for sensor in source.sensors}
    return Drive(said, resolve_all_roles(config, sensors), sensors, source_of)


def read_localizers(config: str | Path, plugins: Plugins, overrides: Sequence[str]) -> RunConfig:
    """Return a config whose estimator takes nothing: motion that would count twice is what is asked for here.

    Raises
    ------
    ConfigError
        If the config is wrong.
    """
    return load_run_config(config, plugins=plugins, overrides=[*overrides, ("estimator", _TAKES_NOTHING)])


def restricted_to(config: RunConfig, two: TwoLocalizers, estimator: Any) -> RunConfig:
    """Return the config without other localizers and sinks, the belief made of the one that is compared against.

    So the belief, from which localizers begin to look, does not follow the one that may be wrong. Where the config says
    itself what its estimator uses, or fixes alone are compared against, the belief is of both.

    Parameters
    ----------
    config : RunConfig
        As of `read_localizers`.
    two : TwoLocalizers
        Who is compared.
    estimator : any
        The section ``estimator`` as it was written.
    """
    data = {key: value for key, value in config.written.data.items() if key not in ("sinks", "controller")}
    data["localizers"] = {name: data["localizers"][name] for name in (two.against, two.of)}
    section = {"plugin": estimator} if isinstance(estimator, str) else dict(estimator or {})
    kept = [name for name in section.pop("use", None) or () if name in data["localizers"]]
    if not kept and "fix" not in config.localizers[two.against].spec.gives:
        kept = [two.against]
    data["estimator"] = section | ({"use": kept} if kept else {})
    return load_run_config(replace(config.written, data=data), plugins=config.plugins)


def read_run(folder: Path, config: RunConfig, two: TwoLocalizers) -> Drive:
    """Return what the localizers of a recorded run said. Its sources are opened for what they know of sensors alone.

    Raises
    ------
    DataError
        If its estimates cannot be read, or it has none of the two.
    """
    table = read_estimates(folder / "estimates.csv")
    said = {name: _estimates(table.of(name)) for name in (two.of, two.against)}
    for name, estimates in said.items():
        if not estimates:
            raise DataError(f"{folder}: {name!r} said nothing in this run")
    sensors: dict[str, SensorInfo] = {}
    source_of: dict[str, str] = {}
    for source in build_sources(config):
        try:
            source.start(Session(name=source.name))
            known = source.known_sensors(config.sensors)
        except TrailmarkError as error:
            logger.warning(
                "%s: source %r cannot be opened any more (%s): mountings that its recording knows are missing here,"
                " those of the config are taken",
                folder,
                source.name,
                " ".join(str(error).split()),
            )
            continue
        finally:
            source.close()
        sensors |= known
        source_of |= dict.fromkeys(known, source.name)
    with suppress(TrailmarkError):
        config = resolve_all_roles(config, sensors)
    return Drive(said, config, sensors, source_of)


def _estimates(table: EstimateTable) -> list[Estimate]:
    found: list[Estimate] = []
    for kind, since_s, stamp_s, numbers, information in zip(
        table.kind, table.since_s.tolist(), table.stamp_s.tolist(), table.numbers, table.information
    ):
        if kind == "motion":
            found.append(Motion(since_s, stamp_s, Pose2.from_array(numbers), information))
        elif kind == "fix":
            found.append(Fix(stamp_s, Pose2.from_array(numbers), information))
        else:
            found.append(Lost(stamp_s, str(kind)))
    return found
