"""From Python, the same things as from the command line."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

from trailmark.interruption import TELL_S, Interrupted, ending_signal, reason_of, shielded
from trailmark.pipeline import Pipeline, RunRequest, RunResult, Step, link_latest, new_folder

if TYPE_CHECKING:
    from trailmark.config import RunConfig
    from trailmark.interfaces import Controller, Estimator, Fault, FrameSource, Localizer, PathStore, Sink
    from trailmark.pipeline.request import RunKeywords
    from trailmark.plugins import Plugins
    from trailmark.report.glimpses import Glimpses

__all__ = ["create", "run"]

logger = logging.getLogger(__name__)


def run(
    config: RunConfig | RunRequest | str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    report: bool = True,
    on_step: Callable[[Pipeline, Step], None] | None = None,
    **options: Unpack[RunKeywords],
) -> RunResult:
    """Run a config to its end and leave a run folder, as ``trailmark run`` does.

    Ctrl-C ends the run and keeps what is done: the result's status is then ``interrupted``.

    Parameters
    ----------
    config : RunConfig, RunRequest, path or mapping
        What to run.
    out : path, optional
        The run's folder; default: ``runs/YYYYmmdd-HHMMSS-NAME``, which ``runs/latest`` then links.
    report : bool
        Whether to write plots and ``report.html``.
    on_step : callable, optional
        Called with the pipeline and every step: progress.
    **options
        `store`, `mode`, `overrides`, `plugins`, `access`, `overwrite`: as of `trailmark.pipeline.RunRequest`.

    Returns
    -------
    RunResult
        With metrics.

    Raises
    ------
    ConfigError
        If the request is wrong.
    RunError, DataError
        If the run fails; its folder holds what there was.
    """
    request = config if isinstance(config, RunRequest) else RunRequest(config=config, out=out, **options)
    folder = new_folder(request.name) if request.out is None else Path(request.out)
    pipeline = Pipeline(replace(request, out=folder))
    glimpses = None
    if report:
        from trailmark.report.glimpses import Glimpses

        glimpses = Glimpses()
    try:
        with pipeline:
            for step in pipeline:
                if glimpses is not None:
                    glimpses.see(step.frame)
                if on_step is not None:
                    on_step(pipeline, step)
    except KeyboardInterrupt:
        if not pipeline.has_ended:  # before the first frame there is nothing to keep
            raise
    finally:
        if request.out is None and folder.exists():
            link_latest(folder.absolute())
    return _evaluate_into_result(pipeline, glimpses)


@overload
def create(kind: Literal["source"], name: str, *, plugins: Plugins | None = None, **config: Any) -> FrameSource: ...
@overload
def create(kind: Literal["localizer"], name: str, *, plugins: Plugins | None = None, **config: Any) -> Localizer: ...
@overload
def create(kind: Literal["estimator"], name: str, *, plugins: Plugins | None = None, **config: Any) -> Estimator: ...
@overload
def create(kind: Literal["path_store"], name: str, *, plugins: Plugins | None = None, **config: Any) -> PathStore: ...
@overload
def create(kind: Literal["controller"], name: str, *, plugins: Plugins | None = None, **config: Any) -> Controller: ...
@overload
def create(kind: Literal["sink"], name: str, *, plugins: Plugins | None = None, **config: Any) -> Sink: ...
@overload
def create(kind: Literal["fault"], name: str, *, plugins: Plugins | None = None, **config: Any) -> Fault: ...
@overload
def create(kind: str, name: str, *, plugins: Plugins | None = None, **config: Any) -> Any: ...
def create(kind: str, name: str, *, plugins: Plugins | None = None, **config: Any) -> Any:
    """Return one part alone, constructed and not started: ``create("localizer", "ground_vo", camera="floor")``.

    Parameters
    ----------
    kind, name : str
        As in a config: ``source``, ``localizer``, ``estimator``, ``path_store``, ``controller``, ``sink``.
    plugins : Plugins, optional
        Where to look; default: all that are installed.
    **config
        The part's own keys.

    Raises
    ------
    UnknownPluginError
        If nothing of that kind and name is registered; the message names what is.
    ConfigError
        If a key is unknown or a value wrong.
    PluginLoadError
        If the part cannot be imported or constructed.
    """
    from trailmark.config.document import Document, Problems
    from trailmark.config.explain import validate_at
    from trailmark.plugins import load_plugins

    spec = (plugins or load_plugins()).registry.find(kind, name)
    document = Document(config, name=f"{kind} {name!r}")
    problems = Problems(document)
    settings = validate_at(spec.load_config(), config, (), problems, document.base_dir)
    problems.raise_if_any()
    return spec.construct(settings)


def _evaluate_into_result(pipeline: Pipeline, glimpses: Glimpses | None) -> RunResult:
    """Add metrics to the result, and plots and report to the folder.

    A program that was told to end takes the time for pictures, which nobody could take again, and for metrics;
    `write_report` makes the rest later.
    """
    result, metrics = pipeline.result, None
    if (early := ending_signal()) is not None:
        with shielded():
            logger.warning("%s", _words_at_the_end(early, result))
    try:
        with shielded(TELL_S):
            metrics = _write_metrics(pipeline, glimpses)
        if early is None and (late := ending_signal()) is not None:
            raise late  # it came at the end of the metrics
        if glimpses is not None and early is None:
            _write_report(pipeline)
    except Interrupted as late:
        if early is None:  # in the middle of metrics or drawings
            with shielded():
                logger.warning("%s", _words_at_the_end(late, result))
    return result if metrics is None else replace(result, metrics=metrics)


def _words_at_the_end(signal: Interrupted, result: RunResult) -> str:
    return (
        f"{reason_of(signal)}: what is known was written; plots and report were left out,"
        f" 'trailmark report {shlex.quote(str(result.folder))}' makes them"
    )


def _write_metrics(pipeline: Pipeline, glimpses: Glimpses | None) -> Mapping[str, Any]:
    """Write what a report is made of, and return the metrics."""
    from trailmark.evaluation import evaluate_run, metrics_of
    from trailmark.evaluation.path_file import PATH_FILE, write_path
    from trailmark.evaluation.taught_places import TRUTH_FILE, write_taught_places

    folder, path = pipeline.result.folder, pipeline.path
    assert folder is not None
    assert pipeline.config is not None
    if glimpses is not None:
        glimpses.write(folder)
    if path is not None:
        write_path(path, folder / PATH_FILE)
    if pipeline.true_places is not None:
        write_taught_places(pipeline.true_places, folder / TRUTH_FILE)
    return evaluate_run(folder, metrics=metrics_of(pipeline.config.plugins.registry), path=path)


def _write_report(pipeline: Pipeline) -> None:
    from trailmark.evaluation import metrics_of
    from trailmark.report import write_report

    folder = pipeline.result.folder
    assert folder is not None
    assert pipeline.config is not None
    write_report(folder, metrics=metrics_of(pipeline.config.plugins.registry), path=pipeline.path)
