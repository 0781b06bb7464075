"""All of `make trust`, in pieces: what is done is kept in a folder, and is not done again.

::

    python -m tests.trust.recipe --cases 20000                # an hour or more of a machine
    python -m tests.trust.recipe --cases 20000 --minutes 10   # as much as there is time for; again goes on

Hostile input to readers, to whole commands and by parts comes first, then kills and damage. Both pages are written
each time, from everything that is kept. ``rm -r .trust`` begins anew.
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
#: A run with a part that misbehaves costs as much as so many cases.
_CASES_PER_PART = 40

#: Modules of cases, and the files of their records.
_STORMS = {"fuzz": "readers.jsonl", "fuzz_parts": "parts.jsonl", "storm": "commands.jsonl"}


def main(arguments: list[str] | None = None) -> int:
    """Do what there is time for and write the pages; return 1 if there is a finding, or a test that failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20_000, help="to readers, and as many to whole commands")
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="begin nothing after this")
    parser.add_argument("--records", type=Path, default=_ROOT / ".trust", help="folder of what is done")
    parser.add_argument("--pages", type=Path, default=_ROOT / "docs" / "results", help="folder of the pages")
    chosen = parser.parse_args(arguments)
    chosen.records.mkdir(parents=True, exist_ok=True)
    until_s = time.time() + 60 * chosen.minutes
    for module, name in _STORMS.items():
        n = chosen.cases // _CASES_PER_PART if module == "fuzz_parts" else chosen.cases
        minutes = (until_s - time.time()) / 60
        if minutes <= 0.0:
            break
        command = ("-m", f"tests.trust.{module}", "--cases", str(n), "--minutes", f"{minutes:.3f}")
        subprocess.run((sys.executable, *command, "--record", str(chosen.records / name)), cwd=_ROOT, check=False)
    left = [path for path in _test_files() if not _has_passed(_results_of(path, chosen.records))]
    while left and time.time() < until_s:
        _test(left.pop(0), chosen.records)
    return _tell(chosen.records, chosen.pages, chosen.cases, left)


def _tell(folder: Path, pages: Path, cases: int, left: list[Path]) -> int:
    """Write the pages of everything that is kept, and say what is left to do."""
    readers, parts, commands = (Records(folder / name) for name in _STORMS.values())
    texts = (
        fuzz.page(readers, f"make trust CASES={cases}"),
        storm_page(commands, f"make trust CASES={cases}"),
        fuzz_parts.page(parts, f"make trust CASES={cases}"),
    )
    (pages / "hostile-input.md").write_text("\n".join(texts), encoding="utf-8")
    results = sorted(folder.glob("*.xml"))
    if results:
        (pages / "trust.md").write_text(page.page(results), encoding="utf-8")
    print(f"{len(readers)} readers, {len(commands)} commands, {len(parts)} parts, {len(results)} files of tests")
    if left:
        print(f"left to do: {', '.join(str(path.relative_to(_ROOT)) for path in left)}; the same command goes on")
    has_findings = any(record.findings for records in (readers, parts, commands) for record in records)
    return int(has_findings or not all(_has_passed(path) for path in results))


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
    subprocess.run(command, cwd=_ROOT, env=os.environ | {"TRAILMARK_TRUST": "full"}, check=False)
    unfinished.replace(results)


if __name__ == "__main__":
    sys.exit(main())
