"""The pages of results: which are older than their code, and the recipe that makes them anew.

In a page under ``docs/results`` what a program prints stands between two comments; the prose around it is ours::

    <!-- made by: python benchmarks/landmarks.py --markdown -->
    ...
    <!-- made: end -->

A page may have several; one without any says that it is ``Written by hand``. Commands are joined by ``&&``.
``<!-- made by: COMMAND -> FILE PICTURES... -->`` takes a file of the command's folder instead of what was printed, and
copies pictures from it beside the page, with the page's name before theirs.

``{out}`` in a command is a folder of its own under ``runs/results``. A program that was ended goes on there where it
was; what was begun with other code is thrown away first. ``{kept}`` is the same folder for programs that know
themselves what of it still holds: it is never emptied, and each call of such a program reads all that it depends on.

A program that has measured everything and found what must not be prints a line that begins with ``**Failed:`` and may
end with a code: its text is put into the page, which counts as old until the line is gone, and ``make`` ends with 1.

    python benchmarks/results.py                    # what is older than its code, and how long it takes
    python benchmarks/results.py make               # makes that anew, the quickest first; ends and goes on any time
    python benchmarks/results.py make --hours 2 liars landmarks
    python benchmarks/results.py check --strict     # fails where a page is older than its code

Which code a page depends on is not written down by hand: while a command runs, every file of this checkout that it or
a child of it reads is noted, whatever its kind, but for caches and what installers wrote. ``docs/results/made.json``
keeps a digest of each, of Python without comments, docstrings and layout: neither better words nor a file that was
never read makes a page old.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from results_code import Code, noted_paths, packed, unpacked
from results_work import Work

TOP = Path(__file__).resolve().parents[1]
_BLOCK = re.compile(r"<!-- made by: (?P<command>.+?) -->\n(?P<text>.*?)<!-- made: end -->", re.DOTALL)
_FAILED = re.compile(r"^\*\*Failed:.*$", re.MULTILINE)
_BY_HAND = re.compile(r"^Written by hand\b", re.MULTILINE)
#: Time to keep for a page of which nobody knows how long it takes [min].
_UNKNOWN_MIN = 30.0
#: Blocks of a page that were never made so: reckoned from slices of them, and for two quiet cores [min].
_RECKONED_MIN: dict[str, tuple[float, ...]] = {
    "bench": (5.0,),
    "bench_warm": (15.0, 5.0),
    "divs_winding": (5.0, 10.0, 3.0),
    "foreign_places": (4.0, 6.0, 10.0, 8.0, 5.0, 6.0, 5.0),
    "fusion": (10.0, 0.5, 15.0, 0.2),
    "grand": (*(0.2,) * 12, 27.0, 0.2),
    "ground_accuracy": (25.0, 5.0),
    "ground_conditions": (25.0, 5.0, 25.0, 8.0),
    "ground_map": (4.0, 4.0, 2.0),
    "hostile-input": (2.0, 10.0, 3.0),
    "kinect_honest": (8.0, 5.0, 8.0, 1.5, 1.5, 15.0),
    "laser_maps": (10.0, 17.0, 1.0, 5.0, 25.0, 10.0, 2.0, 5.0, 10.0, 5.0, 3.0, 15.0, 3.0),
    "liars": (3.0,),
    "long-run": (60.0,),
    "mutations": (6.0, 6.0, 6.0, 6.0),
    "nagai2015": (80.0,),
    "noise_told": (30.0,),
    "perroni2014": (60.0,),
    "real-time": (5.0,),
    "real-time-loop": (4.0,),
    "smoother": (4.0, 2.0, 3.0, 3.0),
    "speed": (6.0, 7.0, 6.0, 2.0, 0.5, 3.0, 1.5),
    "tasaki2010": (90.0,),
    "toth2015": (14.0,),
    "trust": (15.0,),
}


class NotMadeError(Exception):
    """A command failed, or its code changed while it ran; the page stays as it was."""


class FailedError(Exception):
    """A page is made, and says that something has failed."""


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
    """How a block was made: by which command, when, at which commit, from which files (path and digest)."""

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
        self._code = Code(top)

    def blocks(self) -> list[Block]:
        """Return the blocks of all pages, by page."""
        return [
            Block(page, index, found["command"])
            for page in sorted(self._folder.glob("*.md"))
            for index, found in enumerate(_BLOCK.finditer(page.read_text(encoding="utf-8")))
        ]

    def loose(self) -> list[str]:
        """Return the pages that no program makes, and that do not say so."""
        texts = {page.stem: page.read_text(encoding="utf-8") for page in sorted(self._folder.glob("*.md"))}
        return [name for name, text in texts.items() if not _BLOCK.search(text) and not _BY_HAND.search(text)]

    def made(self) -> dict[str, Made]:
        """Return how blocks were made, by name; what was never made by this recipe is not in it."""
        if not self._noted.exists():
            return {}
        document = json.loads(self._noted.read_text(encoding="utf-8"))
        return {
            name: Made(**values | {"code": unpacked(values["code"], document["read"])})
            for name, values in document["blocks"].items()
        }

    def why_old(self, block: Block) -> str:
        """Return why a block is to be made anew; "" where it is of this code."""
        made = self.made().get(block.name)
        if made is None:
            return "never made by this recipe"
        if made.command != block.command:
            return "its command has changed"
        if not made.code:
            return f"of {made.commit}, and nobody knows of which files"
        changed = [name for name, digest in made.code.items() if self._code.digest(name) != digest]
        if not changed:
            return self._failure(block)
        others = f" and {len(changed) - 1} more files" if len(changed) > 1 else ""
        return f"{changed[0]}{others} changed since {made.commit}"

    def make(self, block: Block) -> Made:
        """Run the command of a block, and put what it says into the page.

        Raises
        ------
        NotMadeError
            When the command fails, or code changes while it runs; the page stays as it was.
        FailedError
            When the page is made, and says that something has failed.
        """
        commit, before = self._commit(), Code(self._top).everything()
        work = Work(self._top / "runs" / "results" / block.name, block.command, before)
        command, _, taken = block.command.partition(" -> ")
        try:
            folder = str(work.folder.relative_to(self._top))
            printed = self._run(command.replace("{out}", folder).replace("{kept}", folder), work)
            text = self._taken(block, work.folder, taken.split()) if taken else printed
            if not text.strip():
                raise NotMadeError(f"{command} printed nothing")
        finally:
            work.pause()
        self._code = Code(self._top)
        read = self._code.read(noted_paths(work.notes), before)
        if changed := [name for name in read if self._code.digest(name) != before.get(name)]:
            raise NotMadeError(f"{changed[0]} changed while {command} ran")
        self._put(block, text)
        said = self._failure(block)
        if not said:
            work.end()
        today = dt.datetime.now(dt.UTC).date().isoformat()
        made = Made(block.command, commit, today, round(work.minutes, 1), {name: before[name] for name in read})
        self._note(block.name, made)
        if said:
            raise FailedError(said)
        return made

    def _failure(self, block: Block) -> str:
        """Return the line in which a block says that something has failed; "" where it does not."""
        found = list(_BLOCK.finditer(block.page.read_text(encoding="utf-8")))[block.index]
        said = _FAILED.search(found["text"])
        return said[0] if said else ""

    def _taken(self, block: Block, out: Path, names: Sequence[str]) -> str:
        """Return a page that a program wrote into its folder; its pictures are copied."""
        page, *patterns = names
        if not (out / page).is_file():
            raise NotMadeError(f"{block.command} wrote no {page}")
        text = (out / page).read_text(encoding="utf-8")
        for picture in sorted(path for pattern in patterns for path in out.glob(pattern)):
            stem = block.page.stem
            name = picture.name if picture.name.startswith(stem) else f"{stem}_{picture.name}"
            (self._folder / name).write_bytes(picture.read_bytes())
            text = text.replace(f"]({picture.name})", f"]({name})")
        return text

    def _run(self, commands: str, work: Work) -> str:
        return "".join(self._printed(command, work) for command in commands.split(" && "))

    def _printed(self, command: str, work: Work) -> str:
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
            "TRAILMARK_TRACED_NOTES": str(work.notes),
        }
        done = subprocess.run(words, cwd=self._top, env=environment, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode and not _FAILED.search(done.stdout):
            raise NotMadeError(f"{command} ended with code {done.returncode}")
        return done.stdout

    def _put(self, block: Block, text: str) -> None:
        """Put what a program said into its place in the page."""
        source = block.page.read_text(encoding="utf-8")
        found = list(_BLOCK.finditer(source))[block.index]
        anew = source[: found.start("text")] + text.strip("\n") + "\n" + source[found.end("text") :]
        block.page.write_text(anew, encoding="utf-8")

    def _note(self, name: str, made: Made) -> None:
        read: dict[str, str] = {}
        everything = {
            key: vars(value) | {"code": packed(value.code, read)} for key, value in (self.made() | {name: made}).items()
        }
        text = json.dumps({"blocks": everything, "read": read}, indent=1, sort_keys=True)
        self._noted.write_text(text + "\n", encoding="utf-8")

    def _commit(self) -> str:
        git = ["git", "-C", str(self._top)]
        said = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
        code = ("core", "plugins", "benchmarks", "examples", "tests")
        changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", *code], check=False).returncode
        return said.stdout.strip() + ("+" if changed else "")


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


def _make(results: Results, blocks: Sequence[Block], hours: float | None) -> dict[str, str]:
    """Make blocks, the quickest first, as long as there is time for the next; return why each failed, or ""."""
    made = results.made()
    minutes = {block.name: _minutes_of(block, made) for block in blocks}
    ends_s = None if hours is None else time.monotonic() + 3600.0 * hours
    in_turn = sorted(blocks, key=lambda block: minutes[block.name])
    ended = {}
    for index, block in enumerate(in_turn):
        left = sum(minutes[other.name] for other in in_turn[index:])
        if ends_s is not None and time.monotonic() + 60.0 * minutes[block.name] > ends_s:
            print(f"no time for {', '.join(other.name for other in in_turn[index:])}: about {left:.0f} min")
            break
        print(f"{block.name}: {block.command} (about {left:.0f} min left in all)", flush=True)
        try:
            took_min, ended[block.name] = results.make(block).minutes, ""
            print(f"{block.name}: made in {took_min:g} min", flush=True)
        except FailedError as error:
            ended[block.name] = str(error)
            print(f"{block.name}: made: {error}", flush=True)
        except (NotMadeError, OSError) as error:
            ended[block.name] = f"not made: {error}"
            print(f"{block.name}: not made: {error}; it stays as it was", flush=True)
    return ended


def _make_all(results: Results, blocks: Sequence[Block], names: Sequence[str], hours: float | None) -> int:
    """Make what is old, then what is old by that: pages that are read from pages. Return 1 where a block failed."""
    began_s = time.monotonic()
    old = [block for block in blocks if names or results.why_old(block)]
    ended = _make(results, old, hours)
    left_h = None if hours is None else hours - (time.monotonic() - began_s) / 3600.0
    left_alone = {block.name for block in old if ended.get(block.name) != ""}
    later = [block for block in blocks if block.name not in left_alone and results.why_old(block)]
    ended |= _make(results, later, left_h)
    for name, why in ended.items():
        if why:
            print(f"{name}: {why}")
    return int(any(ended.values()))


def _minutes_of(block: Block, made: Mapping[str, Made]) -> float:
    """Return how long a block took, or how long it may take."""
    known = made.get(block.name)
    if known and known.command == block.command:
        return known.minutes
    reckoned = _RECKONED_MIN.get(block.page.stem, ())
    return reckoned[block.index] if block.index < len(reckoned) else _UNKNOWN_MIN


def main(arguments: Sequence[str] | None = None, top: Path = TOP) -> int:
    """List, make or check the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", choices=("list", "make", "check"), default="list")
    parser.add_argument("names", nargs="*", help="pages or blocks; default: all, of which `make` takes the old ones")
    parser.add_argument("--hours", type=float, help="begin nothing that is known to take longer than what is left")
    parser.add_argument("--strict", action="store_true", help="exit code 1 where a page is older than its code")
    options = parser.parse_intermixed_args(arguments)
    results = Results(top)
    blocks = results.blocks()
    names = {block.name for block in blocks} | {block.page.stem for block in blocks}
    if unknown := sorted(set(options.names) - names):
        parser.error(f"no page of results has a block {', '.join(unknown)}; there are {', '.join(sorted(names))}")
    chosen = [block for block in blocks if not options.names or {block.name, block.page.stem} & set(options.names)]
    if options.what == "make":
        return _make_all(results, chosen, options.names, options.hours)
    n_old, loose = _list(results, chosen), results.loose()
    print(f"{n_old} of {len(chosen)} blocks are older than their code")
    if loose:
        print(f"nobody can make {', '.join(loose)}: without a block, and not said to be written by hand")
    return int(options.strict and (n_old > 0 or bool(loose)))


if __name__ == "__main__":
    sys.exit(main())
