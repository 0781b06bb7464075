"""Hostile input, kills and damage, in pieces: what is done is kept in a folder, and is not done again.

::

    python -m tests.trust.recipe readers                             # also: commands, parts, tests
    python -m tests.trust.recipe commands --cases 20000 --minutes 10 # as much as there is time for; again goes on

What is printed is a part of a page, of everything that is kept: ``make trust`` puts each into its place. When all was
tried and something failed, the part says so in a line that begins with ``**Failed:`` (it is put into its place, and
``make trust`` ends with 1), and the same command tries that again. ``rm -r .trust`` begins anew.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET  # of our own making

from tests.trust import fuzz, fuzz_parts, page
from tests.trust.records import Records
from tests.trust.storm.__main__ import page as storm_page

_ROOT = Path(__file__).parents[2]
_FILES = (
    *("tests/trust/test_kills.py", "tests/trust/test_security.py", "tests/trust/test_bombs.py"),
    "tests/stores",
)
#: Modules of cases, their part of the page, and how many cases without ``--cases``: one of parts is a whole run.
_STORMS = {
    "readers": ("tests.trust.fuzz", fuzz.page, 20_000),
    "commands": ("tests.trust.storm", storm_page, 20_000),
    "parts": ("tests.trust.fuzz_parts", fuzz_parts.page, 500),
}


def main(arguments: list[str] | None = None) -> int:
    """Do what there is time for and print the part of the page; return 1 if something is left to do or has failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=(*_STORMS, "tests"))
    defaults = ", ".join(f"{cases} {what}" for what, (_, _, cases) in _STORMS.items())
    parser.add_argument("--cases", type=int, help=f"default: {defaults}; all tests")
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="begin nothing after this")
    parser.add_argument("--records", type=Path, default=_ROOT / ".trust", help="folder of what is done")
    chosen = parser.parse_args(arguments)
    chosen.records.mkdir(parents=True, exist_ok=True)
    if chosen.what == "tests":
        return _all_tests(chosen.records, time.time() + 60 * chosen.minutes)
    return _storm(chosen.what, chosen.cases, chosen.minutes, chosen.records / f"{chosen.what}.jsonl")


def _storm(what: str, cases: int | None, minutes: float, kept: Path) -> int:
    module, page_of, default = _STORMS[what]
    cases, code = default if cases is None else cases, 0
    if minutes > 0.0:
        command = (sys.executable, "-m", module, "--cases", str(cases), "--minutes", f"{minutes:.3f}")
        code = subprocess.run((*command, "--record", str(kept)), cwd=_ROOT, stdout=sys.stderr, check=False).returncode
    records = Records(kept)
    print(page_of(records, f"python -m tests.trust.recipe {what} --cases {cases}"))
    if len(records) < cases:
        return 1
    if n_findings := sum(len(record.findings) for record in records):
        return _failed(f"{n_findings} findings")
    return _failed(f"{module} ended with code {code}") if code else 0


def _all_tests(folder: Path, until_s: float) -> int:
    waiting = [path for path in _test_files() if not _has_passed(_results_of(path, folder))]
    while waiting and time.time() < until_s:
        _test(waiting.pop(0), folder)
    print(page.page(sorted(folder.glob("*.xml"))))
    names = [str(path.relative_to(_ROOT)) for path in _test_files() if not _has_passed(_results_of(path, folder))]
    if not names:
        return 0
    print(f"left to do: {', '.join(names)}; the same command goes on", file=sys.stderr)
    return 1 if waiting else _failed(", ".join(names))


def _failed(what: str) -> int:
    print(f"**Failed: {what}.**")  # results.py looks for this line
    return 1


def _test_files() -> Iterator[Path]:
    for name in _FILES:
        path = _ROOT / name
        yield from sorted(path.glob("test_*.py")) if path.is_dir() else (path,)


def _results_of(path: Path, folder: Path) -> Path:
    return folder / f"{'-'.join(path.relative_to(_ROOT).with_suffix('').parts)}.xml"


def _has_passed(results: Path) -> bool:
    """Return whether a file's tests have been run, and none has failed."""
    if not results.exists():
        return False
    suites = list(ET.parse(results).iter("testsuite"))
    return bool(suites) and all(suite.get(word) == "0" for suite in suites for word in ("failures", "errors"))


def _test(path: Path, folder: Path) -> None:
    results = _results_of(path, folder)
    unfinished = results.with_suffix(".part")
    command = (
        sys.executable,
        "-m",
        "pytest",
        "-q",
        str(path),
        "-o",
        "junit_family=xunit1",
        "--junitxml",
        str(unfinished),
    )
    subprocess.run(command, cwd=_ROOT, env=os.environ | {"TRAILMARK_TRUST": "full"}, stdout=sys.stderr, check=False)
    unfinished.replace(results)


if __name__ == "__main__":
    sys.exit(main())
