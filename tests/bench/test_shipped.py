"""The benches that are shipped, and those in ``benchmarks/``, name what is there."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

from trailmark.config import Document, load_run_config
from trailmark.interfaces import Session
from trailmark.pipeline.parts import build_sources
from trailmark.plugins import load_plugins
from trailmark_bench import load_bench
from trailmark_bench.suites import find_config, suite_names

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_the_grand_bench_has_every_localizer_and_skips_recordings_that_are_not_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("TRAILMARK_DATA", raising=False)
    plugins = load_plugins()

    bench = load_bench(find_config(Path("grand")), plugins=plugins)

    used = {
        part["plugin"]
        for cell in bench.cells
        if cell.request
        for part in cell.request["document"]["localizers"].values()
    }
    ours = {spec.name for spec in plugins.registry.specs("localizer") if spec.distribution == "trailmark"}
    # no sensor, half a pose, landmarks and lasers of recordings alone, no source of poses
    assert ours - used <= {"constant_speed", "imu", "known_landmarks", "scan_odometry", "pose_fixes"}
    missing = {cell.coordinates["source"] for cell in bench.cells if cell.missing}
    assert missing == {
        "photo_wood",
        "photo_asphalt",
        "fr1_rpy",
        *(f"robot_{number}" for number in range(1, 6)),
        *(f"barcodes_{number}" for number in range(1, 6)),
        "intel",
        "freiburg",
    }
    assert all("TRAILMARK_DATA is not set" in cell.missing for cell in bench.cells if cell.missing)


def test_the_grand_bench_has_every_fault(data_folder: Path) -> None:
    plugins = load_plugins()
    bench = load_bench(find_config(Path("grand")), plugins=plugins)

    documents = [cell.request["document"] for cell in bench.cells if cell.request]
    faults = [source.get("perturb") or {} for document in documents for source in document["sources"].values()]
    used = {name for fault in faults for name in fault}

    ours = {spec.name for spec in plugins.registry.specs("fault") if spec.distribution == "trailmark"}
    assert ours - used == {"basic"}  # whose keys stand beside the names of the others


@pytest.mark.slow
def test_the_faults_of_the_grand_bench_befall_sensors_that_are_there(data_folder: Path) -> None:
    plugins = load_plugins()
    bench = load_bench(find_config(Path("grand")), plugins=plugins)
    tried = set()

    for cell in bench.cells:
        sources = cell.request["document"]["sources"].values() if cell.request else ()
        named = [tuple((source.get("perturb") or {}).get("sensors") or ()) for source in sources]
        kind = (cell.coordinates["source"], *named)
        if not any(named) or kind in tried:
            continue
        tried.add(kind)
        config = load_run_config(Document(cell.request["document"], "cell", Path()), plugins=plugins)
        for source in build_sources(config):
            with closing(source):
                source.start(Session(name=source.name))  # it refuses a sensor that it does not have

    assert len(tried) >= 10


def test_a_shipped_bench_is_found_by_its_name_and_a_file_of_that_name_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    assert suite_names() == ["grand"]
    assert find_config(Path("grand")).is_file()
    assert find_config(Path("grand.yaml")) == Path("grand.yaml")
    (tmp_path / "grand").write_text("mine")
    assert find_config(Path("grand")) == Path("grand")


def test_the_speed_bench_runs_its_cells_alone() -> None:
    bench = load_bench(BENCHMARKS / "speed.yaml", plugins=load_plugins())

    assert bench.cells
    assert all(cell.alone and cell.request["limits"]["threads"] == 1 for cell in bench.cells)


def test_the_bench_of_combinations_crosses_mixes_with_failing_sensors() -> None:
    bench = load_bench(BENCHMARKS / "combinations.yaml", plugins=load_plugins())

    mixes = {cell.coordinates["localizer"] for cell in bench.cells}
    assert mixes == {"wheels", "ground_omni", "ground_divs", "wheels_kinect", "all_four"}
    assert len(bench.cells) == 5 * 4 * 3
    assert not any(cell.missing for cell in bench.cells)
