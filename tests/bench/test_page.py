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

from trailmark_bench.meanings import MEANINGS
from trailmark_bench.page import write_page, write_site
from trailmark_bench.quantities import metric_of
from trailmark_bench.summary import summarize_bench
from trailmark_bench.winners import winners_of

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


def test_every_heading_of_a_table_says_what_it_means_on_hover(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path, fails=0.2) as index:
        methods = set(summarize_bench(index).methods)
        text = write_page(index).read_text(encoding="utf-8")

    headings = re.findall(r'<th scope="col"([^>]*)>([^<]*)', text)
    script = set(re.findall(r'(?:title: |column\()"([^"]+)"', text))
    assert {title for attributes, title in headings if "title=" not in attributes} <= methods
    assert script - set(MEANINGS) == set()
    assert {"median", "p Holm", "reason"} <= script


def test_the_page_stands_alone_and_nothing_in_it_escapes(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path, fails=0.3) as index:
        text = write_page(index).read_text(encoding="utf-8")

    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)
    assert "default-src 'none'" in text
    assert text.count("</script>") == text.count("<script")
    assert "Fatal <b>error" not in text


def test_a_site_is_as_large_as_it_may_be_and_keeps_its_tables(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path / "bench") as index:
        whole = write_site(index, tmp_path / "whole")
        packed = {text: whole.read_text(encoding="utf-8").count(text) for text in ("Who wins where", "crashed")}
        few = write_site(index, tmp_path / "few", most_mb=0.7 * whole.stat().st_size / 1e6)

    assert whole == tmp_path / "whole" / "index.html"
    assert few.stat().st_size < 0.7 * whole.stat().st_size
    assert packed == {text: few.read_text(encoding="utf-8").count(text) for text in packed}


def test_a_site_leaves_logs_out_before_it_is_too_large(
    synthetic, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    summarized = []
    monkeypatch.setattr(
        "trailmark_bench.page.summarize_bench",
        lambda index, **options: summarized.append(index) or summarize_bench(index, **options),
    )
    with synthetic(tmp_path / "bench", fails=1.0) as index:  # nothing but logs to leave out
        whole = write_site(index, tmp_path / "whole").stat().st_size
        assert not caplog.records
        without = write_site(index, tmp_path / "without", most_mb=(whole - 1) / 1e6).stat().st_size
        assert not caplog.records
        summarized.clear()
        least = write_site(index, tmp_path / "least", most_mb=(without - 1) / 1e6).stat().st_size

    assert without < whole
    assert least == without
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert f"{without / 1e6:.3g} MB" in caplog.text
    assert len(summarized) == 1


def test_the_best_of_a_condition_wins_where_intervals_are_apart(synthetic, tmp_path: Path) -> None:
    """Method 0 is made with the smallest errors, method 3 with nearly twice as large ones, with 20 % of noise."""
    with synthetic(tmp_path, fails=0.0, seeds=9) as index:
        winners = winners_of(summarize_bench(index))

    assert [winner.condition for winner in winners] == ["world_0", "world_1", "world_2"]
    for winner in winners:
        medians = [other.median(metric_of("ate_rmse_m")) for other in (winner.best, *winner.others)]
        assert medians == sorted(medians)
        assert winner.best.method == "method_0"
        assert "method_3" not in winner.equals


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


def test_a_page_with_few_pictures_shows_the_trajectories_that_it_has(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path / "bench", fails=0.2) as index:
        whole = write_site(index, tmp_path / "whole")
        few = write_site(index, tmp_path / "few", most_mb=0.7 * whole.stat().st_size / 1e6)

    assert browse(few, tmp_path)["drawn"] >= 3
