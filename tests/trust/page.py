"""The page of `make trust`: what was killed, damaged and filled, from the results that pytest wrote.

::

    python tests/trust/page.py RESULTS.xml ... docs/results/trust.md
"""

from __future__ import annotations

import platform
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET  # of our own making

import trailmark

COMMAND = (
    "TRAILMARK_TRUST=full pytest tests/trust/test_kills.py tests/trust/test_security.py tests/trust/test_bombs.py"
    " tests/stores"
)


def page(results: Sequence[Path]) -> str:
    """Return the results as a page."""
    cases = [case for path in results for case in ET.parse(path).iter("testcase")]
    counted = [(one.get("name"), one.get("value")) for case in cases for one in case.iter("property")]
    modules: dict[str, Counter[str]] = {}
    for case in cases:
        ended = next((word for word in ("failure", "error", "skipped") if case.find(word) is not None), "passed")
        modules.setdefault(str(case.get("classname")).rpartition("tests.")[2], Counter())[ended] += 1
    lines = [
        "# Kills and damage",
        "",
        f"`{COMMAND}`, {time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, "
        f"Python {platform.python_version()}.",
        "",
        "After every kill the store opens, its waypoints are one after the other and not fewer than were said to be",
        "committed, `trailmark store check` finds it sound, and the same command goes on or runs again. A kill is",
        "SIGKILL at a random instant of the life of the process; one that came after its end is not counted.",
        "",
        "| what | times |",
        "|---|--:|",
        *(f"| {name} | {value} |" for name, value in sorted(counted)),
        "",
        "| tests | passed | failed | skipped |",
        "|---|--:|--:|--:|",
        *(
            f"| {name} | {ends['passed']} | {ends['failure'] + ends['error']} | {ends['skipped']} |"
            for name, ends in sorted(modules.items())
        ),
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(sys.argv[-1]).write_text(page([Path(name) for name in sys.argv[1:-1]]), encoding="utf-8")
