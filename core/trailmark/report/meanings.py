"""What the headings of tables mean, in a sentence each: shown on hover, and below the tables."""

from __future__ import annotations

__all__ = ["meaning_of"]

_MEANINGS = {
    "trajectory": "That of each localizer alone; fused, that of the estimator, which weighs them all; standstill, that"
    " of who never moves, to compare with.",
    "localizer": "By its name in the config.",
    "poses": "How many poses the trajectory has.",
    "tracked": "Share of the time of the run in which the trajectory knew a pose.",
    "ATE rmse": "Absolute trajectory error: distance from the true position after the alignment, root mean square.",
    "max": "The largest distance from the true position.",
    "heading rmse": "Turn from the true heading, root mean square.",
    "RPE": "Relative pose error: how wrong the motion over this distance is, root mean square. It does not see where"
    " the error began, as the absolute error does.",
    "drift": "Error at the end of a piece of way, in percent of its length, averaged over pieces.",
    "end error": "Distance from the true position at the end, aligned at the start alone. After a gap in which a"
    " localizer was blind it holds all that was missed.",
    "answered": "Share of the frames to which the localizer gave an answer.",
    "silent": "Share of answers that were wrong by far more than they stated: errors that nobody was told of.",
    "estimates": "What the localizer said, 'lost' included.",
    "accepted": "The estimator used it.",
    "gated": "It contradicts the belief too much to be used (chi-square test).",
    "late": "Older than what the estimator can still correct.",
    "refused": "Malformed: no number, negative information, a stamp that cannot be.",
    "lost": "The localizer looked and could not say.",
    "unused": "The config does not use this localizer, or there was nothing to use.",
    "age p50": "Time from the instant an estimate is about to its arrival, median.",
    "age p95": "Time from the instant an estimate is about to its arrival, 95 % are faster.",
    "age max": "Time from the instant an estimate is about to its arrival, the longest.",
    "NIS of": "How many estimates were compared with the belief.",
    "NIS/dof": "Normalised innovation squared: how much estimates differ from the belief, in units of what both state."
    " Above the interval: too sure. Below: surer than they say. Too sure: raise the sigmas in the localizer's config.",
    "NEES of": "How many estimates were compared with the truth.",
    "NEES/dof": "Normalised estimation error squared: how wrong estimates are, in units of what they state. 1 is"
    " honest, above is too sure; errors that are shared from frame to frame, as of a scale, count again each time.",
    "expected": "Where the number lies in 95 of 100 runs if the covariances are right.",
    "along rmse": "Error along the taught path, root mean square.",
    "lateral rmse": "Error across the taught path, root mean square.",
    "stage": "What the run calls for each frame: sources, localizers, the estimator, the controller, sinks.",
    "part": "What was started before the first frame.",
    "took": "Time until it had started.",
    "calls": "How often it was called.",
    "mean": "Time of a call, on average.",
    "p50": "Half of the calls were faster.",
    "p95": "95 % of the calls were faster.",
    "p99": "99 % of the calls were faster.",
}


def meaning_of(title: str) -> str:
    """Return what a heading means; empty where it is known, or a plugin's own."""
    return _MEANINGS.get(title) or _MEANINGS.get(title.partition(" over ")[0], "")
