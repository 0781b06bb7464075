"""``trailmark plugins``: what is installed, what a part's config takes, what is broken and how to mend it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.cli.root import plugins_of
from trailmark.errors import UnknownPluginError
from trailmark.plugins.hints import did_you_mean, nearest_or_all
from trailmark.plugins.registry import NO_PLUGINS

if TYPE_CHECKING:
    from rich.table import Table

    from trailmark.config.describe import KeyInfo
    from trailmark.plugins import PluginRecord, Plugins, Spec
    from trailmark.plugins.doctor import Finding

__all__ = ["plugins_group"]

_AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.group("plugins", invoke_without_command=True)
@_AS_JSON
@click.pass_context
def plugins_group(context: click.Context, as_json: bool) -> None:
    """Show what is installed, what a part's config takes, and what is broken."""
    if context.invoked_subcommand is None:
        context.invoke(list_command, as_json=as_json)


@plugins_group.command("list")
@_AS_JSON
@click.pass_context
def list_command(context: click.Context, as_json: bool) -> None:
    """List the parts that configs can name, and plugins that did not load."""
    plugins = plugins_of(context)
    if as_json:
        _print_json([_record_document(record) for record in plugins.records])
    elif not plugins.records:
        click.echo(NO_PLUGINS)
    else:
        _print_parts(plugins)
        _print_absent(plugins)


@plugins_group.command("show")
@click.argument("name")
@_AS_JSON
@click.pass_context
def show_command(context: click.Context, name: str, as_json: bool) -> None:
    """Show the keys, types, defaults and descriptions of the part NAME (or distribution:NAME)."""
    specs = _specs_called(plugins_of(context), name)
    from trailmark.config.describe import describe_part

    described = [(spec, describe_part(spec)) for spec in specs]
    if as_json:
        _print_json([_spec_document(spec) | {"keys": [asdict(key) for key in keys]} for spec, keys in described])
        return
    for number, (spec, keys) in enumerate(described):
        click.echo("\n" if number else "", nl=False)
        _print_spec(spec, keys)


@plugins_group.command("doctor")
@click.option("--deep", is_flag=True, help="Import every class too: slow, but finds what only a run would find.")
@_AS_JSON
@click.pass_context
def doctor_command(context: click.Context, deep: bool, as_json: bool) -> None:
    """Say what is wrong with the plugins, with tracebacks, and how to mend it."""
    from trailmark.plugins.doctor import examine

    plugins = plugins_of(context)
    findings = examine(plugins, deep=deep)
    if as_json:
        _print_json([asdict(finding) for finding in findings])
        return
    for finding in findings:
        _print_finding(finding)
    loaded = sum(record.status == "ok" for record in plugins.records)
    errors = sum(finding.severity == "error" for finding in findings)
    warnings = len(findings) - errors
    click.echo(
        f"{loaded} of {len(plugins.records)} plugins loaded; {_count(errors, 'error')}, {_count(warnings, 'warning')}"
    )


@plugins_group.command("new")
@click.argument("name")
@click.option("--localizer", "parts", flag_value="localizer", multiple=True, help="With a localizer (the default).")
@click.option("--camera", "parts", flag_value="camera", multiple=True, help="With a localizer that looks at pictures.")
@click.option("--places", "parts", flag_value="places", multiple=True, help="With a localizer that keeps a map.")
@click.option("--source", "parts", flag_value="source", multiple=True, help="With a frame source.")
@click.option("--robot", "parts", flag_value="robot", multiple=True, help="With a robot that can be driven.")
@click.option("--dataset", "parts", flag_value="dataset", multiple=True, help="With a data set that inspect knows.")
@click.option("--controller", "parts", flag_value="controller", multiple=True, help="With a controller.")
@click.option("--sink", "parts", flag_value="sink", multiple=True, help="With a sink.")
@click.option("--metric", "parts", flag_value="metric", multiple=True, help="With a metric.")
@click.option("--into", type=click.Path(path_type=Path), default=Path(), help="Folder that gets the new one.")
def new_command(name: str, parts: Sequence[str], into: Path) -> None:
    """Write a plugin NAME to begin with: a distribution that installs and passes its own tests."""
    from trailmark.scaffold import write_distribution

    folder = write_distribution(name, tuple(dict.fromkeys(parts)) or ("localizer",), into)
    click.echo(f"wrote {folder}; now:")
    click.echo(f"  pip install -e {folder}")
    click.echo(f"  pytest {folder}")
    click.echo(f"  trailmark plugins show {name}")


def _specs_called(plugins: Plugins, name: str) -> list[Spec]:
    distribution, _, bare = name.rpartition(":")
    specs = plugins.registry.specs()
    found = [spec for spec in specs if spec.name == bare and distribution in ("", spec.distribution)]
    if not found:
        for record in plugins.records:
            if record.is_called(name) and record.specs:
                return list(record.specs)
        parts = [spec for spec in specs if spec.kind not in ("metric", "experiment", "dataset", "executor")]
        names = sorted({spec.name for spec in parts})
        hint = did_you_mean(bare, names) or _about(bare, parts) or nearest_or_all(bare, names, "installed")
        raise UnknownPluginError(f"no part or plugin is called {name!r}{hint}. 'trailmark plugins' lists all")
    return found


def _about(name: str, specs: Sequence[Spec]) -> str:
    """Return up to three parts that are about what was asked for, as a hint; empty where none is."""
    words = {word for word in re.split(r"[^a-z0-9]+|_", name.lower()) if len(word) > 2}
    texts = {spec.name: f"{spec.name} {spec.summary}".lower() for spec in specs}
    about = [name for name, text in texts.items() if words & set(re.findall("[a-z0-9]+", text))]
    return f"; about that: {', '.join(about[:3])}" if about else ""


def _print_parts(plugins: Plugins) -> None:
    table = _table("kind", "name", "what it is", "plugin")
    previous = ""
    for spec in plugins.registry.specs():
        kind = "" if spec.kind == previous else spec.kind
        previous = spec.kind
        summary = spec.summary + (f" [dim](extra {spec.extra})[/]" if spec.extra else "")
        table.add_row(kind, f"[bold]{spec.name}[/]", summary, _whose(spec.entry_point, spec.distribution, spec.version))
    _print_table(table)


def _print_absent(plugins: Plugins) -> None:
    for record in plugins.records:
        if record.status == "failed":
            click.echo(f"broken: {record.origin}: {record.error}")
        elif record.status == "blocked":
            click.echo(f"blocked: {record.origin}")
        elif record.status == "disabled":
            click.echo(f"not on the list TRAILMARK_PLUGINS: {record.origin}")
    if plugins.failed:
        click.echo("'trailmark plugins doctor' shows the tracebacks and what to do.")


def _print_spec(spec: Spec, keys: Sequence[KeyInfo]) -> None:
    click.echo(f"{spec.kind} {spec.name}  {spec.summary}")
    if spec.reference:
        click.echo(f"  follows {spec.reference}")
    click.echo(f"  {spec.origin}, {spec.target}")
    if spec.extra:
        click.echo(f"  needs {spec.pip_line}")
    if not keys:
        click.echo("  It has no keys.")
        return
    table = _table("key", "type", "default", "meaning")
    for key in keys:
        default = "[bold]required[/]" if key.is_required else _escape_markup(_default_as_text(key.default))
        name = f"[dim]{key.key}[/]" if key.is_shared else f"[bold]{key.key}[/]"
        table.add_row(name, _escape_markup(key.type), default, _escape_markup(key.description))
    _print_table(table)


def _print_finding(finding: Finding) -> None:
    click.secho(
        f"{finding.severity}: {finding.subject}", bold=True, fg="red" if finding.severity == "error" else "yellow"
    )
    click.echo(f"  {finding.message}")
    click.echo(f"  -> {finding.remedy}")
    for line in finding.traceback.rstrip().splitlines():
        click.echo(f"  | {line}")


def _record_document(record: PluginRecord) -> dict[str, Any]:
    return {
        "name": record.name,
        "distribution": record.distribution,
        "version": record.version,
        "status": record.status,
        "error": record.error,
        "hooks": list(record.hooks),
        "parts": [_spec_document(spec) for spec in record.specs],
        "import_ms": round(record.import_ms, 3),
    }


def _spec_document(spec: Spec) -> dict[str, Any]:
    return asdict(spec) | {"gives": sorted(spec.gives)}


def _print_json(document: Any) -> None:
    click.echo(json.dumps(document, indent=1, ensure_ascii=False))


def _whose(entry_point: str, distribution: str, version: str) -> str:
    return f"[dim]{entry_point} ({f'{distribution} {version}'.strip()})[/]"


def _default_as_text(default: Any) -> str:
    return "" if default is None else default if isinstance(default, str) else json.dumps(default)


def _escape_markup(text: str) -> str:
    from rich.markup import escape

    return escape(text)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _table(*columns: str) -> Table:
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, no_wrap=number == 1 and column == "name", overflow="fold")
    return table


def _print_table(table: Table) -> None:
    from trailmark.report.terminal import TerminalConsole

    console = TerminalConsole(highlight=False)
    if not console.is_terminal:  # a pipe has no width: keep rows whole
        console = TerminalConsole(highlight=False, width=200)
    console.print(table)
