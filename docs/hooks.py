"""Pages that the manual makes of the program: every key, every command, every public name, the cards of the plugins."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).parents[1]
CARDS = (
    *("ground_vo", "omni_surf", "kinect_landmarks", "divs", "controllers", "sim", "datasets", "baselines"),
    *("landmarks", "laser_maps", "calibration", "papers", "bench", "faults", "viewers", "ros2", "lines"),
)
#: Pages of the Python reference: the module that each is about, or several that are small.
ROOMS: Mapping[str, tuple[str, ...]] = {
    **{
        room: (f"trailmark.{room}",)
        for room in (
            *("interfaces", "estimates", "frames", "paths", "geometry", "commands", "config", "plugins", "testing"),
            *("evaluation", "pipeline", "sources", "stores", "estimation", "report", "recording", "isolation"),
            *("metrics", "datasets", "experiments", "errors"),
        )
    },
    "trailmark": ("trailmark",),
    "tools": tuple(
        f"trailmark.{name}"
        for name in (
            "arrays",
            "clock",
            "deprecation",
            "failures",
            "interruption",
            "kernels",
            "patches",
            "ranges",
            "systematic",
            "values",
            "worker",
            "writing",
        )
    ),
}

_CARD_LINK = re.compile(r"\]\(((?:\.\./)*)\.\./plugins/(\w+)/README\.md")
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages to those of the folder; what is no page stays out."""
    from mkdocs.structure.files import File

    for path, text in pages():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Lead links to cards, which readers of the repository follow to their folders, to the pages that hold them."""
    return _CARD_LINK.sub(r"](\1methods/\2.md", markdown)


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and text of every generated page."""
    yield "reference/config.md", config_reference()
    yield "reference/cli.md", cli_reference()
    for room, modules in ROOMS.items():
        yield f"reference/python/{room}.md", python_reference(room, modules)
    yield "reference/python/methods.md", python_reference("Plugins", [f"trailmark_{name}" for name in CARDS])
    yield "changelog.md", _card(REPOSITORY / "CHANGELOG.md", "changelog.md")
    for name in CARDS:
        page = f"methods/{name}.md"
        yield page, _card(REPOSITORY / "plugins" / name / "README.md", page)


def config_reference() -> str:
    """Return every part with its keys, as `trailmark plugins show` prints them."""
    from trailmark.config.describe import describe_part
    from trailmark.plugins import load_plugins

    lines = ["# Config reference", "", "Every part that a config can name, with its keys. Units are in brackets.", ""]
    kind = ""
    for spec in load_plugins().registry.specs():
        if spec.distribution != "trailmark" or spec.kind in ("metric", "experiment"):
            continue
        if spec.kind != kind:
            kind = spec.kind
            lines += [f"## {kind.replace('_', ' ').capitalize()}s", ""]
        lines += [f"### {spec.name}", "", f"{spec.summary}.", ""]
        if spec.reference:
            lines += [f"After {spec.reference}.", ""]
        keys = describe_part(spec)
        if keys:
            lines += ["| key | type | default | meaning |", "|---|---|---|---|"]
            lines += [
                f"| `{key.key}` | {_cell(key.type)} | {_default(key)} | {_cell(key.description)} |" for key in keys
            ]
            lines.append("")
    return "\n".join(lines)


def _default(key: Any) -> str:
    if key.is_required:
        return "**required**"
    return "" if key.default is None else f"`{_cell(str(key.default))}`"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def cli_reference() -> str:
    """Return the help of every command."""
    from trailmark.cli.root import root

    lines = ["# Command line reference", "", "`trailmark --plugin ...` comes before the command.", ""]
    for words, text in _helps(root, ("trailmark",)):
        lines += [f"{'#' * min(1 + len(words), 4)} {' '.join(words)}", "", "```text", text, "```", ""]
    return "\n".join(lines)


def _helps(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    import click

    context = click.Context(command, info_name=" ".join(words), terminal_width=100, max_content_width=100)
    if len(words) > 1:
        yield words, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            if found is not None and not found.hidden:
                yield from _helps(found, (*words, name))


def python_reference(title: str, modules: Sequence[str]) -> str:
    """Return a page about the public names of modules; `mkdocstrings` puts their docstrings in.

    A name is public when its module lists it. Of a plugin's package these are its parts, which import nothing heavy.
    """
    heading = title if len(modules) > 1 else modules[0]
    lines = [f"# {heading[0].upper()}{heading[1:]}" if len(modules) > 1 else f"# {heading}", ""]
    for module in modules:
        names = sorted(getattr(import_module(module), "__all__", ()), key=str.lower)
        if not names:
            continue
        if len(modules) > 1:
            lines += [f"## {module}", ""]
        docstring = " ".join((import_module(module).__doc__ or "").strip().partition("\n\n")[0].split())
        lines += [docstring, ""]
        for name in names:
            lines += [
                f"::: {module}.{name}",
                "    options:",
                f"      heading_level: {2 if len(modules) == 1 else 3}",
                "",
            ]
    return "\n".join(lines)


def on_page_content(html: str, page: Any, config: Any, files: Any) -> str:
    """Let a docstring's ``::``, which announces code, be a colon."""
    return html.replace("::</p>", ":</p>") if page.file.src_uri.startswith("reference/python/") else html


def _card(source: Path, page: str) -> str:
    """Return a file of the repository as a page; links to what the manual does not hold become plain words."""

    def moved(found: re.Match[str]) -> str:
        picture, text, target = found.groups()
        target, _, anchor = target.partition("#")
        full = (source.parent / target).resolve()
        docs = REPOSITORY / "docs"
        if full.is_relative_to(docs):
            inside = posixpath.relpath(full.relative_to(docs).as_posix(), posixpath.dirname(page) or ".")
            return f"{picture}[{text}]({inside}{'#' + anchor if anchor else ''})"
        return "" if picture else f"{text}"

    return _LINK.sub(moved, source.read_text(encoding="utf-8"))
