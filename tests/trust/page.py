"""The tables of kills and damage: what was killed, damaged and filled, from the results that pytest wrote."""

from __future__ import annotations

import platform
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
    """Return the results as tables."""
    cases = [case for path in results for case in ET.parse(path).iter("testcase")]
    counted = [(one.get("name"), one.get("value")) for case in cases for one in case.iter("property")]
    modules: dict[str, Counter[str]] = {}
    for case in cases:
        ended = next((word for word in ("failure", "error", "skipped") if case.find(word) is not None), "passed")
        modules.setdefault(str(case.get("classname")).rpartition("tests.")[2], Counter())[ended] += 1
    lines = [
        f"`{COMMAND}`, {time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, "
        f"Python {platform.python_version()}.",
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
