"""Benches of toys: cells that take half a second each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from trailmark.bench import Index, load_bench, run_bench
from trailmark.bench.executors.config import LocalConfig
from trailmark.bench.executors.local import LocalExecutor
from trailmark.plugins import Plugins, load_plugins

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
