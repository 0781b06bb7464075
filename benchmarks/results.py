"""The pages of results: which are older than their code, and the recipe that makes them anew.

In a page under ``docs/results`` what a program prints stands between two comments; the prose around it is ours::

    <!-- made by: python benchmarks/landmarks.py --markdown -->
    ...
    <!-- made: end -->

``{out}`` in a command is a folder of its own under ``runs/results``, which stays: a program that goes on where it was
does so there. ``<!-- made by: COMMAND -> FILE PICTURES... -->`` takes a file of that folder instead of what was
printed, and copies pictures from it beside the page, with the page's name before theirs. Commands are joined by ``&&``.

    python benchmarks/results.py                    # what is older than its code, and how long it takes
    python benchmarks/results.py make               # makes that anew, the quickest first; ends and goes on any time
    python benchmarks/results.py make --hours 2 liars landmarks
    python benchmarks/results.py check --strict     # fails where a page is older than its code

Which code a page depends on is not written down by hand: while a command runs, every file of this checkout that it or
a child of it reads is noted. ``docs/results/made.json`` keeps the fingerprint of each folder of them, without comments,
docstrings and layout, so that better words make no page old.
"""

from __future__ import annotations

import argparse
import ast
import datetime as dt
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
_BLOCK = re.compile(r"<!-- made by: (?P<command>.+?) -->\n(?P<text>.*?)<!-- made: end -->", re.DOTALL)
_CODE = (".py", ".yaml", ".yml", ".toml", ".csv", ".npz")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_ROOMS = ("core", "plugins", "examples")
#: Read of every plugin that is installed, whether a program uses it or not.
_DOORS = ("__init__.py", "plugin.py")
#: Time to keep for a page of which nobody knows how long it takes [h].
_UNKNOWN_H = 0.5
#: The papers in five places with two jobs, where they were never made so: reckoned from their short versions and from
#: their pages of one place, not measured [min].
_RECKONED_MIN = {"nagai2015": 80.0, "tasaki2010": 90.0, "toth2015": 40.0, "perroni2014": 60.0}


@dataclass(frozen=True)
class Block:
    """A part of a page that a program prints."""

    page: Path
    index: int
    command: str

    @property
    def name(self) -> str:
        """Page and number, as ``liars`` or ``fusion-2``."""
        return self.page.stem + (f"-{self.index + 1}" if self.index else "")


@dataclass(frozen=True)
class Made:
    """How a block was made: by which command, when, at which commit, from what code."""

    command: str
    commit: str
    date: str
    minutes: float
    code: Mapping[str, str] = field(default_factory=dict)


class Results:
    """The pages of a checkout.

    Parameters
    ----------
    top : Path
        The checkout; its pages are under ``docs/results``.
    """

    def __init__(self, top: Path) -> None:
        self._top = top
        self._folder = top / "docs" / "results"
        self._noted = self._folder / "made.json"
        self._fingerprints: dict[str, str] = {}

    def blocks(self) -> list[Block]:
        """Return the blocks of all pages, by page."""
        return [
            Block(page, index, found["command"])
            for page in sorted(self._folder.glob("*.md"))
            for index, found in enumerate(_BLOCK.finditer(page.read_text(encoding="utf-8")))
        ]

    def made(self) -> dict[str, Made]:
        """Return how blocks were made, by name; what was never made by this recipe is not in it."""
        if not self._noted.exists():
            return {}
        return {name: Made(**values) for name, values in json.loads(self._noted.read_text(encoding="utf-8")).items()}

    def why_old(self, block: Block) -> str:
        """Return why a block is to be made anew; "" where it is of this code."""
        made = self.made().get(block.name)
        if made is None:
            return "never made by this recipe"
        if made.command != block.command:
            return "its command has changed"
        changed = [folder for folder, code in made.code.items() if self._fingerprint(folder) != code]
        if not changed:
            return ""
        others = f" and {len(changed) - 1} more folders" if len(changed) > 1 else ""
        return f"{changed[0]}{others} changed since {made.commit}"

    def make(self, block: Block) -> Made:
        """Run the command of a block, and put what it says into the page.

        Raises
        ------
        SystemExit
            When the command fails, or code changes while it runs; the page stays as it was.
        """
        commit, before = self._commit(), self._everything()
        out = self._top / "runs" / "results" / block.name
        out.mkdir(parents=True, exist_ok=True)
        command, _, taken = block.command.partition(" -> ")
        began_s = time.monotonic()
        with tempfile.TemporaryDirectory() as notes:
            printed = self._run(command.replace("{out}", str(out.relative_to(self._top))), Path(notes))
            read = _noted_paths(Path(notes))
        text = self._taken(block, out, taken.split()) if taken else printed
        if not text.strip():
            raise SystemExit(f"results: {command} printed nothing; its page stays as it was")
        code = self._folders(read)
        self._fingerprints.clear()
        if changed := [folder for folder in code if self._fingerprint(folder) != before.get(folder)]:
            raise SystemExit(f"results: {changed[0]} changed while {command} ran; its page stays as it was")
        self._put(block, text)
        made = Made(
            block.command,
            commit,
            dt.datetime.now(dt.UTC).date().isoformat(),
            round((time.monotonic() - began_s) / 60.0, 1),
            {folder: before[folder] for folder in code},
        )
        self._note(block.name, made)
        return made

    def _taken(self, block: Block, out: Path, names: Sequence[str]) -> str:
        """Return a page that a program wrote into its folder; its pictures are copied."""
        page, *patterns = names
        text = (out / page).read_text(encoding="utf-8")
        for picture in sorted(path for pattern in patterns for path in out.glob(pattern)):
            stem = block.page.stem
            name = picture.name if picture.name.startswith(stem) else f"{stem}_{picture.name}"
            (self._folder / name).write_bytes(picture.read_bytes())
            text = text.replace(f"]({picture.name})", f"]({name})")
        return text

    def _run(self, commands: str, notes: Path) -> str:
        return "".join(self._printed(command, notes) for command in commands.split(" && "))

    def _printed(self, command: str, notes: Path) -> str:
        """Return what a program prints, and have the files noted that it reads."""
        words = shlex.split(command)
        if words[0] == "python":
            words[0] = sys.executable
        elif words[0] == "trailmark":
            words[0] = str(Path(sys.executable).with_name("trailmark"))  # pages show how they were called
        traced = str(Path(__file__).parent / "traced")
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, [traced, os.environ.get("PYTHONPATH")])),
            "TRAILMARK_TRACED_TOP": str(self._top),
            "TRAILMARK_TRACED_NOTES": str(notes),
        }
        done = subprocess.run(words, cwd=self._top, env=environment, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"results: {command} ended with code {done.returncode}; its page stays as it was")
        return done.stdout

    def _put(self, block: Block, text: str) -> None:
        """Put what a program said into its place in the page."""
        source = block.page.read_text(encoding="utf-8")
        found = list(_BLOCK.finditer(source))[block.index]
        anew = source[: found.start("text")] + text.strip("\n") + "\n" + source[found.end("text") :]
        block.page.write_text(anew, encoding="utf-8")

    def _note(self, name: str, made: Made) -> None:
        everything = {key: vars(value) for key, value in (self.made() | {name: made}).items()}
        self._noted.write_text(json.dumps(everything, indent=1, sort_keys=True) + "\n", encoding="utf-8")

    def _folders(self, paths: Iterable[Path]) -> list[str]:
        """Return the folders of code that files belong to, relative to the checkout."""
        sources = {_source_of(path).relative_to(self._top) for path in paths if _is_code(path)}
        apart = {path.as_posix() for path in sources if path.parts[0] == "benchmarks"}
        rooms = {path.parent.as_posix() for path in sources if path.parts[0] in _ROOMS and path.name not in _DOORS}
        return sorted(apart | rooms)

    def _everything(self) -> dict[str, str]:
        """Return the fingerprints of all code there is: what a command reads of it is known when it has ended."""
        self._fingerprints.clear()
        files = [path for room in (*_ROOMS, "benchmarks") for path in (self._top / room).rglob("*") if _is_code(path)]
        return {folder: self._fingerprint(folder) for folder in self._folders(files)}

    def _fingerprint(self, code: str) -> str:
        """Return the digest of the code of a file, or of a folder without those below it."""
        if code not in self._fingerprints:
            where = self._top / code
            paths = [where] if where.is_file() else sorted(where.glob("*"))
            digest = hashlib.sha256()
            for path in paths:
                if path.suffix in _CODE and path.is_file():
                    digest.update(path.name.encode() + b"\0" + _meaning_of(path))
            self._fingerprints[code] = digest.hexdigest()[:12]
        return self._fingerprints[code]

    def _commit(self) -> str:
        git = ["git", "-C", str(self._top)]
        said = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
        code = ("core", "plugins", "benchmarks", "examples")
        changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", *code], check=False).returncode
        return said.stdout.strip() + ("+" if changed else "")


def _noted_paths(notes: Path) -> set[Path]:
    return {Path(line) for note in notes.iterdir() for line in note.read_text(encoding="utf-8").splitlines()}


def _source_of(path: Path) -> Path:
    """Return the source of a compiled file; any other file is its own."""
    return path.parent.parent / (path.name.partition(".")[0] + ".py") if path.suffix == ".pyc" else path


def _is_code(path: Path) -> bool:
    return "site-packages" not in path.parts and _source_of(path).suffix in _CODE


def _meaning_of(path: Path) -> bytes:
    """Return a file without what changes no figure: comments, docstrings and layout of Python."""
    if path.suffix != ".py":
        return path.read_bytes()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree).encode()


def _list(results: Results, blocks: Sequence[Block]) -> int:
    """Print what is of this code and what is not, and return how many blocks are old."""
    made = results.made()
    n_old = 0
    for block in blocks:
        why = results.why_old(block)
        n_old += bool(why)
        known = made.get(block.name)
        reckoned = f"about {_minutes_of(block, made):g} min"
        took = f"{known.minutes:g} min, {known.date}, {known.commit}" if known else reckoned
        print(f"{block.name:28} {why or 'of this code'} ({took})")
    return n_old


def _make(results: Results, blocks: Sequence[Block], hours: float | None) -> None:
    """Make blocks, the quickest first, as long as there is time for the next."""
    made = results.made()
    minutes = {block.name: _minutes_of(block, made) for block in blocks}
    ends_s = None if hours is None else time.monotonic() + 3600.0 * hours
    in_turn = sorted(blocks, key=lambda block: minutes[block.name])
    for index, block in enumerate(in_turn):
        left = sum(minutes[other.name] for other in in_turn[index:])
        if ends_s is not None and time.monotonic() + 60.0 * minutes[block.name] > ends_s:
            print(f"no time for {', '.join(other.name for other in in_turn[index:])}: about {left:.0f} min")
            return
        print(f"{block.name}: {block.command} (about {left:.0f} min left in all)", flush=True)
        print(f"{block.name}: made in {results.make(block).minutes:g} min", flush=True)


def _minutes_of(block: Block, made: Mapping[str, Made]) -> float:
    """Return how long a block took, or how long it may take."""
    if block.name in made:
        return made[block.name].minutes
    return _RECKONED_MIN.get(block.name, 60.0 * _UNKNOWN_H)


def main(arguments: Sequence[str] | None = None, top: Path = TOP) -> int:
    """List, make or check the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=("list", "make", "check"), default="list")
    parser.add_argument("names", nargs="*", help="pages or blocks; default: all, of which `make` takes the old ones")
    parser.add_argument("--hours", type=float, help="begin nothing that is known to take longer than what is left")
    parser.add_argument("--strict", action="store_true", help="exit code 1 where a page is older than its code")
    options = parser.parse_args(arguments)
    results = Results(top)
    blocks = results.blocks()
    names = {block.name for block in blocks} | {block.page.stem for block in blocks}
    if unknown := sorted(set(options.names) - names):
        parser.error(f"no page of results has a block {', '.join(unknown)}; there are {', '.join(sorted(names))}")
    chosen = [block for block in blocks if not options.names or {block.name, block.page.stem} & set(options.names)]
    if options.what == "make":
        old = [block for block in chosen if options.names or results.why_old(block)]
        _make(results, old, options.hours)
        return 0
    n_old = _list(results, chosen)
    print(f"{n_old} of {len(chosen)} blocks are older than their code")
    return int(options.strict and n_old > 0)


if __name__ == "__main__":
    sys.exit(main())
