"""``trailmark sim``: the worlds, a picture, a data set on disk. What is heavy is imported on use."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal

import click

from trailmark.errors import ConfigError

__all__ = ["sim"]


@click.group("sim")
def sim() -> None:
    """Simulated worlds: list them, look at them, record a data set."""


@sim.command("list")
@click.argument("world", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def list_command(world: str | None, as_json: bool) -> None:
    """List worlds with their routes and sensors, or the options of one WORLD with their meaning."""
    from trailmark_sim.describe import option_rows, world_rows

    rows: list[dict[str, Any]] = list(world_rows() if world is None else option_rows(world))
    if as_json:
        click.echo(json.dumps(rows, indent=1))
        return
    for row in rows:
        if world is not None:
            click.echo(f"{row['key']:<26}{row['default']:<16}{row['meaning']}")
            continue
        click.echo(f"{row['world']}: {row['summary']}")
        for key in ("routes", "sensors", "options"):
            click.echo(f"  {key:<8} {', '.join(row[key]) or 'none'}")


@sim.command("render")
@click.argument("world")
@click.option("--sensor", help="Which sensor; default: the world's last, a camera.")
@click.option("--at", metavar="X,Y,DEG", help="Pose of the vehicle; default: the start of the route.")
@click.option("--route", help="Which route; some worlds change with it.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="An option of the world, as in configs.")
@click.option("--mode", type=click.Choice(["teach", "replay"]), default="teach", show_default=True)
@click.option("--frame", default=0, show_default=True, type=click.IntRange(0), help="Number of the reading: its noise.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Seed of the noise.")
@click.option("--world-seed", default=1, show_default=True, type=click.IntRange(0), help="Seed of the place.")
@click.option("-o", "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="PNG to write.")
@click.pass_context
def render_command(
    context: click.Context, /, world: str, out: Path, mode: Literal["teach", "replay"], **asked: Any
) -> None:
    """Write what a sensor sees from a pose as a picture."""
    from trailmark.cli.root import plugins_of
    from trailmark.recording import write_png
    from trailmark_sim.pictures import picture_of
    from trailmark_sim.snapshot import take_snapshot
    from trailmark_sim.worlds import world_module

    chosen = asked["sensor"] or world_module(world).SENSORS[-1]
    start = None if asked["at"] is None else _pose(asked["at"])
    keys = {"world": world, "sensors": [chosen], "start": start} | {key: asked[key] for key in ("route", "world_seed")}
    payload = take_snapshot(keys, asked["settings"], mode, asked["frame"], asked["seed"], plugins_of(context))
    write_png(out, picture_of(payload))
    click.echo(f"{chosen} of {world} -> {out}")


@sim.command("record")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder to write to.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@click.option("--mode", type=click.Choice(["teach", "replay"]), default="teach", show_default=True)
@click.option("--overwrite", is_flag=True, help="Write into a folder that is not empty.")
@click.pass_context
def record_command(
    context: click.Context,
    config: Path,
    out: Path,
    settings: tuple[str, ...],
    mode: Literal["teach", "replay"],
    overwrite: bool,
) -> None:
    """Drive the route of CONFIG and write what the sensors saw: an ordinary data set for any program."""
    from trailmark.cli.root import plugins_of
    from trailmark_sim.record import record_run

    for line in record_run(config, out, settings, mode, overwrite, plugins_of(context)):
        click.echo(line)


@sim.command("statistics")
@click.argument("pictures", nargs=-1, type=click.Path(path_type=Path))
@click.option("--floors", is_flag=True, help="Also the built-in floors, as the ground camera sees them.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def statistics_command(pictures: tuple[Path, ...], floors: bool, as_json: bool) -> None:
    """Print contrast, spectrum and features of PICTURES: how alike are the simulator and the world?"""
    from dataclasses import asdict

    from trailmark_sim.ground.floors import FLOORS
    from trailmark_sim.ground.ground import Floor
    from trailmark_sim.ground.statistics import floor_statistics
    from trailmark_sim.realism import photo_statistics

    if not pictures and not floors:
        raise ConfigError("give pictures, or --floors")
    rows = [{"picture": path.name} | asdict(photo_statistics(path)) for path in pictures]
    names = sorted(FLOORS) if floors else []
    rows += [{"picture": f"floor {name}"} | asdict(floor_statistics(Floor(name))) for name in names]
    if as_json:
        click.echo(json.dumps(rows, indent=1))
        return
    click.echo("  ".join([f"{'picture':<28}", *(f"{key:>8}" for key in rows[0] if key != "picture")]))
    for row in rows:
        numbers = [f"{value:8.3g}" for value in row.values() if isinstance(value, float)]
        click.echo("  ".join([f"{row['picture']:<28}", *numbers]))


def _pose(text: str) -> list[float]:
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"--at takes X,Y,DEG in metres and degrees, for example 1.5,0,90, not {text!r}")
    return numbers
