"""The map and the time axis in a real browser, where there is one."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark.pipeline.outputs.beliefs import BELIEF_COLUMNS
from trailmark.report import write_report

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
PROBE = Path(__file__).with_name("probe.js")


@pytest.mark.skipif(BROWSER is None, reason="no chromium to open the report with")
def test_the_map_and_the_time_axis_answer_to_a_reader(fake_run: Callable[..., Path], tmp_path: Path) -> None:
    folder = fake_run(seconds=20.0)
    rows = [[0.5 * k, 0.1 * k, 0.0, np.pi / 2, 4e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4] for k in range(40)]
    lines = [",".join(BELIEF_COLUMNS), *(",".join(map(repr, map(float, row))) for row in rows)]
    (folder / "beliefs.csv").write_text("\n".join(lines) + "\n")

    found = browse(write_report(folder), tmp_path)

    assert found["errors"] == []
    assert found["ready"] == "yes"
    assert found["tracks"] == 5  # the truth, three localizers, the fused
    assert found["ellipses"] == 2
    assert found["gaps"] >= 1
    assert found["band"] == 1
    for deed in ("zoomed", "fitted", "larger", "pointed", "closer"):
        assert found[deed], deed
    assert found["coloured"] >= 4
    assert found["hidden"] == 4
    assert "Error to the left [" in found["headings"]
    assert found["width"] <= 0
    assert found["fetched"] == 0


def browse(page: Path, tmp_path: Path) -> dict:
    """Return what the probe finds in the page; the probe comes in beside the page's own policy."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"script-src '(sha256-[^']+)'", r"script-src '\1' 'nonce-probe'", text)
    text = text.replace("</head>", f"<script nonce='probe'>{PROBE.read_text(encoding='utf-8')}</script></head>")
    probed = tmp_path / "probed.html"
    probed.write_text(text, encoding="utf-8")
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--window-size=520,900"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += [f"--user-data-dir={tmp_path / 'browser'}", "--virtual-time-budget=10000", "--dump-dom", probed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    told = re.search(r"PROBE(\{.*?\})END", done.stdout)
    assert told, done.stdout[:500] + done.stderr[-2000:]
    return json.loads(told[1])
