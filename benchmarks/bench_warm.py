"""What cells of the grand bench cost forked from a warm process with frames that are rendered once, and without both.

    python benchmarks/bench_warm.py [--cells 100] [--floors wood,gravel] [--out FILE.md] [--json]
    python benchmarks/bench_warm.py --only matrix=rgbd --only source=lab             other cells of the grand bench
    python benchmarks/bench_warm.py --workers [--cells 24]         the same cells by one worker of Dask, and by two

Cells of the matrix `ground` (a downward camera over procedural floors; ground_vo, its peers and wheel odometry), or
those that `--only` names, are run one at a time: each as a program that renders its own frames, as all cells once were,
then forked from a warm process that finds them rendered. The bytes of their metrics, estimates and trajectories are
compared. Processor time is that of all processes; wall times and the gain of a second worker count on a quiet machine
alone.
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from trailmark.isolation.executor import Executor
from trailmark.plugins import load_plugins
from trailmark_bench import Cell, Index, load_bench, run_bench
from trailmark_bench.executors.config import DaskConfig, LocalConfig
from trailmark_bench.executors.dask import DaskExecutor
from trailmark_bench.executors.local import LocalExecutor
from trailmark_bench.suites import find_config

_LOCALIZERS = "ground_vo,klt,orb,phase_correlation,odometry"


@dataclass(frozen=True)
class Ran:
    """One way of running the cells: times of all processes together [s], and how many gave a result."""

    how: str
    n_cells: int
    n_ok: int
    wall_s: float
    cpu_s: float
    by_localizer: dict[str, float]


def grand_cells(n: int, only: Sequence[str]) -> list[Cell]:
    """Return cells of the grand bench: places before seeds, localizers last."""
    cells = load_bench(find_config(Path("grand")), plugins=load_plugins(), only=only).cells
    first = sorted(cells, key=lambda cell: int(cell.coordinates["seed"]))  # stable: places in their order
    return first[:n]


def run(how: str, cells: Sequence[Cell], folder: Path, executor: Executor) -> Ran:
    """Run cells in a folder, and say what it took."""
    before, began_s = _cpu_of_children_s(), time.perf_counter()
    with Index(folder, write=True) as index:
        run_bench(cells, index, executor)
        records = index.records()
    wall_s, cpu_s = time.perf_counter() - began_s, _cpu_of_children_s() - before
    own: dict[str, float] = {}
    for record in records:
        localizer = str(record.coordinates["localizer"])
        own[localizer] = own.get(localizer, 0.0) + (record.cpu_s or 0.0)
    return Ran(how, len(records), sum(record.state == "ok" for record in records), wall_s, cpu_s, own)


def _cpu_of_children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def differing(one: Path, other: Path, cells: Sequence[Cell]) -> int:
    """Return how many cells differ in a byte of their figures."""
    return sum(_figures(one / "cells" / cell.id) != _figures(other / "cells" / cell.id) for cell in cells)


def _figures(folder: Path) -> dict[str, bytes]:
    names = ("metrics.json", "estimates.csv", "*.tum")
    found = [file for name in names for file in (folder / "run").rglob(name)]
    return {str(file.relative_to(folder)): file.read_bytes() for file in found}


def before_and_after(cells: Sequence[Cell], folder: Path) -> tuple[list[Ran], int]:
    """Return what the cells cost begun anew and forked, and how many differ in their figures."""
    anew = LocalExecutor(LocalConfig(jobs=1, warm=False, frames_mb=0))
    ways = [
        run("each a program, renders its frames", cells, folder / "before", anew),
        run("forked, frames rendered once", cells, folder / "after", LocalExecutor(LocalConfig(jobs=1))),
    ]
    return ways, differing(folder / "before", folder / "after", cells)


def by_workers(cells: Sequence[Cell], folder: Path) -> list[Ran]:
    """Return what the cells cost by one worker of Dask on this machine, and by two."""
    import distributed

    ways = []
    for n in (1, 2):
        with ExitStack() as stack:
            cluster = stack.enter_context(distributed.LocalCluster(n_workers=n, threads_per_worker=1, processes=True))
            executor = DaskExecutor(DaskConfig(scheduler=cluster.scheduler_address))
            run(f"{n}, to begin with", cells[:n], folder / f"first-{n}", executor)  # workers that have begun
            ran = run(f"workers: {n}", cells, folder / f"workers-{n}", executor)
            ways.append(replace(ran, cpu_s=sum(ran.by_localizer.values())))  # of the cells: workers have not ended
    return ways


def page_of(ways: Sequence[Ran], notes: Sequence[str]) -> str:
    """Return the figures as Markdown."""
    names = sorted(ways[0].by_localizer)
    lines = [
        f"| | cells | ok | wall [s] | processor time [s] | {' | '.join(names)} |",
        f"|---|{'---:|' * (4 + len(names))}",
    ]
    for way in ways:
        own = " | ".join(f"{way.by_localizer[name]:.1f}" for name in names)
        lines.append(f"| {way.how} | {way.n_cells} | {way.n_ok} | {way.wall_s:.1f} | {way.cpu_s:.1f} | {own} |")
    return "\n".join([*lines, "", *notes]) + "\n"


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=100)
    parser.add_argument("--floors", default="wood,concrete,asphalt,carpet,gravel")
    parser.add_argument("--only", action="append", metavar="AXIS=NAME", help="not the floors: as of the bench")
    parser.add_argument("--workers", action="store_true")
    parser.add_argument("--out", type=Path, help="a page (.md) to write")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    ground = ["matrix=ground", f"source={options.floors}", f"localizer={_LOCALIZERS}"]
    cells = grand_cells(options.cells, options.only or ground)
    with tempfile.TemporaryDirectory() as work:
        if options.workers:
            ways = by_workers(cells, Path(work))
            n_other = differing(Path(work, "workers-1"), Path(work, "workers-2"), cells)
        else:
            ways, n_other = before_and_after(cells, Path(work))
    one, other = ways
    own_s = [sum(way.by_localizer.values()) for way in ways]
    notes = [
        f"Wall time by {one.wall_s / other.wall_s:.2f}, processor time by {one.cpu_s / other.cpu_s:.2f} less,"
        f" that of the cells' own processes by {own_s[0] / own_s[1]:.2f};"
        f" {n_other} of {one.n_cells} cells differ in a byte of their figures."
    ]
    page = page_of(ways, notes)
    if options.out is not None:
        options.out.write_text(page, encoding="utf-8")
    told = {"ways": [asdict(way) for way in ways], "differ": n_other}
    print(json.dumps(told, indent=1) if options.json else page)


if __name__ == "__main__":
    main()
