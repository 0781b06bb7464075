"""``trailmark evaluate``: metrics for trajectories of any program."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from trailmark.cli.errors import say
from trailmark.cli.trajectories import align_option, read_way, short_names
from trailmark.errors import ConfigError, DataError
from trailmark.evaluation import AlignKind, EstimateTable, Protocol, RunWarning, evaluate
from trailmark.geometry import Trajectory
from trailmark.paths import Path as TaughtPath
from trailmark.paths import TaughtPlaces
from trailmark.report.tables import Column, Table, Trajectories, trajectories_table

if TYPE_CHECKING:
    from trailmark.report.differences import Difference

__all__ = ["evaluate_command"]

# Errors that are so much larger than what is stated of them, or smaller, are rather those of a wrong file.
_MOST_SCALE = 10.0


@click.command("evaluate")
@click.argument("files", metavar="GT.tum EST.tum...", nargs=-1, required=True, type=click.Path(path_type=Path))
@align_option
@click.option(
    "--max-difference",
    "max_difference_s",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="How far the nearest pose may be away in time.  [default: 1.5 intervals]",
)
@click.option("--noise", is_flag=True, help="EST is a run's estimates.csv: print the noise of each localizer.")
@click.option(
    "--store", type=click.Path(path_type=Path), metavar="F.trail", help="With --noise: the path that offsets are about."
)
@click.option(
    "--relations",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Instead of GT.tum: relations between poses (t1 t2 x y z roll pitch yaw).",
)
@click.option("--between", is_flag=True, help="No truth: how the localizers of a run's estimates.csv differ.")
@click.option("--against", metavar="NAME", help="With --between: only from this localizer.")
@click.option("--json", "as_json", is_flag=True, help="Print all metrics as JSON.")
@click.pass_context
def evaluate_command(
    context: click.Context,
    /,
    files: tuple[Path, ...],
    align: AlignKind,
    max_difference_s: float | None,
    noise: bool,
    store: Path | None,
    relations: Path | None,
    between: bool,
    against: str | None,
    as_json: bool,
) -> None:
    """Metrics in the plane for trajectories of any program, in the TUM format (t x y z qx qy qz qw).

    With --noise the errors of what each localizer of a run said, as the lines that tell them to the estimator `kalman`.
    With --relations no truth is named and nothing is aligned: how far each trajectory contradicts the relations.
    With --between no truth is named either: all files are tables of estimates, and their localizers are compared.
    """
    is_aligned = context.get_parameter_source("align") is not ParameterSource.DEFAULT
    if against is not None and not between:
        raise ConfigError("--against belongs to --between")
    if between:
        if noise or store is not None or relations is not None or is_aligned or max_difference_s is not None:
            raise ConfigError("--between goes with --against and --json alone: it needs no truth and aligns nothing")
        _print_differences(files, against, as_json)
        return
    if relations is not None:
        if noise or store is not None:
            raise ConfigError("--relations goes with neither --noise nor --store")
        if is_aligned:
            raise ConfigError("--align does not go with --relations: nothing is aligned there; leave it out")
        _print_relations(relations, files, max_difference_s, as_json)
        return
    truth, *estimates = files
    if not estimates:
        raise click.UsageError("Missing argument 'EST.tum...'.")
    if noise:
        if is_aligned:
            raise ConfigError("--align does not go with --noise: estimates are judged where they stand; leave it out")
        _print_noise(_read_truth(truth), estimates, store, max_difference_s, as_json)
        return
    if store is not None:
        raise ConfigError("--store belongs to --noise")
    protocol = Protocol(align=align, max_difference_s=max_difference_s)
    true_way = _read_truth(truth)
    documents = [_document(path, true_way, protocol) for path in estimates]
    problems = [item["problem"] for item in documents if "problem" in item]
    if len(problems) == len(documents):
        raise DataError("\n".join(f"{path}: {problem}" for path, problem in zip(estimates, problems, strict=True)))
    if as_json:
        click.echo(json.dumps({"truth": str(truth), "align": align, "trajectories": documents}, indent=1))
    else:
        _print(estimates, documents)
    if problems:
        raise click.exceptions.Exit(1)


def _read_truth(file: Path) -> Trajectory:
    truth = read_way(file)
    if len(truth) < 2:
        raise DataError(f"{file}: the ground truth has fewer than two poses, so nothing can be compared with it")
    return truth


def _print_noise(
    truth: Trajectory, tables: Sequence[Path], store: Path | None, max_difference_s: float | None, as_json: bool
) -> None:
    from trailmark.evaluation.estimates_table import read_estimates
    from trailmark.evaluation.known_truth import where_truth_is_known
    from trailmark.evaluation.map_frame import ONE_FRAME
    from trailmark.evaluation.measured_noise import config_lines, measured_noise
    from trailmark.evaluation.taught_places import bent_map_frame, said_places

    path, places = (None, None) if store is None else _taught_of(store)
    for table in tables:
        everything = read_estimates(table)
        estimates = where_truth_is_known(everything, truth, max_difference_s)
        n_told, n_judged = (_n_told(rows) for rows in (everything, estimates))
        frame = ONE_FRAME
        if places is not None:
            frame = bent_map_frame(places, ONE_FRAME, *said_places(estimates, truth, path))
        found = measured_noise(estimates, truth, path, frame)
        if not found:
            raise DataError(
                f"{table}: no localizer said enough while the truth is known, {n_judged} of {n_told} estimates:"
                " ten fixes or ten seconds of motion are the least"
            )
        if n_judged < n_told:
            say(
                f"{table}: {n_told - n_judged} of {n_told} estimates are left out: no true pose is near them"
                " (--max-difference)"
            )
        for source, one in found.items():
            _warn_of_scale(table, source, one.sigma_scale)
        if as_json:
            documents = {source: asdict(one) for source, one in found.items()}
            click.echo(json.dumps({"file": str(table), "noise": documents}, indent=1))
        else:
            click.echo(config_lines(found))


def _n_told(estimates: EstimateTable) -> int:
    return int(((estimates.kind != "lost") & (estimates.outcome != "refused")).sum())


def _warn_of_scale(table: Path, source: str, scale: float) -> None:
    """Print a warning where errors have nothing to do with what is stated of them."""
    if scale > _MOST_SCALE:
        fact = f"its errors are {scale:.3g} times as large as it states"
        remedy = "is the truth of the same run, by the same clock and of base? are its numbers in metres and radians?"
    elif scale < 1.0 / _MOST_SCALE:
        fact = f"its errors are only {scale:.3g} of what it states"
        remedy = "is the truth made of this localizer? are its standard deviations in metres and radians?"
    else:
        return
    say(f"WARNING: {table}: {RunWarning(source, fact, remedy)}")


def _print_relations(path: Path, estimates: Sequence[Path], max_difference_s: float | None, as_json: bool) -> None:
    """Print how far trajectories contradict relations: all, without outliers, along the way, of loops."""
    from trailmark.evaluation.relations import read_relations, relation_errors

    relations = read_relations(path)
    documents = [
        {"file": str(file), **relation_errors(read_way(file), relations, max_difference_s).document()}
        for file in estimates
    ]
    if as_json:
        click.echo(json.dumps({"relations": str(path), "trajectories": documents}, indent=1))
    else:
        _print_relation_table(documents)


def _print_relation_table(documents: Sequence[dict[str, Any]]) -> None:
    click.echo(f"{'':24}{'relations':>18}{'translation [m]':>22}{'largest':>10}{'rotation [deg]':>20}{'largest':>10}")
    for document in documents:
        click.echo(f"{document['file']}: {document['covered']} of {document['relations']} relations")
        for group in ("all", "without_outliers", "along_the_way", "loops"):
            if (found := document[group]) is None:
                continue
            translation = f"{found['translation_m_mean']:.3f} +- {found['translation_m_sd']:.3f}"
            rotation = f"{found['rotation_deg_mean']:.2f} +- {found['rotation_deg_sd']:.2f}"
            click.echo(
                f"  {group.replace('_', ' '):22}{found['n']:18}{translation:>22}{found['translation_m_max']:10.3f}"
                f"{rotation:>20}{found['rotation_deg_max']:10.2f}"
            )


def _print_differences(tables: Sequence[Path], against: str | None, as_json: bool) -> None:
    """Print how localizers of runs differ from each other, beside what both state."""
    from trailmark.evaluation.estimates_table import read_estimates
    from trailmark.report.differences import localizer_differences

    found = {}
    for table in tables:
        estimates = read_estimates(table)
        try:
            found[table] = localizer_differences(estimates, against)
        except DataError as error:
            raise DataError(f"{table}: {error}") from error
    for table, differences in found.items():
        if not differences:
            raise DataError(
                f"{table}: no two localizers say the same kind of thing at the same time ten times or more"
                " (of motions that overlap, and where nothing is measured, none is compared)"
            )
    if as_json:
        documents = [
            {"file": str(table), "differences": [one.document() for one in each]} for table, each in found.items()
        ]
        click.echo(json.dumps({"tables": documents}, indent=1))
        return
    for table, differences in found.items():
        _print_difference_table(table, differences)


def _print_difference_table(table: Path, found: Sequence[Difference]) -> None:
    from trailmark.report.console import print_table

    heads = ("localizers", "kind", "n", "mean", "rms", "largest", "NEES/dof")
    rows = []
    for one in found:
        triples = (" ".join(_short_number(value) for value in triple) for triple in _in_mm_and_deg(one))
        rows.append((f"{one.one} - {one.other}", one.kind, str(one.n), *triples, f"{one.nees_per_dof:.3g}"))
    notes = (
        f"{table}. x, y [mm], heading [deg] of motions over a second and of poses; of path offsets along and beside.",
        "NEES/dof: squares of differences in units of what both state together; 1 where they differ as they say.",
    )
    print_table(Table(tuple(Column(head, is_number=head not in heads[:2]) for head in heads), tuple(rows), notes))


def _in_mm_and_deg(found: Difference) -> Iterator[tuple[float, float, float]]:
    for triple in (found.mean, found.rms, found.largest):
        along, aside, turn = triple.tolist()
        yield 1e3 * along, 1e3 * aside, math.degrees(turn)


def _short_number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _taught_of(store: Path) -> tuple[TaughtPath, TaughtPlaces | None]:
    """Return the path that a store holds, and where its places really were, where that was known."""
    from trailmark.interfaces import Session
    from trailmark.pipeline.teaching.true_places import read_true_places
    from trailmark.stores.sqlite import SqlitePathStore
    from trailmark.stores.sqlite_config import SqliteStoreConfig

    opened = SqlitePathStore(SqliteStoreConfig(path=str(store.resolve())))
    opened.start(Session(mode="replay"))
    try:
        path, places = opened.path(), read_true_places(opened)
    finally:
        opened.close()
    if path is None:
        raise DataError(f"{store} holds no path")
    return path, places


def _document(path: Path, truth: Trajectory, protocol: Protocol) -> dict[str, Any]:
    estimate = read_way(path)
    try:
        return {"file": str(path), **evaluate(estimate, truth, protocol).document()}
    except DataError as error:
        known = {"poses": len(estimate), "length_m": estimate.length_m(), "metrics": {}}
        return {"file": str(path), **known, "problem": str(error)}


def _print(paths: Sequence[Path], documents: Sequence[dict[str, Any]]) -> None:
    from trailmark.report.console import print_table

    labels = tuple((name,) for name in short_names(paths))
    print_table(trajectories_table(Trajectories(labels, tuple(documents), errors=True)))
