"""``trailmark record``: any source to disk, in formats that any program reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.cli.errors import say
from trailmark.cli.root import plugins_of
from trailmark.errors import ConfigError
from trailmark.interruption import TELL_S, shielded

if TYPE_CHECKING:
    from trailmark.config import RunConfig
    from trailmark.recording import Recording

__all__ = ["record_command"]


@click.command("record")
@click.argument("target", metavar="CONFIG|RECORDING|camera")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder to write to.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@click.option("--overwrite", is_flag=True, help="Write into a folder that is not empty.")
@click.option("--progress", type=click.Choice(["auto", "none"]), default="auto", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Print the counts as JSON.")
@click.pass_context
def record_command(
    context: click.Context,
    /,
    target: str,
    out: Path,
    overrides: tuple[str, ...],
    overwrite: bool,
    progress: Any,
    as_json: bool,
) -> None:
    """Write what the sources of CONFIG give to a folder: pictures, tables, calibrations and a config.yaml.

    `trailmark run DIR/config.yaml` plays them again. Ctrl-C ends a recording and keeps it; localizers are not run.
    """
    from trailmark.cli.guess import read_target
    from trailmark.cli.progress import RunProgress
    from trailmark.recording import record_sources

    run_config = read_target(target, plugins_of(context), overrides)
    if not run_config.sources:
        raise ConfigError(f"{target}: there are no sources to record; add a section 'sources:'")
    _refuse_own_sources(run_config, out)
    with RunProgress(progress) as on_step:
        recording = record_sources(run_config, out, overwrite=overwrite, on_step=on_step)
    with shielded(TELL_S):
        _tell(recording, out, as_json)
    if recording.status == "interrupted":
        raise click.exceptions.Exit(130)


def _refuse_own_sources(config: RunConfig, out: Path) -> None:
    """Refuse a folder that holds what is recorded from: it would be written over while it is read."""
    for source in config.sources.values():
        for key, value in source.config.model_dump().items():
            if isinstance(value, Path) and value.resolve().is_relative_to(out.resolve()):
                raise ConfigError(f"--out {out}: sources.{source.name}.{key} is read from there; choose another folder")


def _tell(recording: Recording, out: Path, as_json: bool) -> None:
    """Print what was written; on standard error what will be missed."""
    unplayed = [name for name, count in recording.frames.items() if count and name not in recording.playable]
    if recording.status != "done":
        say(f"recording {recording.status}: what came before is kept")
    if unplayed:
        say(f"{', '.join(unplayed)}: written for other programs; no source plays it again")
    if recording.n_dropped:
        say(f"{recording.n_dropped} frames were dropped: they came faster than they could be written")
    if recording.n_too_far:
        say(
            f"{recording.n_too_far} depth values beyond 13.1 m, which a picture of 16 bits cannot hold, are written as"
            " not measured"
        )
    if as_json:
        document = {"status": recording.status, "folder": str(out), "frames": dict(recording.frames)}
        click.echo(
            json.dumps(
                document
                | {"playable": recording.playable, "dropped": recording.n_dropped, "too_far": recording.n_too_far},
                indent=1,
            )
        )
        return
    for name, count in recording.frames.items():
        click.echo(f"{count:>8} frames of {name}")
    click.echo(f"{out / 'config.yaml'}")
