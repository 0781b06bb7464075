"""``trailmark init``: a commented config to start from. Plugins ship them in a folder ``starters`` of their package."""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

import click

from trailmark.cli.root import plugins_of
from trailmark.errors import ConfigError
from trailmark.plugins import Plugins

__all__ = ["init_command", "starters"]


@click.command("init")
@click.argument("name", required=False)
@click.option("--out", type=click.Path(path_type=Path), help="File to write; default NAME.yaml.")
@click.option("--force", is_flag=True, help="Overwrite the file.")
@click.pass_context
def init_command(context: click.Context, name: str | None, out: Path | None, force: bool) -> None:
    """Write a commented starter config; without NAME, list them."""
    texts = starters(plugins_of(context))
    if name is None:
        if out is not None or force:
            option = "--force" if out is None else f"--out {out}"
            raise ConfigError(f"{option} needs the NAME of a starter config: {', '.join(texts) or 'none is installed'}")
        for key, text in texts.items():
            click.echo(f"{key:<12}{_first_comment(text)}")
        return
    if name not in texts:
        raise ConfigError(f"no starter config '{name}'; available: {', '.join(texts) or 'none'}")
    path = out or Path(f"{name}.yaml")
    if path.exists() and not force:
        raise ConfigError(f"{path} exists already; choose another with --out, or overwrite it with --force")
    path.write_text(texts[name], encoding="utf-8")
    for question in _questions(texts[name]):
        click.echo(question)
    renamed = "" if path.name == f"{name}.yaml" else f" (write {path.name} for {name}.yaml there)"
    click.echo(f"wrote {path}; its first lines say what it is for, and which commands to give{renamed}")


def starters(plugins: Plugins) -> dict[str, str]:
    """Return the text of every starter, by name."""
    packages = dict.fromkeys(record.module.partition(":")[0].partition(".")[0] for record in plugins.records)
    found: dict[str, str] = {}
    for package in packages:
        try:
            folder: Traversable = files(package).joinpath("starters")
        except (ImportError, TypeError):  # a broken plugin, or one that is a single file
            continue
        if folder.is_dir():
            for entry in folder.iterdir():
                if entry.name.endswith(".yaml"):
                    found.setdefault(entry.name.removesuffix(".yaml"), entry.read_text(encoding="utf-8"))
    return dict(sorted(found.items()))


def _first_comment(text: str) -> str:
    first = text.partition("\n")[0]
    return first.removeprefix("#").strip() if first.startswith("#") else ""


def _questions(text: str) -> list[str]:
    """Return what a starter asks the reader: its comments that begin with a question mark."""
    lines = (line.strip() for line in text.splitlines())
    return [line.removeprefix("# ?").strip() for line in lines if line.startswith("# ?")]
