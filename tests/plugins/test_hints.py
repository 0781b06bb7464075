"""The nearest right name, for messages: one, all, or the nearest of very many."""

from __future__ import annotations

import pytest

from trailmark.plugins.hints import nearest_or_all

MANY = [f"part_{number}" for number in range(50)] + ["laser_icp", "grid_mcl", "pose_fixes"]


@pytest.mark.parametrize(
    ("name", "known", "said"),
    [
        ("lazer_icp", MANY, " (did you mean 'laser_icp'?)"),
        ("sonar", ["laser", "floor"], "; keys: laser, floor"),
        ("sonar", [], "; keys: none"),
    ],
)
def test_one_name_is_near_or_all_are_told(name: str, known: list[str], said: str) -> None:
    assert nearest_or_all(name, known, "keys") == said


def test_of_very_many_names_the_three_nearest_are_told() -> None:
    assert nearest_or_all("my_grid_maps2", MANY, "keys") == "; nearest of 53 keys: grid_mcl"
    assert nearest_or_all("xyz", MANY, "keys") == "; there are 53 keys"
