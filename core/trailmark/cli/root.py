"""The root command: what is in the box, imported on use."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from stat import S_ISFIFO
from typing import TYPE_CHECKING

import click

from trailmark import __version__

if TYPE_CHECKING:
    from trailmark.plugins import Plugins

__all__ = [
    "ChosenPlugins",
    "command_of_plugin",
    "plugin_options",
    "plugins_of",
    "refuse_named_pipes",
    "root",
    "split_plugin_options",
]

_COMMANDS = {
    "demo": ("trailmark.cli.demo:demo_command", "The whole story in a minute: teach, replay, report (simulated)."),
    "run": ("trailmark.cli.run:run_command", "Run a pipeline over a recording, a camera or a simulated world."),
    "teach": ("trailmark.cli.run:teach_command", "Drive or play a path and remember it."),
    "replay": ("trailmark.cli.run:replay_command", "Follow a taught path."),
    "inspect": ("trailmark.cli.inspect:inspect_command", "Look at a source: sensors, rates, first frames."),
    "record": ("trailmark.cli.record:record_command", "Write any source to disk as a data set."),
    "init": ("trailmark.cli.init:init_command", "Write a commented starter config."),
    "reproduce": ("trailmark.cli.reproduce:reproduce_command", "Repeat a paper's experiments: paper and ours."),
    "watch": ("trailmark.cli.watch:watch_command", "Watch a run or a bench while it goes on."),
    "report": ("trailmark.cli.report:report_command", "Make metrics, plots and report of a run's folder anew."),
    "compare": ("trailmark.cli.compare:compare_command", "Compare runs, or the localizers of one run."),
    "evaluate": ("trailmark.cli.evaluate:evaluate_command", "Metrics for trajectories of any program."),
    "store": ("trailmark.cli.store:store_group", "Look into a path store."),
    "plugins": ("trailmark.cli.plugins:plugins_group", "What is installed, what is broken and how to mend it."),
    "schema": ("trailmark.cli.schema:schema_command", "Print the JSON schema of configs, for editors."),
    "doctor": ("trailmark.cli.doctor:doctor_command", "Check this installation."),
}


@dataclass(frozen=True, slots=True)
class ChosenPlugins:
    """What ``--plugin`` said: names to block, files to load.

    Attributes
    ----------
    block : tuple of str
        Names that no plugin may load under.
    files : tuple of str
        Python files to load as plugins.
    """

    block: tuple[str, ...] = ()
    files: tuple[str, ...] = ()


def split_plugin_options(arguments: Sequence[str]) -> tuple[ChosenPlugins, list[str]]:
    """Take ``--plugin X`` out of the arguments, wherever it stands, so that it means the same everywhere."""
    block: list[str] = []
    files: list[str] = []
    rest: list[str] = []
    waiting = iter(arguments)
    for argument in waiting:
        if argument == "--":
            rest.extend([argument, *waiting])
        elif argument == "--plugin" or argument.startswith("--plugin="):
            _, _, inline = argument.partition("=")
            value = inline or next(waiting, "")
            _sort_choice(value, block, files)
        else:
            rest.append(argument)
    return ChosenPlugins(tuple(block), tuple(files)), rest


def refuse_named_pipes(arguments: Sequence[str]) -> None:
    """Refuse a named pipe where a file is meant: opening one blocks until another program writes into it.

    What the shell has opened already (``/dev/stdin``, ``<(...)``) is not waited for: the command decides.

    Raises
    ------
    ConfigError
        Naming it.
    """
    from trailmark.errors import ConfigError

    for argument in arguments:
        name = argument.partition("=")[2] if argument.startswith("--") else argument
        is_pipe = False
        with suppress(OSError, ValueError):  # no path at all, or none that can be
            is_pipe = S_ISFIFO(os.stat(name).st_mode)
        if is_pipe and not name.startswith(("/dev/", "/proc/")):
            raise ConfigError(f"{name} is a named pipe, not a file: write what comes out of it to a file first")


def _sort_choice(value: str, block: list[str], files: list[str]) -> None:
    if value.startswith("no:") and len(value) > 3:
        block.append(value[3:])
    elif value.endswith(".py"):
        files.append(value)
    else:
        raise click.UsageError(f"--plugin takes no:NAME or a file ./my_plugin.py, not {value!r}")


def plugins_of(context: click.Context) -> Plugins:
    """Return the plugins for this call; broken ones are named once on standard error.

    The commands that list plugins name the broken ones themselves.
    """
    from trailmark.plugins import load_plugins

    root_context = context.find_root()
    plugins: Plugins | None = root_context.meta.get("trailmark.plugins")
    if plugins is None:
        chosen: ChosenPlugins = root_context.obj or ChosenPlugins()
        plugins = load_plugins(block=chosen.block, files=chosen.files)
        root_context.meta["trailmark.plugins"] = plugins
        if root_context.invoked_subcommand != "plugins":
            for record in plugins.failed:
                click.echo(f"trailmark: warning: {record.warning()}", err=True)
    return plugins


def plugin_options(context: click.Context) -> list[str]:
    """Return the options that let another call use the same plugins as this one."""
    chosen: ChosenPlugins = context.find_root().obj or ChosenPlugins()
    values = [*(f"no:{name}" for name in chosen.block), *chosen.files]
    return [word for value in values for word in ("--plugin", value)]


class _LazyGroup(click.Group):
    """A group whose commands are import strings, and that asks the plugins for theirs."""

    def list_commands(self, context: click.Context) -> list[str]:
        return [*_COMMANDS, *sorted(_plugin_commands(context))]

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        if name in _COMMANDS:
            module, _, attribute = _COMMANDS[name][0].partition(":")
            command: click.Command = getattr(import_module(module), attribute)
            return command
        return _plugin_commands(context).get(name)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        rows = [(name, summary) for name, (_, summary) in _COMMANDS.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)
        theirs = _plugin_commands(context)
        if theirs:
            with formatter.section("Commands of plugins"):
                formatter.write_dl([(name, theirs[name].get_short_help_str(80)) for name in sorted(theirs)])

    def resolve_command(
        self, context: click.Context, arguments: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = arguments[0]
        if self.get_command(context, name) is None and not name.startswith("-"):
            from difflib import get_close_matches

            close = get_close_matches(name, self.list_commands(context), n=1)
            hint = f" Did you mean '{close[0]}'?" if close else " 'trailmark --help' lists the commands."
            raise click.UsageError(f"no command '{name}'.{_absent_hint(context, name) or hint}")
        return super().resolve_command(context, arguments)


def _plugin_commands(context: click.Context) -> dict[str, click.Command]:
    commands: dict[str, click.Command] | None = context.meta.get("trailmark.plugin_commands")
    if commands is None:
        group = click.Group(commands={"calibrate": _calibrate_group()})
        plugins_of(context).call_isolated("trailmark_commands", group=group)
        commands = {
            name: command
            for name, command in group.commands.items()
            if name not in _COMMANDS and not (isinstance(command, click.Group) and not command.commands)
        }
        context.meta["trailmark.plugin_commands"] = commands
    return commands


def command_of_plugin(context: click.Context, name: str, subcommand: str) -> click.Command:
    """Return a command that a plugin brings, such as ``bench watch``: core hands over to it what is not core's.

    Raises
    ------
    ConfigError
        If no plugin brings it; the message says whether one would that is blocked.
    """
    from trailmark.errors import ConfigError

    group = _plugin_commands(context).get(name)
    command = group.get_command(context, subcommand) if isinstance(group, click.Group) else None
    if command is None:
        raise ConfigError(f"no plugin brings 'trailmark {name} {subcommand}'.{_absent_hint(context, name)}")
    return command


def _absent_hint(context: click.Context, name: str) -> str:
    """Return what there is to say of a plugin that is installed, has the name of a command and may not be used."""
    absent = [record for record in plugins_of(context).records if record.name == name and record.status != "ok"]
    words = {"blocked": "is blocked", "disabled": "is not on the list of plugins that may load"}
    return "".join(f" {record.origin} {words.get(record.status, 'did not load')}." for record in absent)


def _calibrate_group() -> click.Group:
    """Return the group that plugins share: each adds the sensor it can calibrate."""
    return click.Group("calibrate", help="Measure what a sensor needs to know about itself, with uncertainty.")


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="trailmark")
@click.option(
    "--plugin", "_plugin", multiple=True, metavar="no:NAME|FILE.py", help="Block a plugin, or load a one-file plugin."
)
def root(_plugin: tuple[str, ...]) -> None:
    """Trailmark tells a mobile robot where it is, with whatever sensor it has."""
