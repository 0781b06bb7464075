"""A new plugin as a distribution of its own, from templates: it installs and passes its own tests at once."""

from __future__ import annotations

import keyword
import re
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

import trailmark
from trailmark.errors import ConfigError

__all__ = ["PARTS", "write_distribution"]

#: Kinds of part that there is a template for, and what its example does.
PARTS = {
    "localizer": "motion from wheel odometry",
    "camera": "motion from a forward camera",
    "places": "the way along a taught path, from the laser scans in its map",
    "source": "a number over time, from a file",
    "robot": "a base behind a serial line, which can be driven",
    "dataset": "recordings of wheels and a laser, which inspect knows by their names",
    "controller": "pure pursuit of the taught path",
    "sink": "believed poses as a CSV file",
    "metric": "how jerky a trajectory is",
}

#: Parts that are of another kind than they are called.
_KINDS = {"camera": "localizer", "places": "localizer", "robot": "source", "dataset": "source"}

#: What the localizers may say.
_GIVES = {"localizer": "motion", "camera": "motion", "places": "path_offset"}

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")

#: Words that mean something else where a name stands: in configs (of YAML 1.1, too), and as files on Windows.
_YAML_WORDS = frozenset(("null", "none", "true", "false", "yes", "no", "on", "off", "y", "n"))
_DEVICE = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9]")


def write_distribution(name: str, parts: Sequence[str], into: Path) -> Path:
    """Write a distribution ``trailmark-NAME`` with an example of each part, and return its folder.

    Parameters
    ----------
    name : str
        Lower-case words with underscores: what configs call its parts, and the end of the package's name.
    parts : sequence of str
        Of `PARTS`.
    into : Path
        The folder that gets the new one.

    Raises
    ------
    ConfigError
        If the name is none, means something else to Python or a config, or is taken, or the folder is there already
        or cannot be written.
    """
    if not _NAME.fullmatch(name):
        hint = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_").lstrip("0123456789_")
        raise ConfigError(
            f"{name!r} is no name for a plugin: use lower-case letters, digits and single underscores, a letter first"
            + (f", such as {hint!r}" if hint and hint != name else "")
        )
    if meaning := _other_meaning(name):
        raise ConfigError(f"{name!r} is no name for a plugin: it is {meaning}; use another, such as 'my_{name}'")
    words = _words(name, parts)
    if find_spec(words["package"]) is not None:
        raise ConfigError(
            f"{name!r} is taken: the package {words['package']} is installed already, and the new one would take its"
            " place; choose another name, or uninstall it first"
        )
    folder = into / words["distribution"]
    package = f"src/{words['package']}"
    texts = {
        "pyproject.toml": "pyproject.toml",
        "README.md": "README.md",
        ".github/workflows/tests.yml": "ci.yml",
        f"{package}/plugin.py": "plugin.py",
    }
    for part in parts:
        texts |= {f"{package}/{part}.py": f"{part}.py", f"tests/test_{part}.py": f"test_{part}.py"}
        if part != "metric":
            texts[f"{package}/{part}_config.py"] = f"{part}_config.py"
    contents = {path: _fill_in_words(template, words) for path, template in texts.items()}
    contents |= {f"{package}/__init__.py": f'"""Trailmark plugin: {words["title"]}."""\n', f"{package}/py.typed": ""}
    contents[".gitignore"] = "__pycache__/\n.venv/\n*.egg-info/\ndist/\n"
    _write(folder, contents)
    return folder


def _other_meaning(name: str) -> str:
    """Return what a name is taken for where it is read; empty: for a name."""
    if keyword.iskeyword(name):
        return "a word of Python"
    if name in _YAML_WORDS:
        return "a value in configs, not a word"
    return "a device on Windows" if _DEVICE.fullmatch(name) else ""


def _words(name: str, parts: Sequence[str]) -> dict[str, str]:
    class_name = "".join(word.capitalize() for word in name.split("_"))
    words = {
        "name": name,
        "distribution": f"trailmark-{name.replace('_', '-')}",
        "package": f"trailmark_{name}",
        "class_name": class_name,
        "title": ", ".join(PARTS[part] for part in parts),
        "version": ".".join(trailmark.__version__.split(".")[:2]),
    }
    words |= {f"{part}_name": own for part, own in _names_of_parts(name, parts).items()}
    words["registrations"] = "\n".join(_registration(part, words) for part in parts)
    words["parts"] = "\n".join(f"- {part} `{words[f'{part}_name']}`: {PARTS[part]}" for part in parts)
    return words


def _names_of_parts(name: str, parts: Sequence[str]) -> dict[str, str]:
    """Return what configs call each part: two of one kind need two names, and the first keeps the plugin's."""
    names: dict[str, str] = {}
    taken: set[str] = set()
    for part in PARTS:
        kind = _KINDS.get(part, part)
        if part in parts:
            names[part] = f"{name}_{part}" if kind in taken else name
            taken.add(kind)
    return names


def _registration(part: str, words: dict[str, str]) -> str:
    module, class_name = f"{words['package']}.{part}", words["class_name"]
    suffix = "" if part == "localizer" else part.capitalize()
    target = words["name"] if part == "metric" else f"{class_name}{suffix}"
    kind = _KINDS.get(part, part)
    lines = [f"registry.{kind}(", f'    "{words[f"{part}_name"]}",', f'    "{module}:{target}",']
    if part != "metric":
        lines.append(f'    config="{module}_config:{class_name}{suffix}Config",')
    lines.append(f'    summary="{PARTS[part].capitalize()}",')
    if kind == "localizer":
        lines.append(f'    gives=("{_GIVES[part]}",),')
    if part == "dataset":
        lines.append(f'    opens=("*.{words["name"]}",),  # what inspect, run and teach know by its name')
    return textwrap.indent("\n".join([*lines, ")"]), "    ")


def _fill_in_words(template: str, words: dict[str, str]) -> str:
    text = files("trailmark.scaffold").joinpath("templates", f"{template}.txt").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def _write(folder: Path, contents: dict[str, str]) -> None:
    if folder.exists():
        raise ConfigError(f"{folder} is there already; choose another name, or another folder with --into")
    try:
        for path, text in contents.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {error.filename or folder}: {error.strerror}") from error
