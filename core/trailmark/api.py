"""From Python, the same things as from the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from trailmark.pipeline import Pipeline, RunRequest, RunResult, Step, link_latest, new_folder

if TYPE_CHECKING:
    from trailmark.config import RunConfig
    from trailmark.pipeline.request import RunKeywords
    from trailmark.plugins import Plugins
    from trailmark.report.glimpses import Glimpses

__all__ = ["create", "run"]


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
    return _evaluated(pipeline, glimpses)


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
    from trailmark.config.explain import validated
    from trailmark.plugins import load_plugins

    spec = (plugins or load_plugins()).registry.find(kind, name)
    document = Document(config, name=f"{kind} {name!r}")
    problems = Problems(document)
    settings = validated(spec.load_config(), config, (), problems, document.base_dir)
    problems.raise_if_any()
    return spec.construct(settings)


def _evaluated(pipeline: Pipeline, glimpses: Glimpses | None) -> RunResult:
    from trailmark.evaluation import evaluate_run, metrics_of

    result = pipeline.result
    assert result.folder is not None
    assert pipeline.config is not None
    extra = metrics_of(pipeline.config.plugins.registry)
    metrics = evaluate_run(result.folder, metrics=extra, path=pipeline.path)
    if glimpses is not None:
        from trailmark.report import write_report

        glimpses.write(result.folder)
        write_report(result.folder, metrics=extra, path=pipeline.path)
    return replace(result, metrics=metrics)
