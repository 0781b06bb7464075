"""Which rules of the papers the tests would miss: each is turned round in a copy, and the tests of its room are run.

``mutations.toml`` lists them: a text that stands in a file once, what it becomes, and the tests that ought to fail. ::

    python benchmarks/mutations.py                              # all of them; an hour on one core
    python benchmarks/mutations.py --room divs --out found.json # one room
    python benchmarks/mutations.py --check                      # only whether every text is still there

Exit code 1: a mutation was not killed, or its text has gone. Tests that do not end within `--limit` are ``hung``,
and say nothing: on a busy machine give them longer.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")

#: What pytest answers when a test failed, or could not even be collected.
_FAILED = (1, 2)


@dataclass(frozen=True, slots=True)
class Mutation:
    """One rule turned round.

    Attributes
    ----------
    room, file : str
        Name of the plugin, and the file in its package.
    what : str
        What is wrong then, in words.
    old, new : str
        The text, which stands in the file once, and what it becomes.
    tests : sequence of str
        Files of tests, the fast ones first.
    """

    room: str
    file: str
    what: str
    old: str
    new: str
    tests: Sequence[str]

    def path(self, top: Path) -> Path:
        """Return the file in a checkout."""
        return top / "plugins" / self.room / f"trailmark_{self.room}" / self.file


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutation: ``killed``, ``survived``, ``hung``, or ``gone`` where its text is not there once."""

    room: str
    file: str
    what: str
    verdict: str
    took_s: float


def mutations_of(document: str) -> list[Mutation]:
    """Return the mutations of a list, in its order."""
    return [
        Mutation(room["name"], each["file"], each["what"], each["old"], each["new"], tuple(room["tests"]))
        for room in tomllib.loads(document)["room"]
        for each in room["mutations"]
    ]


def is_there(mutation: Mutation, top: Path) -> bool:
    """Return whether the text stands in its file exactly once."""
    path = mutation.path(top)
    return path.is_file() and path.read_text(encoding="utf-8").count(mutation.old) == 1


def copy_of(top: Path, folder: Path) -> Path:
    """Copy what the tests need of a checkout."""
    for name in ("core", "plugins", "tests"):
        shutil.copytree(top / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(top / "pyproject.toml", folder)
    return folder


def judge(mutation: Mutation, top: Path, limit_s: float) -> Verdict:
    """Mutate a copy, run the tests, and put the text back."""
    began_s = time.monotonic()
    if not is_there(mutation, top):
        return Verdict(mutation.room, mutation.file, mutation.what, "gone", 0.0)
    path = mutation.path(top)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
    try:
        _touch_kernels(mutation, top)
        verdict = {True: "survived", False: "killed", None: "hung"}[pass_tests(mutation.tests, top, limit_s)]
    finally:
        path.write_text(text, encoding="utf-8")
        _touch_kernels(mutation, top)
    return Verdict(mutation.room, mutation.file, mutation.what, verdict, round(time.monotonic() - began_s, 1))


def _touch_kernels(mutation: Mutation, top: Path) -> None:
    """Let numba compile anew: it keeps kernels whose own file is as it was, also when one that they call is not."""
    if "kernel" not in mutation.path(top).read_text(encoding="utf-8"):
        return
    for path in mutation.path(top).parent.rglob("*.py"):
        if "kernel" in path.read_text(encoding="utf-8"):
            path.touch()


def pass_tests(tests: Sequence[str], top: Path, limit_s: float) -> bool | None:
    """Return whether tests pass in a checkout; None when they have not ended in time.

    Raises
    ------
    RuntimeError
        If pytest could not run them at all.
    """
    packages = [top / "core", *sorted((top / "plugins").iterdir())]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, packages)),
        "NUMBA_CACHE_DIR": str(top / "kernels"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        done = subprocess.run(command, cwd=top, env=environment, capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        return None
    if done.returncode not in (0, *_FAILED):
        raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-1000:]}{done.stderr[-1000:]}")
    return done.returncode == 0


def verdicts(chosen: Sequence[Mutation], top: Path, limit_s: float) -> Iterator[Verdict]:
    """Judge mutations in a copy; a room whose tests fail as they are is an error, for nothing would follow."""
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        copy = copy_of(top, Path(folder))
        for tests in dict.fromkeys(mutation.tests for mutation in chosen):
            if pass_tests(tests, copy, 10.0 * limit_s) is not True:
                raise RuntimeError(f"the tests fail without any mutation: {' '.join(tests)}")
        for mutation in chosen:
            yield judge(mutation, copy, limit_s)


def main() -> int:
    """Judge what was asked for, and print it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--room", action="append", help="of these plugins alone")
    parser.add_argument("--check", action="store_true", help="run no tests: are the texts still there?")
    parser.add_argument("--limit", type=float, default=300.0, help="of the tests of one mutation [s]")
    parser.add_argument("--out", type=Path, help="JSON of the verdicts, written after each")
    arguments = parser.parse_args()
    everything = mutations_of(LIST.read_text(encoding="utf-8"))
    chosen = [one for one in everything if not arguments.room or one.room in arguments.room]
    if arguments.check:
        gone = [one for one in chosen if not is_there(one, REPOSITORY)]
        for one in gone:
            print(f"gone: {one.room}/{one.file}: {one.what}")
        print(f"{len(chosen) - len(gone)} of {len(chosen)} mutations can be made")
        return int(bool(gone))
    found: list[Verdict] = []
    for verdict in verdicts(chosen, REPOSITORY, arguments.limit):
        found.append(verdict)
        print(f"{verdict.verdict:<9}{verdict.took_s:6.1f} s  {verdict.room}/{verdict.file}: {verdict.what}", flush=True)
        if arguments.out:
            arguments.out.write_text(json.dumps([asdict(one) for one in found], indent=1) + "\n", encoding="utf-8")
    n_killed = sum(one.verdict == "killed" for one in found)
    print(f"{n_killed} of {len(found)} mutations killed")
    return int(n_killed < len(found))


if __name__ == "__main__":
    sys.exit(main())
