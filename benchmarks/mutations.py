"""Which rules of the papers the tests would miss: each is turned round in a copy, and the tests of its room are run.

``mutations.toml`` lists them: a text that stands in a file once, what it becomes, and the tests that ought to fail. ::

    python benchmarks/mutations.py                         # all of them; half an hour on one core
    python benchmarks/mutations.py --room divs --minutes 9 # one room, as far as it comes
    python benchmarks/mutations.py --what "a turn" --what patience
    python benchmarks/mutations.py --check                 # only whether every text is still there
    python benchmarks/mutations.py --markdown              # the table of the page, when all are judged
    python benchmarks/mutations.py --markdown --minutes 0  # of what was found so far

What is found is noted at once, and a later call goes on from there: a verdict holds as long as the mutated file and
the test that failed, or all tests where none did, are what they were. The test that ought to fail stands in the list
and runs first; the table names the one that did.

Exit code 1: a mutation was not killed, or its text has gone; with `--markdown`: one is not judged. Tests that do not
end within `--limit` are ``hung``, and say nothing: on a busy machine give them longer.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_suffix(".toml")

#: What pytest answers when a test failed, or could not even be collected.
_FAILED = (1, 2)
_COPY = "import shutil, sys; shutil.copytree(*sys.argv[1:], ignore=shutil.ignore_patterns('__pycache__'))"
_KILLER = re.compile(r"^(?:FAILED|ERROR) (?P<test>\S+)", re.MULTILINE)


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
    test : str
        The one that ought to fail, which is run alone first; "" where nobody knows.
    """

    room: str
    file: str
    what: str
    old: str
    new: str
    tests: Sequence[str]
    test: str = ""

    @property
    def name(self) -> str:
        """Where it is made, and what is wrong then."""
        return f"{self.room}/{self.file}: {self.what}"

    def path(self, top: Path) -> Path:
        """Return the file in a checkout."""
        return top / "plugins" / self.room / f"trailmark_{self.room}" / self.file


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mutation.

    Attributes
    ----------
    verdict : str
        ``killed``, ``survived``, ``hung``, or ``gone`` where its text is not there once.
    by : str
        The test that killed it.
    took_s : float
        Copying apart [s].
    of : str
        Fingerprint of what it rests on.
    """

    room: str
    file: str
    what: str
    verdict: str
    by: str
    took_s: float
    of: str

    @property
    def name(self) -> str:
        """Which mutation it is about."""
        return f"{self.room}/{self.file}: {self.what}"


class Workshop:
    """A copy of the checkout, in which one mutation after the other is made and taken back.

    Numba keeps what it compiled of the copy as it is; a mutated kernel is compiled into a folder of its own.

    Parameters
    ----------
    top, folder : Path
        The checkout, and where its copy is made; compiled kernels stay there for the next time.
    limit_s : float
        Time for the tests of one mutation [s].
    """

    def __init__(self, top: Path, folder: Path, limit_s: float) -> None:
        # Tests run in the copy: a path that is relative to here would lead to the code as it is.
        folder = folder.resolve()
        self._folder, self._limit_s = folder, limit_s
        self._passed: set[tuple[str, ...]] = set()
        for name in ("core", "plugins", "tests", "examples"):
            shutil.rmtree(folder / name, ignore_errors=True)
            # by an interpreter of its own: what is but copied makes no page old that `results.py` watches
            subprocess.run([sys.executable, "-I", "-c", _COPY, top / name, folder / name], check=True)
        shutil.copy(top / "pyproject.toml", folder)

    def check(self, tests: Sequence[str]) -> None:
        """Run tests on the code as it is, once.

        Raises
        ------
        RuntimeError
            If one fails: nothing would follow from its failing.
        """
        if tuple(tests) in self._passed:
            return
        verdict, by = self._run(tests, self._folder / "kernels", 10.0 * self._limit_s)
        if verdict != "survived":
            raise RuntimeError(f"the tests fail without any mutation: {by or verdict}")
        self._passed.add(tuple(tests))

    def judge(self, mutation: Mutation) -> Verdict:
        """Make a mutation, run the test that ought to fail and, where it does not, all tests of the room."""
        began_s = time.monotonic()
        if not is_there(mutation, self._folder):
            of = fingerprint(mutation, self._folder, "")
            return Verdict(mutation.room, mutation.file, mutation.what, "gone", "", 0.0, of)
        verdict, by = self._run_mutated(mutation, [mutation.test]) if mutation.test else ("survived", "")
        if verdict != "killed":
            self.check(mutation.tests)
            verdict, by = self._run_mutated(mutation, mutation.tests)
        took_s = round(time.monotonic() - began_s, 1)
        of = fingerprint(mutation, self._folder, by)
        return Verdict(mutation.room, mutation.file, mutation.what, verdict, by, took_s, of)

    def _run_mutated(self, mutation: Mutation, tests: Sequence[str]) -> tuple[str, str]:
        """Mutate the copy, run tests, and put the text back."""
        path, kernels = mutation.path(self._folder), self._folder / "kernels"
        text, times = path.read_text(encoding="utf-8"), {path: path.stat()}
        path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
        try:
            if "kernel" in text:
                kernels = self._folder / "mutated-kernels"
                shutil.rmtree(kernels, ignore_errors=True)
                times = touch_kernels(path.parent) | times
            return self._run(tests, kernels, self._limit_s)
        finally:
            path.write_text(text, encoding="utf-8")
            for each, was in times.items():
                os.utime(each, ns=(was.st_atime_ns, was.st_mtime_ns))

    def _run(self, tests: Sequence[str], kernels: Path, limit_s: float) -> tuple[str, str]:
        """Return what tests say of the copy, and the one that failed."""
        packages = [self._folder / "core", *sorted((self._folder / "plugins").iterdir())]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, packages)),
            "NUMBA_CACHE_DIR": str(kernels),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
        try:
            done = subprocess.run(
                command, cwd=self._folder, env=environment, capture_output=True, text=True, timeout=limit_s
            )
        except subprocess.TimeoutExpired:
            return "hung", ""
        if done.returncode in _FAILED:
            killer = _KILLER.search(done.stdout)
            return "killed", killer["test"] if killer else ""
        if done.returncode:
            raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-1000:]}{done.stderr[-1000:]}")
        return "survived", ""


def mutations_of(document: str) -> list[Mutation]:
    """Return the mutations of a list, in its order."""
    return [
        Mutation(
            room["name"],
            each["file"],
            each["what"],
            each["old"],
            each["new"],
            tuple(room["tests"]),
            f"tests/{room['name']}/{each['test']}" if "test" in each else "",
        )
        for room in tomllib.loads(document)["room"]
        for each in room["mutations"]
    ]


def is_there(mutation: Mutation, top: Path) -> bool:
    """Return whether the text stands in its file exactly once."""
    path = mutation.path(top)
    return path.is_file() and path.read_text(encoding="utf-8").count(mutation.old) == 1


def fingerprint(mutation: Mutation, top: Path, by: str) -> str:
    """Return the digest of a mutation, of the file that it is made in, and of the tests that the verdict rests on.

    Parameters
    ----------
    by : str
        The test that killed it, whose file is enough; "": all tests of the room.
    """
    digest = hashlib.sha256(f"{mutation.old}\0{mutation.new}".encode())
    tests = [by.partition("::")[0]] if by else mutation.tests
    for path in (mutation.path(top), *(top / test for test in tests)):
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()[:12]


def touch_kernels(package: Path) -> dict[Path, os.stat_result]:
    """Let numba compile anew: it keeps kernels whose own file is as it was, also when one that they call is not."""
    kernels = [path for path in package.rglob("*.py") if "kernel" in path.read_text(encoding="utf-8")]
    were = {path: path.stat() for path in kernels}
    for path in kernels:
        path.touch()
    return were


def judge_all(chosen: Sequence[Mutation], workshop: Workshop, minutes: float) -> Iterator[Verdict]:
    """Judge mutations as long as there is time, after the tests that ought to fail have passed on the code as it is."""
    ends_s = time.monotonic() + 60.0 * minutes
    for mutation in chosen:
        if time.monotonic() > ends_s:
            return
        named = [one.test for one in chosen if one.tests == mutation.tests and one.test]
        workshop.check(tuple(dict.fromkeys(named)) or mutation.tests)
        yield workshop.judge(mutation)


def read_verdicts(path: Path) -> dict[str, Verdict]:
    """Return what was found before, by the names of the mutations."""
    if not path.exists():
        return {}
    found = [Verdict(**each) for each in json.loads(path.read_text(encoding="utf-8"))]
    return {each.name: each for each in found}


def table_of(chosen: Sequence[Mutation], known: Mapping[str, Verdict]) -> Iterator[str]:
    """Yield the lines of a page: how many of each room were killed, then each mutation with the test that killed it."""
    rows = [known.get(one.name) for one in chosen]
    yield "| room | mutations | killed |"
    yield "|---|--:|--:|"
    rooms = list(dict.fromkeys(one.room for one in chosen))
    for room in rooms:
        of_room = [row for one, row in zip(chosen, rows, strict=True) if one.room == room]
        yield f"| {room} | {len(of_room)} | {sum(row is not None and row.verdict == 'killed' for row in of_room)} |"
    if len(rooms) > 1:
        yield f"| all | {len(rows)} | {sum(row is not None and row.verdict == 'killed' for row in rows)} |"
    yield ""
    yield "| file | what is wrong | verdict | by |"
    yield "|---|---|---|---|"
    for one, row in zip(chosen, rows, strict=True):
        verdict, by = (row.verdict, row.by) if row else ("not judged", "")
        yield f"| {one.room}/{one.file} | {one.what} | {verdict} | {by.removeprefix('tests/').replace('|', '/')} |"


def main() -> int:
    """Judge what was asked for, and print it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--room", action="append", help="of these plugins alone")
    parser.add_argument("--what", action="append", help="whose words contain this alone")
    parser.add_argument("--check", action="store_true", help="run no tests: are the texts still there?")
    parser.add_argument("--markdown", action="store_true", help="print the table of what was found")
    parser.add_argument("--limit", type=float, default=300.0, help="of the tests of one mutation [s]")
    parser.add_argument("--minutes", type=float, default=600.0, help="begin no mutation after so long")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "runs" / "mutations", help="folder of copy and notes")
    arguments = parser.parse_args()
    everything = mutations_of(LIST.read_text(encoding="utf-8"))
    chosen = [one for one in everything if not arguments.room or one.room in arguments.room]
    if arguments.what:
        chosen = [one for one in chosen if any(words in one.what for words in arguments.what)]
    if arguments.check:
        return check_texts(chosen)
    arguments.out.mkdir(parents=True, exist_ok=True)
    notes = arguments.out / "verdicts.json"
    known = read_verdicts(notes)
    left = [one for one in chosen if not still_holds(known.get(one.name), one)]
    if left and arguments.minutes > 0.0:
        workshop = Workshop(REPOSITORY, arguments.out / "copy", arguments.limit)
        for verdict in judge_all(left, workshop, arguments.minutes):
            known[verdict.name] = verdict
            told = sys.stderr if arguments.markdown else sys.stdout
            print(f"{verdict.verdict:<9}{verdict.took_s:6.1f} s  {verdict.name}", file=told, flush=True)
            notes.write_text(json.dumps([asdict(each) for each in known.values()], indent=1) + "\n", encoding="utf-8")
    if arguments.markdown:
        print("\n".join(table_of(chosen, known)))
        return int(not all(still_holds(known.get(one.name), one) for one in chosen))
    n_killed = sum(one.name in known and known[one.name].verdict == "killed" for one in chosen)
    print(f"{n_killed} of {len(chosen)} mutations killed")
    return int(n_killed < len(chosen))


def still_holds(verdict: Verdict | None, mutation: Mutation) -> bool:
    """Return whether a mutation was judged, and nothing that its verdict rests on has changed since."""
    if verdict is None or verdict.verdict not in ("killed", "survived"):
        return False
    return verdict.of == fingerprint(mutation, REPOSITORY, verdict.by)


def check_texts(chosen: Sequence[Mutation]) -> int:
    """Say which texts are no longer there, and return whether any is missing."""
    gone = [one for one in chosen if not is_there(one, REPOSITORY)]
    for one in gone:
        print(f"gone: {one.name}")
    print(f"{len(chosen) - len(gone)} of {len(chosen)} mutations can be made")
    return int(bool(gone))


if __name__ == "__main__":
    sys.exit(main())
