"""``trailmark report``: metrics, plots and report of a run, anew from what the run left in its folder."""

from __future__ import annotations

from pathlib import Path

import click

from trailmark.cli.root import plugins_of

__all__ = ["report_command"]


@click.command("report")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.pass_context
def report_command(context: click.Context, folder: Path) -> None:
    """Make metrics.json, plots and report.html of the run in DIR anew.

    For a run that was interrupted, which has no time for them, or one with --no-report. The folder of a run that was
    killed is read too, as far as it goes. Of a run that came to its end they are the same, to the byte.
    """
    from trailmark.evaluation import evaluate_run, metrics_of, read_run
    from trailmark.report import write_report

    metrics = metrics_of(plugins_of(context).registry)
    path = read_run(folder).path_taught
    evaluate_run(folder, metrics=metrics, path=path)
    write_report(folder, metrics=metrics, path=path)
    click.echo(f"{folder / 'report.html'}")
