"""The command line starts fast, because it imports nothing heavy."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = ("cv2", "numba", "sklearn", "filterpy", "matplotlib", "scipy", "pandas")
PROBE = """
import json, sys
sys.argv = ["trailmark", *{arguments!r}]
from trailmark.cli import main
try:
    main()
except SystemExit as leaving:
    code = leaving.code
print("\\n" + json.dumps([code, [name for name in {heavy!r} if name in sys.modules]]))
"""


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["plugins"], ["plugins", "list", "--json"]])
def test_nothing_heavy_is_imported(arguments: list[str]) -> None:
    probe = PROBE.format(arguments=arguments, heavy=HEAVY)

    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, timeout=60, check=True)

    code, imported = json.loads(done.stdout.splitlines()[-1])
    assert code == 0
    assert imported == []
