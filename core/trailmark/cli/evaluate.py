"""``trailmark evaluate``: metrics for trajectories of any program."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from trailmark.errors import DataError
from trailmark.evaluation import ALIGNMENTS, AlignKind, Protocol, evaluate
from trailmark.geometry import Trajectory, read_tum
from trailmark.report.tables import Trajectories, trajectories_table

__all__ = ["evaluate_command"]


@click.command("evaluate")
@click.argument("truth", metavar="GT.tum", type=click.Path(path_type=Path))
@click.argument("estimates", metavar="EST.tum...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--align",
    type=click.Choice(ALIGNMENTS),
    default="se2",
    show_default=True,
    help="Lay all positions on the truth, the first pose only, or nothing.",
)
@click.option(
    "--max-difference",
    "max_difference_s",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="How far the nearest pose may be away in time.  [default: 1.5 intervals]",
)
@click.option("--json", "as_json", is_flag=True, help="Print all metrics as JSON.")
def evaluate_command(
    truth: Path, estimates: tuple[Path, ...], align: AlignKind, max_difference_s: float | None, as_json: bool
) -> None:
    """Metrics in the plane for trajectories of any program, in the TUM format (t x y z qx qy qz qw)."""
    protocol = Protocol(align=align, max_difference_s=max_difference_s)
    true_way = read_tum(truth)
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


def _document(path: Path, truth: Trajectory, protocol: Protocol) -> dict[str, Any]:
    estimate = read_tum(path)
    try:
        return {"file": str(path), **evaluate(estimate, truth, protocol).document()}
    except DataError as error:
        known = {"poses": len(estimate), "length_m": estimate.length_m(), "metrics": {}}
        return {"file": str(path), **known, "problem": str(error)}


def _print(paths: Sequence[Path], documents: Sequence[dict[str, Any]]) -> None:
    from trailmark.report.console import print_table

    labels = tuple((name,) for name in _short_names(paths))
    print_table(trajectories_table(Trajectories(labels, tuple(documents), errors=True)))


def _short_names(paths: Sequence[Path]) -> list[str]:
    """Return the names of the files; with their folders where two are called the same."""
    stems = [path.stem for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]
