"""What the headings of a bench's tables mean, in a sentence each, shown on hover."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from trailmark.report.tables import Table

__all__ = ["MEANINGS", "explained"]

MEANINGS: Mapping[str, str] = {
    "condition": "What is the same for all that are compared: place, faults, everything but method and seed.",
    "method": "What is compared: a localizer, or a combination of parts.",
    "best": "The method with the best median.",
    "next": "The method with the second best median.",
    "not told apart": "Methods of which more seeds would have to show that they are worse than the best.",
    "95 %": "Interval that holds the median in 95 of 100 cases, by resampling; from three seeds on.",
    "95 % of median": "Interval that holds the median in 95 of 100 cases, by resampling; from three seeds on.",
    "ok": "How many cells gave a result, of those that could be run.",
    "failed": "How many cells gave none: an error, a crash, too long. Each counts as the worst result.",
    "skipped": "How many cells could not be run at all, as without their sensor; they count nowhere.",
    "n": "How many results there are.",
    "median": "Half of the results are better. Of several places it is that of their medians.",
    "quartiles": "Half of the results lie between them.",
    "times baseline": "The median, divided by that of the baseline on the same seeds.",
    "better/worse": "How many seeds were better and worse than the baseline.",
    "p": "How likely a difference from the baseline as large is by chance (Wilcoxon's signed ranks, two-sided).",
    "p Holm": "The same, corrected for as many comparisons as there are rows.",
    "mean rank": "Place among all methods on the same frames, on average; 1 is best.",
    "of": "How many rankings it is the average of.",
    "conditions": "How many conditions the comparison is over.",
    "better than": "How often the method of the row has the better result than that of the column.",
    "state": "What became of the cell: it gave a result, failed, took too long, crashed, or could not be run.",
    "time [s]": "Processor time of the cell.",
    "memory [MB]": "The most that the cell's process held.",
    "reason": "Why there is no result.",
}


def explained(table: Table) -> Table:
    """Return a table whose headings say what they mean."""
    columns = tuple(replace(column, meaning=MEANINGS.get(column.title, "")) for column in table.columns)
    return replace(table, columns=columns)
