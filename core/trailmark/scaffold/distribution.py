"""A new plugin as a distribution of its own, from templates: it installs and passes its own tests at once."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

import trailmark
from trailmark.errors import ConfigError

__all__ = ["PARTS", "write_distribution"]

#: Kinds of part that there is a template for, and what its example does.
PARTS = {
    "localizer": "motion from wheel odometry",
    "source": "a number over time, from a file",
    "robot": "a base behind a serial line, which can be driven",
    "controller": "pure pursuit of the taught path",
    "sink": "believed poses as a CSV file",
    "metric": "how jerky a trajectory is",
}

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")


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
        If the name is none, or the folder is there already or cannot be written.
    """
    if not _NAME.fullmatch(name):
        hint = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_").lstrip("0123456789_")
        raise ConfigError(
            f"{name!r} is no name for a plugin: use lower-case letters, digits and single underscores, a letter first"
            + (f", such as {hint!r}" if hint and hint != name else "")
        )
    words = _words(name, parts)
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
    words["robot_name"] = f"{name}_robot" if "source" in parts else name  # both are sources
    words["registrations"] = "\n".join(_registration(part, words) for part in parts)
    words["parts"] = "\n".join(f"- {part} `{_fill_in_path(part, words)}`: {PARTS[part]}" for part in parts)
    return words


def _registration(part: str, words: dict[str, str]) -> str:
    module, class_name = f"{words['package']}.{part}", words["class_name"]
    suffix = "" if part == "localizer" else part.capitalize()
    target = words["name"] if part == "metric" else f"{class_name}{suffix}"
    kind = "source" if part == "robot" else part
    lines = [f"registry.{kind}(", f'    "{_fill_in_path(part, words)}",', f'    "{module}:{target}",']
    if part != "metric":
        lines.append(f'    config="{module}_config:{class_name}{suffix}Config",')
    lines.append(f'    summary="{PARTS[part].capitalize()}",')
    if part == "localizer":
        lines.append('    gives=("motion",),')
    return textwrap.indent("\n".join([*lines, ")"]), "    ")


def _fill_in_path(part: str, words: dict[str, str]) -> str:
    return words["robot_name" if part == "robot" else "name"]


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
