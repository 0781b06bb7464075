"""``trailmark map``: occupancy grids from taught places, and what a map holds. What is heavy is imported on use."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from trailmark.errors import ConfigError

if TYPE_CHECKING:
    from trailmark_laser_maps.grid import OccupancyGrid

__all__ = ["map_group"]

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.group("map")
def map_group() -> None:
    """Occupancy grids: draw one from a taught place, look into one."""


@map_group.command("export")
@click.argument("store", type=_FILE)
@click.option("--out", type=_FILE, required=True, help="The map.yaml to write; the pgm gets its name.")
@click.option("--localizer", help="Whose scans; default: the only localizer that remembers some.")
@click.option(
    "--resolution", default=0.05, show_default=True, type=click.FloatRange(0.005, 1.0), help="Side of a cell [m]."
)
@click.option("--overwrite", is_flag=True, help="Replace files that stand there.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def export_command(
    store: Path, out: Path, localizer: str | None, resolution: float, overwrite: bool, as_json: bool
) -> None:
    """Write the occupancy grid of a taught place as ROS reads it: map.yaml and a pgm."""
    from trailmark_laser_maps.carving import carve_grid
    from trailmark_laser_maps.map_yaml import write_map
    from trailmark_laser_maps.taught import taught_scans

    if out.suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--out {out}: a map is a .yaml beside its .pgm")
    standing = [path for path in (out, out.with_suffix(".pgm")) if path.exists()]
    if standing and not overwrite:
        raise ConfigError(f"{standing[0]} exists; --overwrite replaces it")
    scans = taught_scans(store.resolve(), localizer)
    grid = carve_grid(scans, resolution_m=resolution)
    picture = write_map(out, grid)
    if as_json:
        click.echo(json.dumps({"map": str(out), "image": str(picture), "scans": len(scans)} | _numbers(grid)))
        return
    click.echo(f"{out}: {len(scans)} scans, {_line(grid)}")
    click.echo(f"use it with localizers.NAME: {{plugin: grid_mcl, map: {out}}}")


@map_group.command("show")
@click.argument("file", type=_FILE)
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.option("--width", default=100, show_default=True, type=click.IntRange(10, 400), help="Columns of the sketch.")
def show_command(file: Path, as_json: bool, width: int) -> None:
    """Show what a map.yaml says, and a sketch of it: # occupied, . free."""
    from trailmark_laser_maps.map_yaml import read_map

    grid = read_map(file)
    if as_json:
        click.echo(json.dumps({"map": str(file)} | _numbers(grid)))
        return
    origin = grid.pose_map_grid
    click.echo(f"{file}: {_line(grid)}")
    click.echo(f"lower left corner at ({origin.x:.2f}, {origin.y:.2f}) m, turned by {origin.theta:.4f} rad")
    click.echo("\n".join(_sketch(grid, width)))


def _numbers(grid: OccupancyGrid) -> dict[str, object]:
    height, width = grid.cells.shape
    return {
        "width": width,
        "height": height,
        "resolution_m": grid.resolution_m,
        "origin": grid.pose_map_grid.array().tolist(),
        "free_m2": round(grid.free_m2, 3),
        "occupied_cells": int(grid.is_occupied.sum()),
    }


def _line(grid: OccupancyGrid) -> str:
    height, width = grid.cells.shape
    return (
        f"{width} x {height} cells of {grid.resolution_m:g} m, {width * grid.resolution_m:.1f} x "
        f"{height * grid.resolution_m:.1f} m, {grid.free_m2:.1f} m2 free"
    )


def _sketch(grid: OccupancyGrid, columns: int) -> list[str]:
    """Return lines of text, the top of the map first; a character is twice as high as wide."""
    wide = max(1, -(-grid.cells.shape[1] // columns))
    tall, is_occupied, is_free = 2 * wide, grid.is_occupied, grid.is_free
    lines = []
    for bottom in range(0, grid.cells.shape[0], tall):
        signs = []
        for left in range(0, grid.cells.shape[1], wide):
            patch = slice(bottom, bottom + tall), slice(left, left + wide)
            signs.append("#" if is_occupied[patch].any() else "." if is_free[patch].any() else " ")
        lines.append("".join(signs).rstrip())
    return lines[::-1]
