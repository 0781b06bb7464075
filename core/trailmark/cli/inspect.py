"""``trailmark inspect``: what a source gives, before anything is made of it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from trailmark.cli.errors import say
from trailmark.cli.root import plugins_of
from trailmark.config import SensorOverride
from trailmark.errors import ConfigError
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import FrameSource, Session
from trailmark.pipeline import SourceStream, build_sources

if TYPE_CHECKING:
    from trailmark.plugins import Registry

__all__ = ["inspect_command"]

_WIDEST = 10_000  # columns


@dataclass(slots=True)
class _SensorSummary:
    """What was seen of one sensor."""

    info: SensorInfo
    stamps_s: list[float] = field(default_factory=list)
    first: Frame | None = None


@click.command("inspect")
@click.argument("target", metavar="CONFIG|RECORDING|camera|NETWORK")
@click.option("--frames", "n_frames", type=click.IntRange(1), default=300, show_default=True, help="Frames to read.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the first picture of each camera.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.pass_context
def inspect_command(
    context: click.Context, /, target: str, n_frames: int, out: Path | None, overrides: tuple[str, ...], as_json: bool
) -> None:
    """Show the sensors of a source: kinds, sizes, rates, intervals, and their first frames as pictures.

    Of a network, such as ros2://0, show what is on it.
    """
    from trailmark.cli.guess import read_target

    plugins = plugins_of(context)
    if "://" in target:
        _survey(target, plugins.registry, as_json)
        return
    run_config = read_target(target, plugins, overrides)
    if not run_config.sources:
        raise ConfigError(f"{target}: there are no sources to inspect")
    rows: list[dict[str, Any]] = []
    unread: dict[str, str] = {}
    origins: list[str] = []
    for source in build_sources(run_config):
        seen = _look(source, n_frames, run_config.sensors)
        rows += [_row(source.name, one) for one in seen.values()]
        unread |= source.source.unread()
        origins += source.origins_in_words(run_config.sensors)
        if out is not None:
            _write_pictures(seen, out)
    if as_json:
        click.echo(json.dumps(rows, indent=1))
    else:
        _print(rows)
    for line in (*origins, *(f"not read: {name} ({remark})" for name, remark in unread.items())):
        click.echo(line, err=as_json)


def _survey(target: str, registry: Registry, as_json: bool) -> None:
    """Show what is on a network: ``NAME://WHERE``, with the name of the source that reads it."""
    name, _, where = target.partition("://")
    source: type[FrameSource] = registry.find("source", name).load()
    rows = source.survey(where)
    if as_json:
        click.echo(json.dumps(rows, indent=1))
        return
    if not rows:
        click.echo(f"nothing is seen at {target}")
        return
    from rich.table import Table
    from rich.text import Text

    from trailmark.report.console import table_console

    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in rows[0]:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(Text(str(cell)) for cell in row.values()))
    table_console().print(table)


def _look(source: SourceStream, n_frames: int, overrides: Mapping[str, SensorOverride]) -> dict[str, _SensorSummary]:
    """Start a source, read its first frames, close it."""
    try:
        source.start(Session(name=source.name))
        seen = {name: _SensorSummary(info) for name, info in source.known_sensors(overrides).items()}
        for frame in islice(source.frames(), n_frames):
            one = seen[frame.sensor]
            one.stamps_s.append(frame.stamp_s)
            one.first = one.first or frame
    finally:
        source.close()
    return seen


def _row(source: str, seen: _SensorSummary) -> dict[str, Any]:
    info = seen.info
    intervals_ms = np.diff(seen.stamps_s) * 1e3
    return {
        "source": source,
        "sensor": info.name,
        "kind": info.kind,
        "size": list(info.size) if info.size else None,
        "rate_hz": info.rate_hz,
        "frames": len(seen.stamps_s),
        "first_s": seen.stamps_s[0] if seen.stamps_s else None,
        "interval_ms": {
            name: float(np.quantile(intervals_ms, q)) for name, q in (("min", 0.0), ("median", 0.5), ("max", 1.0))
        }
        if len(intervals_ms)
        else None,
        "mounting": _mounting(info),
        "calibration": type(info.calibration).__name__ if info.calibration is not None else None,
    }


def _mounting(info: SensorInfo) -> dict[str, float]:
    pose = info.pose_base_sensor
    angles = {f"{name}_deg": round(math.degrees(getattr(pose, name)), 6) for name in ("roll", "pitch", "yaw")}
    return {name: round(getattr(pose, name), 6) for name in ("x", "y", "z")} | angles


def _write_pictures(seen: dict[str, _SensorSummary], out: Path) -> None:
    import cv2

    out.mkdir(parents=True, exist_ok=True)
    for name, one in seen.items():
        pixels = None if one.first is None else one.first.payload.picture
        if pixels is not None:
            path = out / f"{name}.png"
            cv2.imwrite(str(path), pixels)
            say(f"wrote {path}")


def _print(rows: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from trailmark.report.console import table_console

    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in ("sensor", "kind", "size", "rate", "frames read", "interval min / median / max", "calibration"):
        table.add_column(column, no_wrap=column == "sensor", overflow="fold")  # a name is for copying
    for row in rows:
        interval = row["interval_ms"]
        cells = (
            row["sensor"],
            row["kind"],
            " x ".join(map(str, row["size"])) if row["size"] else "",
            f"{row['rate_hz']:.4g} Hz" if row["rate_hz"] else "",
            str(row["frames"]),
            f"{interval['min']:.1f} / {interval['median']:.1f} / {interval['max']:.1f} ms" if interval else "",
            row["calibration"] or "none",
        )
        table.add_row(*(Text(cell) for cell in cells))
    console = table_console()
    whole = Console(width=_WIDEST).measure(table).maximum
    console.width = max(console.width, whole)  # a long name takes no column's place
    console.print(table)
