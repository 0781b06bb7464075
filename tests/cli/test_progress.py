"""How far a run is."""

from __future__ import annotations

import pytest

from trailmark.cli.progress import way_text


def test_where_the_path_is_known_its_share_and_the_time_left_are_told() -> None:
    assert way_text(3.0, 12.0, 10.0) == "3.00 of 12.00 m (25 %, 30 s left)"


@pytest.mark.parametrize(("travelled_m", "whole_m"), [(3.0, None), (0.0, 12.0), (12.5, 12.0)])
def test_where_nothing_can_be_foreseen_the_way_alone_is_told(travelled_m: float, whole_m: float | None) -> None:
    assert way_text(travelled_m, whole_m, 10.0) == f"{travelled_m:.2f} m"
