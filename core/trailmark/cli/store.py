"""``trailmark store``: look into a path store, check it, take it apart."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

__all__ = ["store_group"]

_FILE = click.Path(path_type=Path)


@click.group("store")
def store_group() -> None:
    """Look into a path store."""


@store_group.command("info")
@click.argument("file", type=_FILE)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def info_command(file: Path, as_json: bool) -> None:
    """Show what a store holds: path, maps of the localizers, sensors, provenance."""
    from trailmark.stores.survey import describe_store

    found = describe_store(file.resolve())
    if as_json:
        click.echo(json.dumps(found, indent=1))
        return
    click.echo(f"{file}: {_bytes(found['bytes'])}, schema {found['schema']}")
    click.echo(f"path        {found['waypoints']} waypoints over {found['length_m']:.2f} m")
    for stored in found["drawers"]:
        click.echo(f"map         {_map_line(stored)}")
    for name, sensor in found["sensors"].items():
        click.echo(f"sensor      {_plain(name)}: {_sensor_line(sensor)}")
    for key, value in found["provenance"].items():
        text = value if isinstance(value, str) else json.dumps(value)
        click.echo(f"provenance  {_plain(key)}: {_plain(text, 100)}")


@store_group.command("check")
@click.argument("file", type=_FILE)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def check_command(file: Path, as_json: bool) -> None:
    """Read and verify every row. Exit code 1 when something is not as it was written."""
    from trailmark.stores.check import check_store

    findings = check_store(file.resolve())
    if as_json:
        document = {"sound": findings.is_sound, "problems": findings.problems, "more": findings.n_more}
        click.echo(json.dumps(document | {"readable": findings.readable}, indent=1))
    else:
        click.echo(f"{file}: {'sound' if findings.is_sound else 'damaged'}")
        for what, (n_good, n_expected) in findings.readable.items():
            click.echo(f"{n_good:>8} of {'?' if n_expected is None else n_expected:<8} {_plain(what)}")
        for problem in findings.problems:
            click.echo(f"- {_plain(problem, 200)}")
        if findings.n_more:
            click.echo(f"- and {findings.n_more} more")
    if not findings.is_sound:
        raise click.exceptions.Exit(1)


@store_group.command("export")
@click.argument("file", type=_FILE)
@click.option("--out", "folder", type=_FILE, help="New or empty folder; default: NAME-export.")
@click.option("--json", "as_json", is_flag=True, help="Print the files as JSON.")
def export_command(file: Path, folder: Path | None, as_json: bool) -> None:
    """Write path, maps and sensors as TUM, CSV, JSON and NPZ files."""
    from trailmark.stores.export import export_store

    folder = folder or Path(f"{file.stem}-export")
    files = export_store(file.resolve(), folder)
    if as_json:
        click.echo(json.dumps({"folder": str(folder), "files": [str(written) for written in files]}, indent=1))
    else:
        click.echo(f"{len(files)} files in {folder}")


@store_group.command("copy")
@click.argument("file", type=_FILE)
@click.argument("target", type=_FILE)
@click.option("--overwrite", is_flag=True, help="Replace a path store that stands there.")
def copy_command(file: Path, target: Path, overwrite: bool) -> None:
    """Copy a store, also one that is being taught: everything committed until now, in one file."""
    from trailmark.stores.copying import copy_store

    n_waypoints = copy_store(file.resolve(), target.resolve(), replaces=overwrite)
    click.echo(f"{target}: {n_waypoints} waypoints")


def _map_line(stored: dict[str, Any]) -> str:
    names = ", ".join(_plain(name) for name in stored["saved"]) or "nothing"
    state = "finished" if stored["finished"] else "not finished"
    return (
        f"{_plain(stored['owner'])}: {stored['keyframes']} keyframes ({_bytes(stored['keyframe_bytes'])}),"
        f" saved {names} ({_bytes(stored['saved_bytes'])}), {state}"
    )


def _sensor_line(sensor: Any) -> str:
    known = sensor if isinstance(sensor, dict) else {}
    size = known.get("size")
    rate = known.get("rate_hz")
    parts = [
        _plain(str(known.get("kind", "unknown"))),
        f"{size[0]} x {size[1]} px" if isinstance(size, list) and len(size) == 2 else "",
        f"{rate:g} Hz" if isinstance(rate, float | int) else "",
        "calibrated" if known.get("calibration") else "not calibrated",
    ]
    return ", ".join(part for part in parts if part)


def _bytes(count: int) -> str:
    return (
        f"{count} B" if count < 10_000 else f"{count / 1e3:.1f} kB" if count < 10_000_000 else f"{count / 1e6:.1f} MB"
    )


def _plain(text: str, length: int = 80) -> str:
    """Return text that cannot steer a terminal: a store may come from a stranger."""
    shown = "".join(character if character.isprintable() else "?" for character in text)
    return shown if len(shown) <= length else f"{shown[: length - 3]}..."
