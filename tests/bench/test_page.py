"""The report: opened by a real browser where there is one, small and quick at ten thousand cells."""

from __future__ import annotations

import json
import re
import resource
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from trailmark_bench.page import write_page

BROWSER = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)

PROBE = Path(__file__).with_name("probe.js")


def browse(page: Path, tmp_path: Path, width: int = 1280) -> dict:
    """Return what the probe finds in the page; the probe comes in beside the page's own policy."""
    if BROWSER is None:
        pytest.skip("no chromium to open the report with")
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"script-src '(sha256-[^']+)'", r"script-src '\1' 'nonce-probe'", text)
    text = text.replace("</head>", f"<script nonce='probe'>{PROBE.read_text(encoding='utf-8')}</script></head>")
    probed = tmp_path / "probed.html"
    probed.write_text(text, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    command += [
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--window-size={width},900",
    ]
    command += [f"--user-data-dir={tmp_path / 'browser'}", "--virtual-time-budget=20000", "--dump-dom", probed.as_uri()]
    before_s = cpu_of_children_s()
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    cpu_s = cpu_of_children_s() - before_s
    found = re.search(r"PROBE(\{.*?\})END", done.stdout)
    assert found, done.stdout[:500] + done.stderr[-2000:]
    return json.loads(found[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")) | {"cpu_s": cpu_s}


def cpu_of_children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@pytest.mark.parametrize("width", [1280, 500])
def test_a_browser_opens_sorts_filters_and_shows_a_cell(synthetic, tmp_path: Path, width: int) -> None:
    with synthetic(tmp_path / "bench", fails=0.2) as index:
        page = write_page(index)

    found = browse(page, tmp_path, width)

    assert found["errors"] == []
    assert found["fetched"] == 0
    assert found["ready"] == "true"
    assert found["rows"] == 60
    assert found["ascending"]
    assert found["descending"]
    assert found["filtered"]
    assert found["count"] == "5 of 60"
    assert found["heat"] == 12
    assert "tracked fraction" in found["note"]
    assert found["beside"] == [f"method_{n}" for n in range(4)]
    assert found["scales"] == 1
    assert found["pairs"]
    assert found["told"]
    assert found["compared"] == found["drawn"] >= 2
    assert found["narrow"] == (width < 768)
    assert found["named"].startswith("world_")
    assert found["crashed"]
    assert found["log"]
    assert found["plots"] == 4
    assert found["config"]
    assert found["hidden"]
    assert found["back"]
    assert found["width"] <= 0  # nothing stands out of the screen; wide tables scroll in themselves


def test_the_page_stands_alone_and_nothing_in_it_escapes(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path, fails=0.3) as index:
        text = write_page(index).read_text(encoding="utf-8")

    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)
    assert "default-src 'none'" in text
    assert text.count("</script>") == text.count("<script")
    assert "Fatal <b>error" not in text


def test_without_results_there_is_still_a_page(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path / "bench", sources=1, localizers=1, fails=1.0) as index:
        text = write_page(index).read_text(encoding="utf-8")

    assert "5 &times; crashed: ended by SIGSEGV" in text


@pytest.mark.long
def test_ten_thousand_cells(synthetic, tmp_path: Path) -> None:
    began_s = time.process_time()
    with synthetic(tmp_path / "bench", sources=100, localizers=20, seeds=5) as index:
        made_s = time.process_time() - began_s
        page = write_page(index)
    took_s = time.process_time() - began_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    found = browse(page, tmp_path)
    with synthetic(tmp_path / "small", sources=1, localizers=2, seeds=2) as index:
        load_s = found["cpu_s"] - browse(write_page(index), tmp_path)["cpu_s"]  # of a browser that starts

    figures = f"{took_s:.1f} s ({made_s:.1f} s to make them up), {peak_mb:.0f} MB, {page.stat().st_size / 1e6:.1f} MB"
    print(f"10000 cells: {figures}, loaded in {load_s:.1f} s")
    assert took_s < 10.0
    assert peak_mb < 1024
    assert load_s < 3.0
    assert found["errors"] == []
