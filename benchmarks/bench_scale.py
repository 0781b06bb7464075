"""What the bench itself costs: per cell, at ten thousand cells, and in a browser; and whether it repeats itself.

    python benchmarks/bench_scale.py [--cells 40] [--synthetic 10000] [--quick] [--out FILE.md] [--json]

Cells are runs of wheel odometry over a small table, one after another. What a cell costs beyond its own process is the
time of the bench less that of its processes, by cell. The same bench is run twice, into two folders, and the bytes of
all ``metrics.json`` are compared; times stand in another file. Ten thousand cells are made up (half with series to
draw, a tenth crashed), written to an index and put into a page, which chromium opens without a window; its own clock
says when all that the page does by itself was done.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import resource
import runpy
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from trailmark import __version__
from trailmark.pipeline.outputs.provenance import provenance
from trailmark.plugins import load_plugins
from trailmark_bench import Index, load_bench, run_bench
from trailmark_bench.executors.config import LocalConfig
from trailmark_bench.executors.local import LocalExecutor
from trailmark_bench.page import write_page

_TESTS = Path(__file__).parents[1] / "tests" / "bench"
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# Runs when everything is loaded; performance.now() counts from the moment at which the page was asked for.
_CLOCK = """
addEventListener("load", () => {
  const told = {load: performance.now(), ready: document.documentElement.dataset.ready};
  document.title = "TOOK" + JSON.stringify(told) + "END";
});
"""


@dataclass(frozen=True)
class Figure:
    """A figure beside its bar; None where there is no bar, and where nothing was measured."""

    what: str
    unit: str
    ours: float | None
    bar: float | None
    note: str = ""

    @property
    def is_met(self) -> bool:
        """Whether it is below the bar."""
        return self.bar is None or (self.ours is not None and self.ours < self.bar)

    @property
    def measured(self) -> str:
        """The figure with its unit, in words where there is none."""
        return "not measured" if self.ours is None else f"{self.ours:.3g} {self.unit}".strip()


def overhead(folder: Path, n_cells: int) -> list[Figure]:
    """Return what a cell costs beyond its process, and how many files of metrics differ between two benches."""
    (folder / "wheels.csv").write_text(_wheels(), encoding="utf-8")
    first, second = (_run(folder, name, n_cells) for name in ("first", "second"))
    both = sorted(first.metrics)
    n_other = sum(first.metrics[cell] != second.metrics.get(cell) for cell in both)
    note = f"{n_cells} cells, one at a time, each {first.process_s / n_cells:.2f} s in its process"
    return [
        Figure("bench, a cell beyond its process", "ms", 1e3 * first.beyond_s / n_cells, 50.0, note),
        Figure("bench, the same again", "ms", 1e3 * second.beyond_s / n_cells, 50.0),
        Figure("metrics files that differ between two runs", "", float(n_other), 0.5, f"of {len(both)}, byte by byte"),
    ]


@dataclass(frozen=True)
class _Ran:
    wall_s: float
    process_s: float
    metrics: dict[str, bytes]

    @property
    def beyond_s(self) -> float:
        return self.wall_s - self.process_s


def _wheels() -> str:
    rows = [f"{0.1 * i:.1f},{0.05 * i:.3f},{0.01 * math.sin(0.1 * i):.5f},0" for i in range(50)]
    return "\n".join(["t,x,y,theta", *rows]) + "\n"


def _run(folder: Path, name: str, n_cells: int) -> _Ran:
    sources = {"wheels": {"plugin": "csv_odometry", "path": str(folder / "wheels.csv")}}
    cells = {"localizers": ["odometry"], "seeds": n_cells}
    bench = load_bench({"sources": sources, "bench": {"cells": cells}}, plugins=load_plugins())
    with Index(folder / name, write=True) as index:
        began_s = time.perf_counter()
        run_bench(bench.cells, index, LocalExecutor(LocalConfig(jobs=1)))
        wall_s = time.perf_counter() - began_s
        records = index.records()
    process_s = sum(record.wall_s or 0.0 for record in records)
    assert all(record.state == "ok" for record in records), [record.reason for record in records]
    metrics = {record.id: next((folder / name / "cells" / record.id).rglob("metrics.json")) for record in records}
    return _Ran(wall_s, process_s, {cell: file.read_bytes() for cell, file in metrics.items()})


def size(folder: Path, n_cells: int) -> list[Figure]:
    """Return what an index and a page of many cells cost, and how long a browser takes to open it."""
    synthetic: Any = runpy.run_path(str(_TESTS / "conftest.py"))["synthetic_bench"]
    began_s = time.process_time()
    with synthetic(folder / "many", sources=max(1, n_cells // 100), localizers=20, seeds=5) as index:
        made_s = time.process_time() - began_s
        page = write_page(index)
    took_s = time.process_time() - began_s
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    note = f"of this {made_s:.1f} s to make the cells up and to write the index"
    figures = [
        Figure(f"{n_cells} cells, index and page", "s", took_s, 10.0, note),
        Figure(f"{n_cells} cells, memory", "MB", peak_mb, 1024.0, f"the page is {page.stat().st_size / 1e6:.1f} MB"),
    ]
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    opens = f"{n_cells} cells, the page opens"
    if browser is None:
        return [*figures, Figure(opens, "s", None, 3.0, "this machine has no chromium")]
    loads = sorted(_opened(browser, page, folder / f"browser{n}") for n in range(3))
    note = f"best of 3, until nothing is left to do; all: {', '.join(f'{load:.2f}' for load in loads)}"
    return [*figures, Figure(opens, "s", loads[0], 3.0, note)]


def _opened(browser: str, page: Path, profile: Path) -> float:
    """Return when a page and what it does by itself were done, by the browser's clock [s]."""
    text = re.sub(r"script-src '(sha256-[^']+)'", r"script-src '\1' 'nonce-clock'", page.read_text(encoding="utf-8"))
    timed = page.with_name("timed.html")
    timed.write_text(text.replace("</head>", f"<script nonce='clock'>{_CLOCK}</script></head>"), encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += [f"--user-data-dir={profile}", "--window-size=1280,900", "--dump-dom", timed.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    found = re.search(r"TOOK(\{.*?\})END", done.stdout)
    assert found, done.stderr[-1000:]
    told = json.loads(found[1])
    assert told["ready"] == "true", told
    return float(told["load"]) / 1e3


def page_of(figures: Sequence[Figure], command: str) -> str:
    """Return the figures as Markdown."""
    about = provenance(Path())
    lines = [
        "# The cost of the bench",
        "",
        f"`{command}`; trailmark {__version__}, {datetime.now(UTC).date().isoformat()}; {about['cpu']}.",
        "",
        *(__doc__ or "").split("\n\n")[2:],
        "| what | measured | bar | |",
        "|---|---|---|---|",
        *(f"| {one.what} | {one.measured} | {_bar(one)} | {one.note} |".replace("  ", " ") for one in figures),
    ]
    return "\n".join(lines) + "\n"


def _bar(figure: Figure) -> str:
    if figure.bar is None:
        return ""
    bar = "0" if figure.bar < 1.0 else f"< {figure.bar:g} {figure.unit}"
    return bar if figure.ours is None else f"{bar}, {'met' if figure.is_met else 'not met'}"


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--synthetic", type=int, default=10_000)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, help="a page (.md) to write")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    n_cells, n_synthetic = (5, 500) if options.quick else (options.cells, options.synthetic)
    with tempfile.TemporaryDirectory() as work:
        figures = size(Path(work), n_synthetic) + overhead(Path(work), n_cells)
    if options.out is not None:
        command = f"python benchmarks/bench_scale.py --cells {n_cells} --synthetic {n_synthetic}"
        options.out.write_text(page_of(figures, command), encoding="utf-8")
    if options.json:
        print(json.dumps([asdict(one) | {"met": one.is_met} for one in figures], indent=1))
        return
    for one in figures:
        print(f"{one.what:<46}{one.measured:>14}  {_bar(one):<20}{one.note}")


if __name__ == "__main__":
    main()
