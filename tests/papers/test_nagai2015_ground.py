"""Figs. 14 and 15: labelled points of the campus, and what the camera sees there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.experiments import ExperimentOptions
from trailmark_papers.nagai2015.campus import route_of
from trailmark_papers.nagai2015.ground_pictures import GroundPoint, draw_ground, draw_labelled_path, look_at_ground

CONCRETE_M, PAVERS_M = 10.0, 40.0


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> dict[str, GroundPoint]:
    options = ExperimentOptions(quick=False, seed=0, out=tmp_path_factory.mktemp("ground"), report=lambda line: None)
    return look_at_ground(options, (CONCRETE_M, PAVERS_M))


def test_points_lie_on_the_course_in_the_order_of_their_letters(points: dict[str, GroundPoint]) -> None:
    assert list(points) == ["A", "B"]
    assert points["A"].pose.x == pytest.approx(10.0)  # the course begins with 20 m straight on
    assert np.hypot(points["B"].pose.x, points["B"].pose.y) == pytest.approx(40.0, abs=2.0)


def test_pictures_of_other_stretches_show_other_ground(points: dict[str, GroundPoint]) -> None:
    concrete, pavers = (point.picture.astype(float) for point in points.values())

    assert concrete.shape == pavers.shape == (480, 512)
    assert abs(concrete.mean() - pavers.mean()) > 5.0 or abs(concrete.std() - pavers.std()) > 2.0


def test_both_figures_are_drawn_with_every_letter(points: dict[str, GroundPoint], tmp_path: Path) -> None:
    draw_labelled_path(tmp_path / "map.svg", np.array([[0.0, 0.0], [10.0, 0.0], [40.0, 3.0]]), points)
    draw_ground(tmp_path / "ground.svg", points)

    for name in ("map.svg", "ground.svg"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert ">A<" in text
        assert ">B<" in text
    assert (tmp_path / "ground.svg").read_text(encoding="utf-8").count("<image") == 2
    assert "image/png" not in (tmp_path / "ground.svg").read_text(encoding="utf-8")


def test_the_labelled_points_lie_on_the_route(points: dict[str, GroundPoint]) -> None:
    way = route_of(1)

    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(243.25, abs=0.1)
    for point in points.values():
        assert np.hypot(*(way - (point.pose.x, point.pose.y)).T).min() < 0.13
