"""``trailmark bench`` and what is behind show, merge and export."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from trailmark.cli.root import ChosenPlugins, root
from trailmark.errors import ConfigError, DataError
from trailmark_bench import Cell, Index, Outcome
from trailmark_bench.cli.commands import bench_group
from trailmark_bench.export import export_text
from trailmark_bench.merge import merge_benches
from trailmark_bench.summary import summarize_bench

TOY = Path(__file__).with_name("toy_plugin.py")
CONFIG = """
sources: {robot: {plugin: toy_wheels}}
bench:
  code: version
  cells: {localizers: [toy, odometry], seeds: 2}
  baseline: odometry
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(root, ["bench", *map(str, arguments)], obj=ChosenPlugins(files=(str(TOY),)))


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small bench that was run."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "b.yaml").write_text(CONFIG)
    result = run(folder / "b.yaml", "--out", folder / "out", "--jobs", 2)
    assert result.exit_code == 0, result.output
    return folder


def test_the_command_prints_tables_and_leaves_a_report(done: Path) -> None:
    again = run(done / "b.yaml", "--out", done / "out")

    assert again.exit_code == 0
    assert "4 cells: 4 ok" in again.output
    assert "Pairs of equal seeds with odometry" in again.output
    assert (done / "out" / "report.html").is_file()


def test_list_rehearses_no_kind_of_cell_that_has_run(done: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(config: object) -> None:
        raise AssertionError("a source was started")

    monkeypatch.setattr("trailmark_bench.rehearsal._sensors_of", refuse)

    result = run(done / "b.yaml", "--out", done / "out", "--list")

    assert result.exit_code == 0, result.output
    assert "4 cells, 0 to run" in result.output


def test_list_finds_a_sensor_that_does_not_exist(tmp_path: Path) -> None:
    (tmp_path / "b.yaml").write_text(
        CONFIG.replace(
            "localizers: [toy, odometry]",
            "localizers: {good: {plugin: odometry}, bad: {plugin: odometry, wheels: weels}}",
        )
    )

    listed = run(tmp_path / "b.yaml", "--list")

    assert isinstance(listed.exception, ConfigError)
    problems = str(listed.exception)
    assert problems.startswith("these cells cannot start:")
    assert "weels" in problems
    assert "good" not in problems
    assert (listed.output.count("pending"), listed.output.count("skipped")) == (2, 2)


def test_list_blames_nobody_for_what_is_installed_and_finds_no_sensor(tmp_path: Path) -> None:
    """A robot with wheels alone: cameras' localizers are skipped, and nobody asked for them."""
    cells = CONFIG.replace("localizers: [toy, odometry]", "installed: {gives: [motion]}, localizers: [odometry]")
    (tmp_path / "b.yaml").write_text(cells)

    listed = run(tmp_path / "b.yaml", "--list")

    assert listed.exit_code == 0, listed.output
    (klt,) = [line for line in listed.output.splitlines() if "klt, seed 0" in line]
    assert "skipped" in klt
    assert "no sensor of kind image for 'camera'" in klt


def test_list_finds_a_source_that_does_not_start(tmp_path: Path) -> None:
    table = tmp_path / "wheels.csv"
    table.write_text("t;x\n1;2\n")
    (tmp_path / "b.yaml").write_text(CONFIG.replace("plugin: toy_wheels", f"plugin: csv_odometry, path: {table}"))

    listed = run(tmp_path / "b.yaml", "--list")

    assert isinstance(listed.exception, ConfigError)
    assert "wheels.csv" in str(listed.exception)


def test_list_tells_states_and_the_time_that_is_left(done: Path, tmp_path: Path) -> None:
    shutil.copy(done / "b.yaml", tmp_path / "b.yaml")
    fresh = run(tmp_path / "b.yaml", "--out", tmp_path / "none", "--list")
    more = run(done / "b.yaml", "--out", done / "out", "--set", "bench.cells.seeds=3", "--list", "--json")

    assert "4 cells, 4 to run; 4 of them are like none that has run" in fresh.output
    assert not (tmp_path / "none").exists()
    rows = json.loads(more.stdout)
    assert [row["state"] for row in rows] == ["ok", "ok", "pending"] * 2
    assert all(row["estimated_s"] > 0 for row in rows)


def test_cells_that_are_others_now_are_told(done: Path) -> None:
    changed = run(done / "b.yaml", "--out", done / "out", "--set", "sources.robot.n=35", "--list")
    same = run(done / "b.yaml", "--out", done / "out", "--list")

    assert "4 cells have run with other code or another config" in changed.output
    assert "other code" not in same.output


def test_a_cell_of_now_goes_before_one_of_earlier(tmp_path: Path) -> None:
    with Index(tmp_path, write=True) as index:
        for cell_id in ("1" * 20, "2" * 20):  # the code has changed between
            index.enter([Cell(cell_id, "", {"localizer": "toy", "seed": 0}, {})])
            index.mark_finished(cell_id, Outcome("ok"), {"metrics": {}, "errors": True})

    told = run("show", tmp_path, "toy, seed 0")
    earlier = run("show", tmp_path, "1111")

    assert told.output.startswith("2" * 20)
    assert earlier.output.startswith("1" * 20)


def test_show_tells_a_cell_its_figures_and_its_log(done: Path) -> None:
    told = run("show", done / "out", "toy, seed 1")
    several = run("show", done / "out", "toy")

    assert told.exit_code == 0
    assert "ate_rmse_m[se2,n=40]" in told.output
    assert isinstance(several.exception, ConfigError)
    assert "'toy' is 2 cells" in str(several.exception)


def test_show_as_json_holds_the_statistics(done: Path) -> None:
    document = json.loads(run("show", done / "out", "--json", "--metric", "ate_rmse_m").stdout)

    toy, wheels, still = document["entries"]
    assert (toy["method"], wheels["method"], still["method"]) == ("toy", "odometry", "stands_still")
    assert toy["metrics"]["ate_rmse_m"]["versus"]["n"] == 2
    assert "versus" not in wheels["metrics"]["ate_rmse_m"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "OUT", "--metric", "ate_rsme_m"], r"no cell has a metric 'ate_rsme_m' \(did you mean 'ate_rmse_m'"),
        (["show", "OUT", "--baseline", "toi"], r"baseline 'toi' is no .* \(did you mean 'toy'"),
        (["show", "OUT", "--state", "okay"], "states are pending, running, ok"),
        (["export", "latex", "OUT", "--cells"], "--cells is for csv"),
        (["CONFIG", "--out", "OUT", "--executor", "slurm"], "no executor named 'slurm'.*available: dask, local"),
        (["CONFIG", "--out", "OUT", "--executor", "dask"], "executor 'dask': missing key 'scheduler'"),
        (["CONFIG", "--out", "OUT", "--alone", "--jobs", "2"], "--alone runs one cell at a time"),
    ],
)
def test_wrong_requests_are_told_in_a_line(done: Path, arguments: list[str], message: str) -> None:
    places = {"OUT": done / "out", "CONFIG": done / "b.yaml"}

    result = run(*(places.get(word, word) for word in arguments))

    assert re.search(message, str(result.exception))


def test_a_folder_without_a_bench_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is not the folder of a bench"):
        Index(tmp_path)


def test_help_knows_the_commands() -> None:
    told = CliRunner().invoke(bench_group, ["--help"]).output

    assert all(name in told for name in ("run", "show", "merge", "export"))


def test_csv_has_full_digits_and_tells_every_cell(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path, sources=2, localizers=2, seeds=3) as index:
        statistics = list(csv.DictReader(io.StringIO(export_text(index, "csv"))))
        cells = list(csv.DictReader(io.StringIO(export_text(index, "csv", cells=True))))
        summary = summarize_bench(index)

    assert len(cells) == 12
    assert {cell["state"] for cell in cells} == {"ok", "crashed"}
    assert len(statistics) == 2 * 2 * 3
    first = summary.entries["method_0", "world_0"]
    assert float(statistics[0]["median"]) == first.median(summary.metrics[0])


def test_latex_is_escaped_and_markdown_has_as_many_cells_in_each_row(synthetic, tmp_path: Path) -> None:
    with synthetic(tmp_path, sources=2, localizers=2, seeds=3) as index:
        latex, markdown = export_text(index, "latex"), export_text(index, "markdown")

    assert r"method\_0" in latex
    assert not re.search(r"(?<!\\)_", "\n".join(line for line in latex.splitlines() if not line.startswith("%")))
    tables = [block for block in markdown.split("\n\n") if block.startswith("|")]
    for table in tables:
        assert len({line.count("|") for line in table.splitlines() if line.startswith("|")}) == 1


def finished(folder: Path, cells: dict[str, tuple[str, float]]) -> None:
    """Make a bench of cells by seed: state and error."""
    with Index(folder, write=True) as index:
        index.enter([Cell(f"{seed:0>20}", "", {"localizer": "a", "seed": int(seed)}, {}) for seed in cells])
        for seed, (state, error) in cells.items():
            if state != "pending":
                result = {"metrics": {"ate_rmse_m[se2,n=9]": error}, "errors": True} if state == "ok" else None
                index.mark_finished(f"{seed:0>20}", Outcome(state, "" if state == "ok" else "broke"), result)
                place = folder / "cells" / f"{seed:0>20}"
                place.mkdir(parents=True)
                (place / "result.json").write_text(str(error))


def test_merging_takes_results_before_failures_and_tells_what_differs(tmp_path: Path) -> None:
    finished(tmp_path / "a", {"1": ("ok", 0.1), "2": ("failed", 0.0), "3": ("ok", 0.3)})
    finished(tmp_path / "b", {"2": ("ok", 0.2), "3": ("ok", 0.33), "4": ("pending", 0.0)})

    lines = merge_benches([tmp_path / "a", tmp_path / "b"], tmp_path / "c")

    with Index(tmp_path / "c") as index:
        records = {record.coordinates["seed"]: record for record in index.records()}
    assert {seed: record.state for seed, record in records.items()} == {1: "ok", 2: "ok", 3: "ok", 4: "pending"}
    assert records[3].result["metrics"] == {"ate_rmse_m[se2,n=9]": 0.3}
    assert (tmp_path / "c" / "cells" / f"{'2':0>20}" / "result.json").read_text() == "0.2"
    assert any("1 differ in their figures" in line and "a, seed 3" in line for line in lines)


def test_merging_into_one_of_them_keeps_the_others_untouched(tmp_path: Path) -> None:
    finished(tmp_path / "a", {"1": ("ok", 0.1)})
    finished(tmp_path / "b", {"2": ("ok", 0.2)})

    merge_benches([tmp_path / "a", tmp_path / "b"], tmp_path / "a")

    with Index(tmp_path / "a") as a, Index(tmp_path / "b") as b:
        assert (len(a.records()), len(b.records())) == (2, 1)


def test_failures_are_the_worst_and_never_averaged_away(tmp_path: Path) -> None:
    with Index(tmp_path, write=True) as index:
        cells = [
            Cell(f"{name}{seed:0>19}", "", {"localizer": name, "seed": seed}, {}) for name in "ab" for seed in range(5)
        ]
        index.enter(cells)
        index.set_meta(metrics=["ate_rmse_m", "tracked_fraction"], baseline="b")
        for cell in cells:
            name, seed = cell.coordinates["localizer"], cell.coordinates["seed"]
            if name == "a" and seed >= 2:  # better where it works, and mostly it does not
                index.mark_finished(cell.id, Outcome("crashed", "ended by SIGSEGV"))
            else:
                metrics = {"ate_rmse_m[se2,n=9]": 0.1 if name == "a" else 0.2, "tracked_fraction[gap<=1s]": 0.9}
                index.mark_finished(cell.id, Outcome("ok"), {"metrics": metrics, "errors": True, "alignment": "se2"})
        summary = summarize_bench(index)

    a = summary.entries["a", "all"]
    error, tracked = summary.metrics
    assert a.median(error) == float("inf")
    assert a.median(tracked) == -float("inf")  # the worst of a share is none at all
    assert (a.n_ok, a.n_failed) == (2, 3)
    pair, _ = a.comparisons["ate_rmse_m"]
    assert (pair.wins, pair.losses, pair.ratio) == (2, 3, None)
    ranks = {row.method: row.rank for row in summary.overall}
    assert ranks == {"a": pytest.approx(1.6), "b": pytest.approx(1.4)}


def test_a_baseline_that_was_skipped_somewhere_is_compared_where_it_ran(tmp_path: Path) -> None:
    with Index(tmp_path, write=True) as index:
        places = [(source, name) for source in ("floor", "street") for name in ("a", "b")]
        cells = [Cell(f"{n:020x}", "", {"source": s, "localizer": m}, {}) for n, (s, m) in enumerate(places)]
        index.enter(cells)
        for cell in cells:
            if cell.coordinates == {"source": "street", "localizer": "b"}:
                index.mark_finished(cell.id, Outcome("skipped", "no camera"))
            else:
                index.mark_finished(cell.id, Outcome("ok"), {"metrics": {"ate_rmse_m[se2,n=9]": 0.1}, "errors": True})
        summary = summarize_bench(index, baseline="b")

    assert {key for key, entry in summary.entries.items() if entry.comparisons} == {("a", "floor")}
    assert [row.n_conditions for row in summary.overall] == [1, 0]


def test_what_has_not_run_is_counted_and_has_no_row(tmp_path: Path) -> None:
    places = [("floor", 0), ("floor", 1), ("street", 0)]
    with Index(tmp_path, write=True) as index:
        index.enter([Cell(f"{n:020x}", "", {"source": s, "seed": i}, {}) for n, (s, i) in enumerate(places)])
        index.mark_finished(f"{0:020x}", Outcome("ok"), {"metrics": {"ate_rmse_m[se2,n=9]": 0.1}, "errors": True})

    shown = run("show", tmp_path).output

    assert re.search(r"floor .*1/2", shown)
    assert "street" not in shown
    assert "3 cells: 2 pending, 1 ok" in shown


def test_the_schema_of_bench_configs_knows_runs_and_benches() -> None:
    schema = json.loads(CliRunner().invoke(root, ["schema", "--bench"], obj=ChosenPlugins()).stdout)

    assert {"sources", "localizers", "bench"} <= schema["properties"].keys()
    assert schema["properties"]["bench"]["properties"]["cells"]
    assert "bench" not in json.loads(CliRunner().invoke(root, ["schema"], obj=ChosenPlugins()).stdout)["properties"]
