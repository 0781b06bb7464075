"""``trailmark data``: which known recordings are here, whether they are whole, and how each is played."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.errors import ConfigError, TrailmarkError

if TYPE_CHECKING:
    from trailmark.datasets import Dataset
    from trailmark.plugins import Plugins

__all__ = ["data_group"]

_N_FRAMES = 50

_FOLDER = click.option(
    "--data",
    "folder",
    envvar="TRAILMARK_DATA",
    type=click.Path(path_type=Path, exists=True, file_okay=False, resolve_path=True),
    help="The folder of recordings; default: TRAILMARK_DATA.",
)


@click.group("data")
def data_group() -> None:
    """Known recordings: which are here, whether they are whole, how each is played. Nothing is fetched."""


@data_group.command("list")
@_FOLDER
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.pass_context
def list_command(context: click.Context, folder: Path | None, as_json: bool) -> None:
    """List the recordings that plugins name, and which of them are here."""
    rows = [
        {
            "name": name,
            "here": folder is not None and not known.missing(folder),
            "summary": known.summary,
            "truth": known.truth,
            "licence": known.licence,
        }
        for name, known in _known_datasets(context)
    ]
    if as_json:
        click.echo(json.dumps(rows, indent=1, ensure_ascii=False))
        return
    for row in rows:
        click.echo(f"{'here' if row['here'] else '-':5}{row['name']:24}{row['summary']}")
    if folder is None:
        click.echo("no folder of recordings: give --data, or set TRAILMARK_DATA", err=True)


@data_group.command("show")
@click.argument("name")
@_FOLDER
@click.option("--config", "as_config", is_flag=True, help="Print a run config that plays it, and nothing else.")
@click.pass_context
def show_command(context: click.Context, name: str, folder: Path | None, as_config: bool) -> None:
    """Say what a recording is, whose, where it can be had; or print a config that plays it."""
    from trailmark.config.yaml_text import dump_yaml

    (known,) = (found for _, found in _datasets_named(context, (name,)))
    if as_config:
        placed = known.config_in(folder or Path("${TRAILMARK_DATA}"))
        click.echo(dump_yaml(placed), nl=False)
        return
    about = {
        "what": known.summary,
        "truth": known.truth or "none",
        "licence": known.licence or "not told; see its source",
        "cite": known.cite,
        "from": known.url,
    }
    for key, value in about.items():
        click.echo(f"{key:9}{value}")
    for file in known.files:
        state = "not here" if folder is None or file in known.missing(folder) else "here"
        click.echo(f"{'file':9}{file} ({state})")


@data_group.command("check")
@click.argument("names", nargs=-1)
@_FOLDER
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.pass_context
def check_command(context: click.Context, names: tuple[str, ...], folder: Path | None, as_json: bool) -> None:
    """Check recordings: every file by its checksum, then the first frames are played.

    Without NAMES, all that are here. Exit code 1: one is damaged, cannot be played, or was named and is not here.
    """
    if folder is None:
        raise ConfigError("no folder of recordings: give --data, or set TRAILMARK_DATA")
    found = []
    for name, known in _datasets_named(context, names):
        missing = known.missing(folder)
        if missing and not names:
            found.append({"name": name, "state": "not here", "why": ""})
            continue
        why = _trouble(known, folder, missing, context)
        found.append({"name": name, "state": "wrong" if why else "whole", "why": why})
    if as_json:
        click.echo(json.dumps(found, indent=1, ensure_ascii=False))
    else:
        for row in found:
            click.echo(f"{row['state']:10}{row['name']:24}{row['why']}".rstrip())
    if all(row["state"] == "not here" for row in found):
        raise ConfigError(
            f"none of the {len(found)} recordings is below {folder}; 'trailmark data show NAME' says more"
        )
    if any(row["state"] == "wrong" for row in found):
        context.exit(1)


def _trouble(known: Dataset, folder: Path, missing: tuple[str, ...], context: click.Context) -> str:
    """Return what is wrong with a recording; "" where nothing is."""
    if missing:
        return f"not here: {', '.join(missing)}"
    if damaged := known.damaged(folder):
        return f"not the file that it was tried with: {', '.join(damaged)}"
    try:
        return _problem_in_first_frames(known.config_in(folder), _plugins(context), has_truth=bool(known.truth))
    except TrailmarkError as error:
        return str(error)


def _problem_in_first_frames(config: dict[str, Any], plugins: Plugins, *, has_truth: bool) -> str:
    """Play the first frames; return what is wrong."""
    from trailmark.pipeline import Pipeline

    with Pipeline(config, plugins=plugins) as pipeline:
        for _ in islice(pipeline, _N_FRAMES):
            pass
        pipeline.close()
        truth = pipeline.result.ground_truth
    return "its ground truth is missing" if has_truth and (truth is None or not len(truth)) else ""


def _known_datasets(context: click.Context) -> Iterator[tuple[str, Dataset]]:
    for spec in _plugins(context).registry.specs("dataset"):
        yield spec.name, spec.load()


def _datasets_named(context: click.Context, names: tuple[str, ...]) -> list[tuple[str, Dataset]]:
    """Return the recordings of some names, or all.

    Raises
    ------
    UnknownPluginError
        If there is no such recording.
    """
    if not names:
        return list(_known_datasets(context))
    registry = _plugins(context).registry
    return [(name, registry.find("dataset", name).load()) for name in names]


def _plugins(context: click.Context) -> Plugins:
    from trailmark.cli.root import plugins_of

    return plugins_of(context)
