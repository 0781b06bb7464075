"""The sections of the page. Each returns HTML, or nothing where the run has nothing to show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape
from importlib.resources import files
from typing import Any

from trailmark.evaluation import FUSED, GROUND_TRUTH, RunEvaluation
from trailmark.report.html import (
    counters_html,
    data_html,
    facts_html,
    figure_html,
    meanings_html,
    notes_html,
    table_html,
    text_html,
)
from trailmark.report.numbers import significant
from trailmark.report.tables import (
    Trajectories,
    consistency_table,
    offsets_table,
    sources_table,
    starting_table,
    timing_table,
    trajectories_table,
)

__all__ = [
    "configuration_section",
    "counters_section",
    "details_section",
    "explorer_section",
    "header_section",
    "localizers_section",
    "plots_section",
    "provenance_section",
    "result_section",
    "timing_section",
]

Document = Mapping[str, Any]

_GOOD = ("done", "stopped")
_STATUS = {
    "done": "Done",
    "stopped": "Stopped",
    "interrupted": "Interrupted",
    "failed": "Failed",
    "running": "Cut off while it ran",
}
#: Drawings that the page's script replaces by the map and the time axis.
_IN_EXPLORER = ("trajectories", "errors", "offsets", "outcomes")
#: Keys of ``run.json`` that stand elsewhere on the page.
_SHOWN_ELSEWHERE = ("status", "reason", "counters", "files")


def header_section(evaluated: RunEvaluation) -> str:
    """Return the name of the run, how it ended, and one line of what it was."""
    run = evaluated.run.run
    status = str(run.get("status", ""))
    word = _STATUS.get(status, status.capitalize() or "No run.json: the run was cut off")
    css_class = "status" if status in _GOOD else "status bad"
    reason = f": {run['reason']}" if run.get("reason") else ""
    line = f'<span class="{css_class}">{escape(word)}</span>{escape(reason)}. {escape(_summary(evaluated))}'
    return f'<header>\n{text_html(evaluated.run.name, "h1")}\n<p class="summary">{line}</p>\n</header>'


def result_section(evaluated: RunEvaluation, document: Document) -> str:
    """Return the table of metrics."""
    parts = [text_html(_result_title(evaluated), "h2")]
    trajectories = Trajectories.of_run(document)
    if not trajectories.documents:
        parts.append(text_html("The run left no trajectory."))
    else:
        table = trajectories_table(trajectories)
        parts += [table_html(table), meanings_html([table])]
    offsets = offsets_table([((name,), item) for name, item in document["sources"].items()])
    if offsets is not None:
        parts += [text_html(offsets.title, "h2"), table_html(offsets)]
    told = [f"{item['about'] or 'The run'}: {item['fact']}; {item['remedy']}." for item in document["warnings"]]
    parts += [text_html(problem, css_class="warning") for problem in [*told, *document["problems"]]]
    return "\n".join(parts)


def explorer_section(document: Mapping[str, Any] | None) -> str:
    """Return the place of the map and the time axis, which the page's script fills; without it, it stays hidden."""
    if document is None:
        return ""
    place = files("trailmark.report").joinpath("explorer.html").read_text(encoding="utf-8")
    return place.replace("<!-- data -->", data_html("explorer-data", document)).rstrip()


def plots_section(plots: Mapping[str, str], evaluated: RunEvaluation) -> str:
    """Return the drawings, two beside each other where the screen is wide enough.

    What the map and the time axis show as well is there for readers without a script alone.
    """
    captions = _captions(evaluated)
    figures = {name: figure_html(svg, *captions[name]) for name, svg in plots.items()}
    still = [figure for name, figure in figures.items() if name in _IN_EXPLORER]
    own = [figure for name, figure in figures.items() if name not in _IN_EXPLORER]
    parts = [_grid(own)] if own else []
    if still:
        parts.append(f"<noscript>\n{_grid(still)}\n</noscript>")
    return "\n".join(parts)


def _grid(figures: Sequence[str]) -> str:
    return '<div class="plots">\n' + "\n".join(figures) + "\n</div>"


def localizers_section(document: Document) -> str:
    """Return what became of the estimates of each localizer, and how well their covariances fit."""
    sources = [((name,), item) for name, item in document["sources"].items()]
    if not sources:
        return ""
    tables = [sources_table(sources)]
    parts = [text_html("Estimates", "h2"), table_html(tables[0])]
    parts.append(notes_html(["Age: from the instant an estimate is about to its arrival."]))
    consistency = consistency_table(sources)
    if consistency is not None:
        parts += [text_html("Consistency of the covariances", "h2"), table_html(consistency)]
        parts.append(notes_html([_consistency_note(document)]))
        tables.append(consistency)
    parts.append(meanings_html(tables))
    return "\n".join(parts)


def timing_section(timing: Document) -> str:
    """Return the durations of every stage."""
    stages = timing.get("stages")
    if not stages:
        return ""
    parts = [text_html("Time per stage", "h2"), table_html(timing_table(stages))]
    starting = starting_table(stages)
    if starting is not None:
        parts += [text_html("What starting took", "h3"), table_html(starting)]
    memory = timing.get("peak_rss_mb")
    if memory is not None:
        parts.append(notes_html([f"Peak memory: {significant(float(memory))} MB."]))
    return "\n".join(parts)


def counters_section(run: Document) -> str:
    """Return everything that was counted."""
    counters = run.get("counters")
    return "\n".join([text_html("Counters", "h2"), counters_html(counters)]) if counters else ""


def configuration_section(config_text: str) -> str:
    """Return the resolved config."""
    if not config_text.strip():
        return ""
    return f"{text_html('Configuration', 'h2')}\n<pre><code>{escape(config_text.rstrip())}</code></pre>"


def provenance_section(run: Document) -> str:
    """Return what the run was made with."""
    facts = {name: value for name, value in run.items() if name not in _SHOWN_ELSEWHERE and value not in (None, {}, "")}
    return "\n".join([text_html("Provenance", "h2"), facts_html(facts)]) if facts else ""


def details_section(document: Document) -> str:
    """Return every metric under its full name."""
    rows = [
        f'<tr><th scope="row">{escape(name)}</th><td><code>{escape(metric)}</code></td>'
        f'<td class="number">{escape(significant(value, 4))}</td></tr>'
        for group in ("trajectories", "sources")
        for name, item in document[group].items()
        for metric, value in item.get("metrics", {}).items()
    ]
    if not rows:
        return ""
    head = (
        '<tr><th scope="col" title="A trajectory or a localizer.">of</th>'
        '<th scope="col" title="In brackets: how it was aligned, and over how many poses.">metric</th>'
        '<th scope="col" class="number" title="In the unit that stands in the name.">value</th></tr>'
    )
    table = f"<table>\n<thead>{head}</thead>\n<tbody>\n" + "\n".join(rows) + "\n</tbody>\n</table>"
    title = "All metrics with their protocols, as in metrics.json"
    return f'<details>\n<summary>{title}</summary>\n<div class="scroll">{table}</div>\n</details>'


def _summary(evaluated: RunEvaluation) -> str:
    run, timing = evaluated.run.run, evaluated.run.timing
    facts = [str(run["mode"]).capitalize()] if run.get("mode") else []
    facts += [f"pace {run['pace']}"] if run.get("pace") else []
    facts += [f"seed {run['seed']}"] if run.get("seed") is not None else []
    frames, wall_s = timing.get("frames"), timing.get("wall_s")
    if frames and wall_s:
        rate = significant(frames / wall_s)
        facts.append(f"{frames} frames in {significant(float(wall_s))} s ({rate} a second)")
    if run.get("started"):
        facts.append(f"started {_instant(str(run['started']))}")
    return ", ".join(facts) + "." if facts else ""


def _instant(text: str) -> str:
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{when.day} {when:%B %Y, %H:%M %Z}".strip()


def _result_title(evaluated: RunEvaluation) -> str:
    if evaluated.has_truth:
        return "Errors against ground truth"
    return f"Differences from {evaluated.reference}" if evaluated.evaluations else "Trajectories"


def _captions(evaluated: RunEvaluation) -> dict[str, tuple[str, str]]:
    if evaluated.has_truth:
        aligned = f"{_alignment(evaluated)} over ground truth; a dot marks each start"
        over_time = ("Errors over time", "distance from the true position, and turn from the true heading")
    else:
        aligned = "in the map; a dot marks each start"
        over_time = ("Differences over time", f"from {evaluated.reference}; there is no ground truth")
    return {
        "trajectories": ("Trajectories", aligned),
        "errors": over_time,
        "offsets": ("Offset from the taught path", "as it is remembered; left is positive"),
        "outcomes": ("Estimates over time", "share of each outcome; blank where nothing was said"),
        "distribution": (
            "How large the errors are" if evaluated.has_truth else "How large the differences are",
            "a dot marks the median, the box half of all, the line 95 %",
        ),
    }


def _alignment(evaluated: RunEvaluation) -> str:
    used = sorted({item.absolute.alignment.used for item in evaluated.evaluations.values()})
    return {"none": "as they are", "origin": "laid on the first pose"}.get(" ".join(used), "aligned by least squares")


def _consistency_note(document: Document) -> str:
    note = (
        "Squared errors in units of the stated covariance, per degree of freedom: 1 is expected, within the interval"
        " in 95 of 100 runs. NIS: against the belief, gated estimates included."
    )
    if any(item["nees"] for item in document["sources"].values()):
        note += (
            " NEES: against the ground truth, whose own noise counts as the localizer's, places as they are in the map."
        )
    if document["map_frame"]:
        note += f" But {document['map_frame']}."
    return note


def shown_trajectories(evaluated: RunEvaluation) -> list[str]:
    """Return the names in the order in which they are drawn and coloured."""
    names = [name for name in evaluated.run.trajectories if name != FUSED]
    spoke = [name for name in evaluated.sources if name not in names and name != FUSED]
    return [GROUND_TRUTH, *names, *spoke, FUSED]
