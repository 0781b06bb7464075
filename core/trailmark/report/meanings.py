"""What the headings of tables mean, in a sentence each: shown on hover, and below the tables."""

from __future__ import annotations

__all__ = ["meaning_of", "meaning_of_counter"]

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
    " Above the interval: too sure. Below: better than they say. Too sure: raise the sigmas in the localizer's config.",
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

#: What the run itself counts, by the whole name, * for the name of a part; a plugin's own are told by its method card.
_COUNTERS = {
    "frames": "Readings of sensors.",
    "control.commands": "What the robot was told to do, by the controller.",
    "source.*.frames": "Its readings.",
    "control.guard_stops": "How often 'stop_when' stopped the robot.",
    "control.stall_stops": "How often the robot was stopped because the run stood still.",
    "teach.loops": "Where the taught path met itself, and was straightened.",
    "teach.waypoints": "Places of the path that were taught.",
    "source.*.perturb.missing": "Readings that were taken away on purpose ('perturb').",
    "source.*.dropped": "Readings that were given up because newer ones came.",
    "localizer.*.overwritten": "Readings that a slow localizer never saw, because newer ones came.",
    "source.*.repeated": "Readings with the stamp of the one before; the second is left out.",
    "source.*.skipped": "Readings that could not be used ('on_bad_frame: skip').",
    "localizer.*.disabled": "It failed, and the run went on without it.",
    "estimator.poses_set": "How often somebody said where the robot is.",
    "estimator.recoveries": "How often the estimator gave its belief up for what nearly all estimates said.",
    "estimator.replayed": "Estimates that were applied again, because one about an earlier instant came after them.",
    "estimator.refused_information": "Estimates whose information is no information: negative, or no number.",
    "estimator.refused_no_information": "Estimates that claim to know nothing.",
    "estimator.repaired_too_certain": "Estimates that claim to be surer than 'floor_m' and 'floor_deg' of the estimator"
    " allow. They were used, as sure as that.",
    "estimator.time_resets": "How often the clock jumped, so that the estimator began anew where the belief was.",
} | {
    f"localizer.*.{status}": _MEANINGS[status] for status in ("accepted", "gated", "late", "refused", "lost", "unused")
}


def meaning_of(title: str) -> str:
    """Return what a heading means; empty where it is known, or a plugin's own."""
    return _MEANINGS.get(title) or _MEANINGS.get(title.partition(" over ")[0], "")


def meaning_of_counter(name: str) -> str:
    """Return what a counter counts, by its dotted name; empty where it is a plugin's own."""
    first, *rest = name.split(".")
    if first in ("source", "localizer"):
        name = ".".join([first, "*", *rest[1:]])
    return _COUNTERS.get(name, "")
