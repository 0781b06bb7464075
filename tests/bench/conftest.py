"""Benches of toys: cells that take half a second each."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.plugins import Plugins, load_plugins
from trailmark_bench import Cell, Index, Outcome, load_bench, run_bench
from trailmark_bench.executors.config import LocalConfig
from trailmark_bench.executors.local import LocalExecutor

TOY = Path(__file__).with_name("toy_plugin.py")


@pytest.fixture(scope="session")
def plugins() -> Plugins:
    return load_plugins(files=[TOY])


@pytest.fixture
def bench_of(plugins: Plugins) -> Callable[..., Any]:
    """Return a bench of toys, read; keyword arguments are those of ``bench:``."""

    def read(cells: Any, run: Mapping[str, Any] | None = None, only: Sequence[str] = (), **section: Any) -> Any:
        config = {"sources": {"robot": {"plugin": "toy_wheels"}}, **(run or {})}
        document = config | {"bench": {"code": "version", "cells": cells, **section}}
        return load_bench(document, plugins=plugins, files=[str(TOY)], only=only)

    return read


@pytest.fixture
def run_cells() -> Callable[..., dict[str, str]]:
    """Run the cells of a bench in a folder; return the state of each by its label."""

    def run(bench: Any, folder: Path, jobs: int = 2, **options: Any) -> dict[str, str]:
        with Index(folder, write=True) as index:
            index.set_meta(metrics=list(bench.section.metrics), baseline=bench.section.baseline)
            run_bench(bench.cells, index, LocalExecutor(LocalConfig(jobs=jobs)), **options)
            return {record.label: record.state for record in index.records()}

    return run


CONFIG = "mode: track\nsources:\n  robot:\n    plugin: sim\nlocalizers:\n" + "".join(
    f"  l{i}: {{plugin: x}}\n" for i in range(20)
)


def synthetic_bench(
    folder: Path,
    sources: int = 3,
    localizers: int = 4,
    seeds: int = 5,
    fails: float = 0.1,
    floor_m: float | None = None,
) -> Index:
    """Return the index of a bench with a cell for each combination; some failed, with a log."""
    rng = np.random.default_rng(7)
    index = Index(folder, write=True)
    cells = [
        Cell(f"{n:020x}", "", {"source": f"world_{s}", "localizer": f"method_{m}", "seed": i}, {})
        for n, (s, m, i) in enumerate(np.ndindex(sources, localizers, seeds))
    ]
    index.enter(cells)
    index.set_meta(metrics=["ate_rmse_m", "tracked_fraction", "nees_per_dof"], baseline="method_0", name="synthetic")
    with index.transaction():
        for cell in cells:
            s, m = (int(str(cell.coordinates[axis]).rpartition("_")[2]) for axis in ("source", "localizer"))
            outcome, result, detail = _finished(rng, s, m, fails)
            if result is not None and floor_m is not None:
                result["floor"] = {"ate_rmse_m[origin,n=1200]": floor_m * (1 + s)}
            index.mark_finished(cell.id, outcome, result, detail)
    return index


def _finished(rng: np.random.Generator, s: int, m: int, fails: float) -> tuple[Outcome, Any, Any]:
    process = {"wall_s": 2.0, "cpu_s": float(rng.uniform(1, 3)), "peak_rss_mb": 150.0, "load": 1.0, "host": "here"}
    if rng.random() < fails:
        return (
            Outcome("crashed", "ended by SIGSEGV (segmentation fault)", "Fatal <b>error</b>\n</script>", **process),
            None,
            None,
        )
    error = 0.01 * (1 + s) * (1 + 0.3 * m) * math.exp(0.2 * rng.standard_normal())
    metrics = {
        "ate_rmse_m[se2,n=1200]": error,
        "tracked_fraction[gap<=0.3s]": float(rng.uniform(0.9, 1.0)),
        "nees_per_dof[n=9,dof=27]": float(rng.lognormal()),
    }
    result = {
        "state": "ok",
        "reason": "",
        "errors": True,
        "metrics": metrics,
        "times": {"call_p95_ms": 3.0},
        "alignment": "se2",
    }
    way = np.cumsum(rng.uniform(0, 0.1, 100))
    points = np.rint(np.stack([400 * way, 100 * np.sin(way)], axis=1)).astype(int).tolist()
    series = {name: short(rng.standard_normal(100)) for name in ("distance_mm", "lateral_mm", "turn_deg")}
    detail = {
        "ways": {"step": 0.01, "low": [0.0, 0.0], "lines": {"groundtruth": points, "method": points}},
        "errors": {"way_m": short(way), **series},
        "stages": {"localizer.method": [1.0, 2.0, 3.0, 4.0]},
        "sources": {"method": {"estimates": 9, "outcomes": {}, "nis": None, "nees": None}},
        "config": CONFIG,
        "provenance": {"trailmark": "0.1.0", "packages": {f"package_{i}": "1.0" for i in range(20)}},
    }
    return Outcome("ok", **process), result, json.dumps(detail).encode()


def short(values: Any) -> list[float]:
    return list(np.round(values, 3).tolist())


@pytest.fixture(scope="session")
def synthetic() -> Callable[..., Index]:
    """Return the maker of benches that nobody ran: cells with figures drawn at random."""
    return synthetic_bench
