"""Figs. 14 and 15 without driving the course: ``python -m trailmark_papers.nagai2015.campus FOLDER``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.experiments import ExperimentOptions
from trailmark_papers.kit import started_source, world_of
from trailmark_papers.nagai2015.ground_pictures import draw_ground, draw_labelled_path, look_at_ground
from trailmark_papers.nagai2015.runs import course

__all__ = ["draw_campus", "route_of"]

_LENGTH_M, _STEP_M = 243.4, 0.25
_PAGE = """![Fig. 14: the path over the campus with the points A to J](figure_14_labelled_path.svg)

![Fig. 15: what the camera sees of the ground at A to J](figure_15_ground.svg)
"""


def route_of(world_seed: int) -> Floats:
    """Return the route of the long course, (N, 2) [m]."""
    with started_source(course("outdoor", world_seed, sensors=["wheels"])) as source:
        route = world_of(source).routes["outdoor"]
        return np.array([route.pose_at(station_m).array()[:2] for station_m in np.arange(0.0, _LENGTH_M, _STEP_M)])


def draw_campus(out: Path) -> None:
    """Draw both figures of the first place into a folder, with a page that shows them."""
    options = ExperimentOptions(quick=False, seed=0, out=out, report=print)
    points = look_at_ground(options)
    draw_labelled_path(out / "figure_14_labelled_path.svg", route_of(options.world_seed), points)
    draw_ground(out / "figure_15_ground.svg", points)
    (out / "figures.md").write_text(_PAGE, encoding="utf-8")


if __name__ == "__main__":
    draw_campus(Path(sys.argv[1]))
