"""Writing the report of a run: ``plots/*.svg`` and ``report.html``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation import (
    GROUND_TRUTH,
    MetricFunction,
    PluggedMetric,
    Protocol,
    RunEvaluation,
    RunFolder,
    evaluate_run_folder,
    read_run,
)
from trailmark.evaluation.run_metrics import metrics_document
from trailmark.geometry import Trajectory
from trailmark.report import sections
from trailmark.report.explorer import explorer_document
from trailmark.report.glimpses import glimpses_section
from trailmark.report.html import page_html, text_html
from trailmark.report.offsets import Offsets, offset_series, offsets_figure
from trailmark.report.series import error_series, lanes, position_errors
from trailmark.report.style import line_styles, plotting, svg_of
from trailmark.writing import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["drawn_trajectories", "explorer_of_run", "write_report"]


def write_report(
    folder: str | Path,
    *,
    protocol: Protocol | None = None,
    metrics: Mapping[str, PluggedMetric | MetricFunction] | None = None,
    path: paths.Path | None = None,
) -> Path:
    """Write ``plots/*.svg`` and ``report.html`` into the folder of a run, from what the run left there.

    The page stands alone: drawings, pictures and styles are inside, nothing is fetched. What a run has not left (no
    ground truth, no estimates, cut off in the middle) is left out or said.

    Parameters
    ----------
    folder : path
        The run.
    protocol : Protocol, optional
        How trajectories are compared; the defaults are those of `evaluate_run`.
    metrics : mapping of str to function, optional
        Further metrics, as in `evaluate_run`.
    path : trailmark.paths.Path, optional
        The taught path: how far from it the robot was is drawn.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    DataError
        If the folder is not that of a run, or cannot be written to.
    """
    evaluated = evaluate_run_folder(read_run(folder), protocol)
    document = metrics_document(evaluated, metrics=metrics)
    offsets, drawn = offset_series(evaluated, path), drawn_trajectories(evaluated)
    plots = _plots(evaluated, drawn, offsets)
    explorer = explorer_document(evaluated, drawn, path, offsets)
    page = _page(evaluated, document, plots, explorer, glimpses_section(Path(folder)))
    try:
        return _write(Path(folder), plots, page)
    except OSError as error:
        raise DataError(f"cannot write the report into {folder}: {error.strerror or error}") from error


def explorer_of_run(run: RunFolder) -> dict[str, Any] | None:
    """Return what the map and the time axis show of a run, which may be still going on; None: nothing yet.

    Raises
    ------
    DataError
        If it cannot be evaluated.
    """
    evaluated = evaluate_run_folder(run)
    offsets = offset_series(evaluated, run.path_taught)
    return explorer_document(evaluated, drawn_trajectories(evaluated), run.path_taught, offsets)


def _plots(evaluated: RunEvaluation, drawn: Mapping[str, Trajectory], offsets: Offsets) -> dict[str, str]:
    from trailmark.report import figures  # here: matplotlib is loaded only for drawing

    styles = line_styles(sections.shown_trajectories(evaluated))
    series = error_series(evaluated)
    estimates = evaluated.run.estimates
    found = lanes(estimates, evaluated.sources) if estimates is not None else []
    draw: dict[str, Callable[[], Figure]] = {}
    if drawn:
        draw["trajectories"] = lambda: figures.trajectories_figure(drawn, styles)
    if series:
        draw["errors"] = lambda: figures.errors_figure(series, styles, evaluated.has_truth)
        draw["distribution"] = lambda: figures.distribution_figure(position_errors(evaluated), styles)
    if offsets:
        draw["offsets"] = lambda: offsets_figure(offsets, styles)
    if found:
        draw["outcomes"] = lambda: figures.outcomes_figure(found)
    return {name: _drawing(name, function) for name, function in draw.items()}


def _drawing(name: str, draw: Callable[[], Figure]) -> str:
    with plotting(name):
        return svg_of(draw())


def drawn_trajectories(evaluated: RunEvaluation) -> dict[str, Trajectory]:
    """Return the trajectories to draw: over ground truth where it is known, each aligned as its errors are."""
    truth = {GROUND_TRUTH: evaluated.run.truth} if evaluated.has_truth and evaluated.run.truth is not None else {}
    compared = evaluated.evaluations if evaluated.has_truth else {}
    ways = {
        name: compared[name].absolute.alignment.apply(trajectory) if name in compared else trajectory
        for name, trajectory in evaluated.run.trajectories.items()
        if len(trajectory) and (name in compared or not evaluated.has_truth)
    }
    return {**truth, **ways}


def _page(
    evaluated: RunEvaluation,
    document: Mapping[str, Any],
    plots: Mapping[str, str],
    explorer: Mapping[str, Any] | None,
    pictures: str,
) -> str:
    run = evaluated.run
    parts = [
        sections.header_section(evaluated),
        sections.explorer_section(explorer),
        sections.result_section(evaluated, document),
        sections.plots_section(plots, evaluated),
        pictures,
        sections.localizers_section(document),
        sections.timing_section(run.timing),
        sections.counters_section(run.run),
        sections.configuration_section(run.config_text),
        sections.provenance_section(run.run),
        sections.details_section(document),
        text_html(f"Trailmark {run.run.get('trailmark', '')}".strip(), "footer"),
    ]
    script = files("trailmark.report").joinpath("explorer.js").read_text(encoding="utf-8") if explorer else ""
    return page_html(f"{run.name}, a Trailmark run", [part for part in parts if part], script=script)


def _write(folder: Path, plots: Mapping[str, str], page: str) -> Path:
    (folder / "plots").mkdir(exist_ok=True)
    for name, svg in plots.items():
        write_whole(folder / "plots" / f"{name}.svg", svg)
    path = folder / "report.html"
    write_whole(path, page)
    return path
