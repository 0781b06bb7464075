"""What counters mean: those of the run are told, those of plugins are not guessed."""

from __future__ import annotations

import pytest

from trailmark.report.meanings import meaning_of_counter


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("frames", "Readings of sensors."),
        ("source.robot.repeated", "second is left out"),
        ("source.robot.perturb.missing", "on purpose"),
        ("localizer.lost.lost", "could not say"),
        ("estimator.replayed", "applied again"),
        ("control.commands", "by the controller"),
    ],
)
def test_what_the_run_counts_is_told(name: str, told: str) -> None:
    assert told in meaning_of_counter(name)


@pytest.mark.parametrize(
    "name",
    [
        "perturb.repeated.repeated",
        "source.robot.perturb.repeated.repeated",
        "source.robot.received.poses",
        "localizer.mine.frames",
        "localizer.x.mean",
        "localizer.x.own.lost",
        "source",
        "",
    ],
)
def test_what_a_plugin_counts_is_not_guessed(name: str) -> None:
    assert meaning_of_counter(name) == ""
