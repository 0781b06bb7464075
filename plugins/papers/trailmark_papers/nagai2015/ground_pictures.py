"""Figs. 14 and 15: the path over the campus with labelled points, and what the camera sees of the ground there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from trailmark.arrays import Floats, Grey8
from trailmark.experiments import ExperimentOptions
from trailmark.frames import Image
from trailmark.geometry import Pose2
from trailmark.report.drawing import BLUE, INK, drawing
from trailmark_papers.kit import started_source, world_of
from trailmark_papers.kit.jpegs import with_jpegs
from trailmark_papers.nagai2015.runs import course

__all__ = ["STATIONS_M", "GroundPoint", "draw_ground", "draw_labelled_path", "look_at_ground"]

#: One on each stretch of the course, in its order [m].
STATIONS_M = (10.0, 40.0, 77.0, 107.0, 124.0, 145.0, 166.0, 188.0, 211.0, 230.0)
_COLUMNS = 5


@dataclass(frozen=True, slots=True, eq=False)
class GroundPoint:
    """A labelled point of the path.

    Attributes
    ----------
    pose : Pose2
        Where it is, along the path.
    picture : (H, W) uint8
        What the camera sees there.
    """

    pose: Pose2
    picture: Grey8


def look_at_ground(options: ExperimentOptions, stations_m: tuple[float, ...] = STATIONS_M) -> dict[str, GroundPoint]:
    """Return the labelled points, by their letters."""
    with started_source(course("outdoor", options.world_seed, sensors=["wheels"])) as source:
        route = world_of(source).routes["outdoor"]
    poses = [route.pose_at(station_m) for station_m in stations_m]
    return {chr(ord("A") + k): GroundPoint(pose, _picture(options, pose)) for k, pose in enumerate(poses)}


def _picture(options: ExperimentOptions, pose: Pose2) -> Grey8:
    start = [pose.x, pose.y, math.degrees(pose.theta)]
    source = course("outdoor", options.world_seed, start=start, driver="commands", duration_s=0.1)
    with started_source(source, options.seed, "floor") as floor:
        pictures = (frame.payload.pixels for frame in floor.frames() if isinstance(frame.payload, Image))
        return next(pictures)


def draw_labelled_path(path: Path, way: Floats, points: Mapping[str, GroundPoint]) -> None:
    """Draw Fig. 14; `way` (N, 2) is the taught path [m]."""
    with drawing(path, 5.2) as (_, axes):
        axes.plot(*way.T, color=BLUE, linewidth=1.4)
        for letter, point in points.items():
            axes.plot(point.pose.x, point.pose.y, "o", color=INK, markersize=4.0)
            axes.annotate(letter, (point.pose.x, point.pose.y), xytext=(4, 4), textcoords="offset points")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title("recorded path and labelled points, y [m]")
        axes.set_xlabel("x [m]")


def draw_ground(path: Path, points: Mapping[str, GroundPoint]) -> None:
    """Draw Fig. 15: the pictures of the labelled points."""
    rows = math.ceil(len(points) / _COLUMNS)
    with drawing(path, 1.6 * rows, rows, _COLUMNS) as (figure, _):
        for axes in figure.axes:
            axes.set_axis_off()
        for axes, (letter, point) in zip(figure.axes, points.items()):
            # Half the resolution: the figure is small.
            axes.imshow(point.picture[::2, ::2], cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axes.set_title(letter)
    path.write_text(with_jpegs(path.read_text(encoding="utf-8")), encoding="utf-8")
