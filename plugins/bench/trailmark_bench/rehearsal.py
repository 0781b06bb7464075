"""Checks that the localizers of cells find their sensors, when cells are listed and before any runs."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from trailmark.config import Document, RunConfig, load_run_config
from trailmark.config.roles import refuse_duplicate_sensors, resolve_all_roles
from trailmark.errors import TrailmarkError
from trailmark.frames import SensorInfo
from trailmark.interfaces import Session
from trailmark.isolation.fingerprint import digest_of
from trailmark.pipeline.instruments import Counters
from trailmark.pipeline.parts import build_sources
from trailmark.plugins import Plugins
from trailmark_bench.cell import Cell
from trailmark_bench.order import first_samples, without_faults

__all__ = ["misfits"]

# A cell that ended so had found its sensors.
_BEGUN = ("ok", "timeout")


def misfits(cells: Sequence[Cell], plugins: Plugins, known: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return why cells cannot start, by their id; those that can, and those that are skipped anyway, have no word.

    The sources are started, once for each way in which they are written but for faults, of the first place and seed of
    each combination alone, and closed again; no frame is read, and no localizer is started. Devices are let be.

    Parameters
    ----------
    cells : sequence of Cell
        Of a bench.
    plugins : Plugins
        Where their parts are found.
    known : mapping of str to str, optional
        States of cells by id: what one like it has begun with needs no rehearsal.
    """
    states = known or {}
    begun = {_kind(cell) for cell in cells if states.get(cell.id) in _BEGUN}
    found: dict[str, str] = {}
    started: dict[str, Mapping[str, SensorInfo] | str | None] = {}
    of_kind: dict[object, str] = {}
    for cell in first_samples([cell for cell in cells if cell.request and _kind(cell) not in begun]):
        document = cell.request["document"]
        plain = document | {"sources": {name: without_faults(part) for name, part in document["sources"].items()}}
        looked_at = {key: plain.get(key) for key in ("sources", "sensors", "localizers")}
        address = digest_of(looked_at)
        if address not in found:
            config = _load(plain, cell.request["base_dir"], plugins)
            sources = digest_of({key: looked_at[key] for key in ("sources", "sensors")})
            if sources not in started:
                started[sources] = _sensors_of(config)
            found[address] = _misfit(config, started[sources])
        of_kind[_kind(cell)] = found[address]
    return {cell.id: reason for cell in cells if cell.request and (reason := of_kind.get(_kind(cell)))}


def _kind(cell: Cell) -> object:
    """Return what decides whether sensors are found: neither place nor seed nor fault makes one."""
    beside = ("place", "seed", "perturbation")
    return cell.matrix, tuple(value for axis, value in cell.coordinates.items() if axis not in beside)


def _load(document: dict[str, Any], base_dir: str, plugins: Plugins) -> RunConfig:
    return load_run_config(Document(document, "cell", Path(base_dir)), plugins=plugins)


def _misfit(config: RunConfig, sensors: Mapping[str, SensorInfo] | str | None) -> str:
    """Return why a cell cannot start; empty: it can, as far as is known."""
    if sensors is None:
        return ""
    if isinstance(sensors, str):
        return sensors
    try:
        resolve_all_roles(config, sensors)
    except TrailmarkError as error:
        return str(error)
    return ""


def _sensors_of(config: RunConfig) -> Mapping[str, SensorInfo] | str | None:
    """Return the sensors that the sources have, or why they do not start; None of devices."""
    sensors: dict[str, SensorInfo] = {}
    sources = build_sources(config)
    if any(source.is_live for source in sources):
        return None
    try:
        for source in sources:
            source.start(Session(name=source.name, mode=config.settings.mode), Counters(), array("q"))
            sensors |= source.known_sensors(config.sensors)
        refuse_duplicate_sensors(config, {source.name: tuple(source.sensors) for source in sources})
    except TrailmarkError as error:
        return str(error)
    finally:
        for source in sources:
            source.close()
    return sensors
