"""The page of the grand bench, from the file of its results: docs/results/grand/cells.json.xz.

    python benchmarks/bench_grand.py run               what has run: cells, passes, wall and processor time
    python benchmarks/bench_grand.py ranking           methods over all conditions
    python benchmarks/bench_grand.py better            how probable it is that one method beats another
    python benchmarks/bench_grand.py winners           who wins where
    python benchmarks/bench_grand.py answers           how much each answers, after what time, and what that costs
    python benchmarks/bench_grand.py silent            who was wrong without saying so, and where it was worst
    python benchmarks/bench_grand.py honest            squared errors in units of what was stated: too sure, too humble
    python benchmarks/bench_grand.py failed            which methods gave nothing, where, and why
    python benchmarks/bench_grand.py figures MATRIX... [--metric NAME]    the medians of matrices
    python benchmarks/bench_grand.py aces              ways through ACES by relations, beside published ones

``make grand`` runs what is missing of the bench, and writes that file and the page. Of medians the best of a row is
bold; a number behind a median counts the cells that failed, which counted as the worst result; ``stands_still`` is the
error of a robot that is said never to move.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from trailmark.report.tables import Column, Table
from trailmark_bench import Index
from trailmark_bench.cell import UNSUCCESSFUL
from trailmark_bench.entries import MethodResult, entries_of
from trailmark_bench.export import markdown_of
from trailmark_bench.floor import FLOOR, floor_entries
from trailmark_bench.improvement import Improvement, improvements
from trailmark_bench.index import CellRecord
from trailmark_bench.naming import Namer
from trailmark_bench.quantities import Metric, metrics_of
from trailmark_bench.shared import read_results
from trailmark_bench.summary import summarize_bench
from trailmark_bench.tables import bench_tables, metric_title, scaled_column, value_text
from trailmark_bench.winners import winners_table

RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results" / "grand" / "cells.json.xz"
HONEST = 0.2, 5.0  # NEES a degree of freedom: the stated standard deviations are right within a factor of 2.2
# What a method answers, and what that costs: quantities whose medians stand side by side.
ANSWERS = ("answered_fraction", "first_right_s", "recovery_s", "call_ms_per_m", "call_p95_ms")
# Table I of Kuemmerle et al. (2009), ACES: mean and standard deviation of the translation [m].
PUBLISHED = {"scan matching": (0.173, 0.614), "particle filter, 50 particles": (0.060, 0.049), "graph": (0.044, 0.044)}


def run_tables(index: Index) -> Iterator[Table]:
    """Yield what has run and what it cost: by pass, and by matrix.

    What a pass ran whose code has changed since ran again in a later one: of all cells together it is no sum of passes.
    """
    records, meta = index.records(), index.meta()
    states = Counter(record.state for record in records)
    rows = [
        (str(n), _when({"provenance": one}), str(one["cells"]), *_hours(one["wall_s"], one["cpu_s"]))
        for n, one in enumerate(meta.get("passes", ()), start=1)
    ]
    rows.append(("cells that stand", "", str(len(records)), "", *_hours(sum(one.cpu_s or 0.0 for one in records))))
    heads = ["pass", "commit, machine, begin", "cells", "wall time [h]", "processor time [h]"]
    ended = f"{len(records)} of {meta.get('asked', len(records))} cells"
    notes = (f"{ended}: {', '.join(f'{n} {state}' for state, n in states.most_common())}.",)
    yield Table(tuple(Column(head, is_number=head != heads[1]) for head in heads), tuple(rows), notes)
    names = list(dict.fromkeys(record.matrix for record in records))
    yield Table(
        tuple(Column(head, is_number=head != "matrix") for head in (
            "matrix", "cells that ran", "failed", "processor time [h]", "median of a cell [s]", "longest [s]"
        )),
        tuple(_matrix_row(name, [one for one in records if one.matrix == name and one.cpu_s]) for name in names),
    )  # fmt: skip


def _when(meta: dict[str, Any]) -> str:
    about = meta.get("provenance") or {}
    return ", ".join(str(word) for word in ((about.get("git") or {}).get("trailmark"), about.get("cpu"),
                                            str(about.get("started", ""))[:16].replace("T", " ")) if word)  # fmt: skip


def _hours(*seconds: float) -> tuple[str, ...]:
    return tuple(f"{one / 3600.0:.2f}" for one in seconds)


def _matrix_row(name: str, records: Sequence[CellRecord]) -> tuple[str, ...]:
    costs = [record.cpu_s or 0.0 for record in records] or [0.0]
    n_failed = sum(record.state in UNSUCCESSFUL for record in records)
    numbers = (f"{sum(costs) / 3600.0:.2f}", f"{median(costs):.1f}", f"{max(costs):.0f}")
    return (name, str(len(records)), str(n_failed), *numbers)


def figure_table(records: Sequence[CellRecord], name: str) -> Table:
    """Return the medians of one quantity: a row for each condition, a column for each method."""
    metric, namer = _metric(name, records), Namer(records)
    entries = entries_of(records, (metric,), namer)
    methods, conditions = (list(dict.fromkeys(key[axis] for key in entries)) for axis in (0, 1))
    title, per_unit = scaled_column(*metric_title(metric), [entry.median(metric) for entry in entries.values()])
    floor = floor_entries(records, (metric,), namer)
    head = f"{title.title} [{title.unit}]" if title.unit else title.title
    rows = []
    for condition in conditions:
        found = [entries.get((method, condition)) for method in methods]
        best = min((_oriented(entry, metric) for entry in found), default=math.inf)
        cells = (_figure(entry, metric, per_unit, is_best=_oriented(entry, metric) == best) for entry in found)
        still = (_figure(floor.get((FLOOR, condition)), metric, per_unit, is_best=False),) if floor else ()
        rows.append((condition, *cells, *still))
    heads = (*methods, FLOOR) if floor else methods
    return Table((Column(head, is_number=False), *map(Column, heads)), tuple(rows))


def _oriented(entry: MethodResult | None, metric: Metric) -> float:
    value = None if entry is None else entry.median(metric)
    return math.inf if value is None else metric.oriented(value)


def _figure(entry: MethodResult | None, metric: Metric, per_unit: float, *, is_best: bool) -> str:
    if entry is None:
        return ""
    value = entry.median(metric)
    text = value_text(value, per_unit)
    text = f"**{text}**" if is_best and value is not None and math.isfinite(value) else text
    return f"{text} ({entry.n_failed})" if entry.n_failed else text


def better_tables(records: Sequence[CellRecord], name: str) -> Iterator[Table]:
    """Yield for each matrix how probable it is that a method beats another on the same frames, with its interval."""
    for matrix in dict.fromkeys(record.matrix for record in records):
        of_matrix = [one for one in records if one.matrix == matrix]
        metric = _metric(name, of_matrix)
        entries = entries_of(of_matrix, (metric,), Namer(of_matrix))
        methods = list(dict.fromkeys(method for method, _ in entries))
        known = {(one.method, one.other): one for one in improvements(methods, entries, metric)}
        rows = [(method, *(_probable(known.get((method, other))) for other in methods)) for method in methods]
        if known:
            yield Table((Column(f"{matrix}: better than", is_number=False), *map(Column, methods)), tuple(rows))


def _probable(found: Improvement | None) -> str:
    if found is None:
        return ""
    interval = "" if found.low is None else f" ({found.low:.2f} to {found.high:.2f})"
    return f"{found.probability:.2f}{interval}"


def answers_table(records: Sequence[CellRecord]) -> Table:
    """Return for each method how much it answers, how soon it is right, and what it costs: medians of conditions."""
    metrics, namer = metrics_of(ANSWERS, records), Namer(records)
    columns = [Column("method", is_number=False), Column("cells"), Column("failed")]
    found: dict[str, list[MethodResult]] = {}
    for (method, _), entry in sorted(entries_of(records, metrics, namer).items()):
        found.setdefault(method, []).append(entry)
    rows = []
    for method, entries in found.items():
        counts = (str(sum(one.n_ok + one.n_failed for one in entries)), str(sum(one.n_failed for one in entries)))
        known = [[value for one in entries if (value := one.median(metric)) is not None] for metric in metrics]
        rows.append((method, *counts, *(value_text(median(values)) if values else "" for values in known)))
    columns += [Column(f"{title} [{unit}]" if unit else title) for title, unit in map(metric_title, metrics)]
    return Table(tuple(columns), tuple(rows))


def silent_table(records: Sequence[CellRecord]) -> Table:
    """Return for each method in how many cells an estimate was wrong and said to be right, and where most were."""
    rows = []
    for method, found in _by_method(records, "silent"):
        every = [share for several in found.values() for share in several]
        worst = max(found, key=lambda condition: median(found[condition]))
        share = median(found[worst])
        n_silent = sum(one > 0.0 for one in every)
        rows.append((method, str(len(every)), str(n_silent), f"{100 * share:.3g}", worst if share else ""))
    heads = ("method", "cells", "with a silent error", "worst condition: share of estimates [%]", "which")
    return Table(tuple(Column(head, is_number=head not in ("method", "which")) for head in heads), tuple(rows))


def honest_table(records: Sequence[CellRecord]) -> Table:
    """Return for each method how its squared errors compare with the stated covariances, condition by condition."""
    rows = []
    for method, found in _by_method(records, "nees_per_dof"):
        each = {condition: median(values) for condition, values in found.items()}
        least, most = min(each, key=each.__getitem__), max(each, key=each.__getitem__)
        n_honest = sum(HONEST[0] <= value <= HONEST[1] for value in each.values())
        values = f"{median(each.values()):.3g}", f"{each[least]:.3g}", f"{each[most]:.3g}"
        rows.append((method, str(len(each)), str(n_honest), *values, least, most))
    words = ("method", "least where", "most where")
    heads = (words[0], "conditions", f"from {HONEST[0]:g} to {HONEST[1]:g}", "median", "least", "most", *words[1:])
    return Table(tuple(Column(head, is_number=head not in words) for head in heads), tuple(rows))


def _by_method(records: Sequence[CellRecord], name: str) -> list[tuple[str, dict[str, list[float]]]]:
    """Return the values of a quantity by method and condition, in the order of the methods' names."""
    metric, namer = _metric(name, records), Namer(records)
    values: dict[str, dict[str, list[float]]] = {}
    for record in records:
        value = metric.value_of(record) if record.state == "ok" else None
        if value is not None:
            values.setdefault(namer.method(record), {}).setdefault(namer.condition(record), []).append(value)
    return sorted(values.items())


def failure_table(records: Sequence[CellRecord]) -> Table:
    """Return why cells gave no result, by method and condition, but for those without a sensor that suits."""
    namer = Namer(records)
    found = Counter(
        (namer.method(one), namer.condition(one), one.state, one.reason) for one in records if one.state in UNSUCCESSFUL
    )
    heads = ("method", "condition", "state", "reason", "cells")
    rows = tuple((*key, str(n)) for key, n in sorted(found.items()))
    return Table(tuple(Column(head, is_number=head == "cells") for head in heads), rows)


def _metric(name: str, records: Sequence[CellRecord]) -> Metric:
    (metric,) = metrics_of((name,), records)
    return metric


def aces_table(data: Path) -> Table:
    """Return the errors of relations of ways through ACES, beside those that Kuemmerle et al. (2009) publish."""
    import numpy as np
    from laser_floors import log_instants
    from scan_odometry import LOGS, chained, relation_errors
    from taught_maps import teach

    instants = log_instants(data / LOGS["aces"], scan_poses="odometry")
    stamps, relations = np.array([one.stamp_s for one in instants]), np.loadtxt(data / "laser" / "aces.relations")
    with tempfile.TemporaryDirectory() as folder:
        taught = teach(instants, Path(folder) / "taught.trail").poses
    ways = {
        "`odometry` (wheels)": [instants[0].odometry.between(one.odometry) for one in instants],
        "`scan_odometry`": chained(instants, True)[0],
        "`laser_icp`, taught and its loops closed": taught,
    }
    rows = []
    for name, poses in ways.items():
        errors = relation_errors(poses, stamps, relations)
        degrees = np.degrees(errors[:, 1])
        told = [f"{column.mean():.3f} +- {column.std():.3f}" for column in (errors[:, 0], degrees)]
        rows.append((name, str(len(errors)), told[0], f"{errors[:, 0].max():.2f}", told[1]))
    rows += [
        (f"Kuemmerle et al., {name}", "", f"{mean:.3f} +- {std:.3f}", "", "") for name, (mean, std) in PUBLISHED.items()
    ]
    heads = ("way", "relations", "translation [m]", "largest [m]", "rotation [deg]")
    return Table(tuple(Column(head, is_number=head != "way") for head in heads), tuple(rows))


def tables_of(options: argparse.Namespace) -> Iterable[Table]:
    """Return the tables that were asked for."""
    if options.what == "aces":
        return [aces_table(Path(os.environ["TRAILMARK_DATA"]))]
    with tempfile.TemporaryDirectory() as folder:
        read_results(options.results, Path(folder))
        with Index(folder) as index:
            records = index.records()
            match options.what:
                case "run":
                    return list(run_tables(index))
                case "winners":
                    return [winners_table(summarize_bench(index))]
                case "ranking":
                    found = bench_tables(summarize_bench(index))
                    return [table for table in found if table.columns[0].title == "method"]
                case "better":
                    return list(better_tables(records, options.metric))
                case "answers":
                    return [answers_table(records)]
                case "silent":
                    return [silent_table(records)]
                case "honest":
                    return [honest_table(records)]
                case "failed":
                    return [failure_table(records)]
            matrices = options.matrices or list(dict.fromkeys(record.matrix for record in records))
            return [figure_table([one for one in records if one.matrix == name], options.metric) for name in matrices]


def main() -> None:
    """Print tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    whats = ["run", "ranking", "better", "winners", "answers", "silent", "honest", "failed", "figures", "aces"]
    parser.add_argument("what", choices=whats)
    parser.add_argument("matrices", nargs="*", metavar="MATRIX")
    parser.add_argument("--metric", default="ate_rmse_m")
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="FILE")
    print("\n".join(markdown_of(table).rstrip("\n") + "\n" for table in tables_of(parser.parse_args())).rstrip("\n"))


if __name__ == "__main__":
    main()
