"""Arguments from the program's own tree of commands."""

from __future__ import annotations

from collections.abc import Iterator

import click
import numpy as np

from trailmark.cli.root import ChosenPlugins, root

__all__ = ["commands", "grown_arguments"]

Rng = np.random.Generator

# What takes minutes, waits for a person, or needs other machines.
_LONG = {"demo", "reproduce", "bench run", "plugins doctor", "sim statistics", "omni train", "sim render", "sim record"}
_TEXTS = (
    "",
    "x",
    "wheels",
    "floor",
    "seed=1",
    "a.b.c=",
    "=",
    "localizers.floor.plugin=klt",
    "sources=null",
    "..",
    "\x00",
    "-",
    "é" * 200,
)
_NUMBERS = ("0", "1", "-1", "nan", "inf", "1e9", "3", "0.5", "", "x", "99999999999999999999", "1e400")


def commands() -> dict[str, click.Command]:
    """Return every command that ends by itself soon, by its words."""
    context = click.Context(root, obj=ChosenPlugins())
    return {words: command for words, command in _walk(root, (), context) if words not in _LONG}


def _walk(
    command: click.Command, words: tuple[str, ...], context: click.Context
) -> Iterator[tuple[str, click.Command]]:
    if not isinstance(command, click.Group):
        yield " ".join(words), command
        return
    for name in command.list_commands(context):
        inner = command.get_command(context, name)
        if inner is not None:
            yield from _walk(inner, (*words, name), context)


def grown_arguments(words: str, command: click.Command, files: tuple[str, ...], rng: Rng) -> list[str]:
    """Return a call of a command: most of what it needs, some options, and values that may be wrong."""
    arguments = words.split()
    for parameter in command.params:
        is_argument = isinstance(parameter, click.Argument)
        if not is_argument and rng.random() > (0.85 if parameter.required else 0.2):
            continue
        if is_argument and rng.random() < 0.03:
            continue
        n = int(rng.integers(1, 4)) if parameter.nargs == -1 or parameter.multiple else 1
        for _ in range(n):
            value = _value(parameter, files, rng)
            if is_argument:
                arguments.append(value)
            elif getattr(parameter, "is_flag", False):
                arguments.append(parameter.opts[0])
            else:
                arguments += [str(rng.choice(parameter.opts)), value]
    if words.endswith("watch") and "--once" not in arguments:
        arguments.append("--once")
    if rng.random() < 0.05:
        arguments.insert(
            int(rng.integers(len(arguments) + 1)), str(rng.choice(["--", "-h", "--plugin", "no:sim", "--x", "-"]))
        )
    return arguments


def _value(parameter: click.Parameter, files: tuple[str, ...], rng: Rng) -> str:
    kind = parameter.type
    if isinstance(kind, click.Choice) and rng.random() < 0.9:
        return str(rng.choice(list(kind.choices)))
    is_number = isinstance(kind, click.types.IntParamType | click.types.FloatParamType)
    if is_number and rng.random() < 0.95:
        return str(rng.choice(_NUMBERS))
    if isinstance(parameter, click.Argument) or isinstance(kind, click.Path):
        return str(rng.choice([*files, "new", "new/deep", "nowhere.yaml", ".", "", "out.trail"]))
    return str(rng.choice([*_TEXTS, *files]))
