"""The paper's remark that the laser alone fails from unknown starts: one scan against the map of the whole room."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Scan
from trailmark.geometry import Pose2, wrap_angle
from trailmark_omni_surf.laser.config import LaserIcpConfig
from trailmark_omni_surf.laser.matching import SearchWindow, match_scan
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_papers.kit import Table, arrays_of, path_of, started_source
from trailmark_papers.tasaki2010.goals import Start, random_starts, start_pose
from trailmark_papers.tasaki2010.place import TaughtPlace

__all__ = ["laser_rows", "match_from_nowhere"]

_N_STARTS, _QUICK_STARTS = 20, 3  # in each place
_RIGHT_M, _RIGHT_RAD = 0.30, math.radians(10.0)


def laser_rows(options: ExperimentOptions, place: TaughtPlace, name: str = "Laser alone, unknown start") -> list[Row]:
    """Return how often a scan alone finds the place, and how often it believes a wrong one."""
    n = _QUICK_STARTS if options.quick else _N_STARTS
    starts = random_starts(path_of(place.store), n, options.seed + 300)  # those of the drives to the goal
    calls = [
        (place.store, place.source(), starts[k :: options.jobs], options.seed) for k in range(min(n, options.jobs))
    ]
    found = [one for part in options.map(match_from_nowhere, calls) for one in part]
    right, wrong = found.count("right"), found.count("wrong")
    options.report(f"laser alone: {right} right, {wrong} wrong, {n - right - wrong} refused, of {n}")
    table = Table(name, n)
    note = "one scan, every start pose of the room tried (0.2 m, 4 deg); the paper: it fails"
    table.add_higher("right place (0.3 m, 10 deg)", "%", 100 * right / n, note=note)
    table.add("believed a wrong place", "%", 100 * wrong / n)
    table.add("refused as ambiguous or unfitting", "%", 100 * (n - right - wrong) / n)
    return table.rows


def match_from_nowhere(store: Path, source: Mapping[str, Any], starts: Sequence[Start], seed: int) -> list[str]:
    """Return "right", "wrong" or "refused" for a scan from each start.

    Parameters
    ----------
    source : mapping
        Config of the simulator.
    """
    saved = arrays_of(store, "laser", "map")
    scan_map = ScanMap.from_points(saved["points"], saved["normals"])
    low, high = scan_map.points.min(axis=0), scan_map.points.max(axis=0)
    span_m = float((high - low).max()) / 2.0
    window = SearchWindow(span_m=span_m, span_rad=math.pi, n_coarse=60, n_fine=16)
    middle = Pose2(float(low[0] + high[0]) / 2.0, float(low[1] + high[1]) / 2.0, 0.0)
    rules = LaserIcpConfig.model_validate({"laser": "laser"})
    found = []
    for k, start in enumerate(starts):
        match = match_scan(scan_map, _scan(source, start, seed + k), middle, window)
        is_clear = match.runner_up_cost_m - match.cost_m >= rules.ambiguity_margin_m
        if match.inlier_share < rules.min_inlier_share or not is_clear:
            found.append("refused")
            continue
        true, said = start_pose(start), match.pose_map_base
        is_right = true.distance_to(said) <= _RIGHT_M and abs(wrap_angle(true.between(said).theta)) <= _RIGHT_RAD
        found.append("right" if is_right else "wrong")
    return found


def _scan(source: Mapping[str, Any], start: Start, seed: int) -> Any:
    """Return the points of one scan from a place, in base axes, (N, 2) [m]."""
    config = {**source, "sensors": ["wheels", "laser"], "driver": "commands", "duration_s": 0.2, "start": list(start)}
    with started_source(config, seed) as robot:
        mounting = robot.sensors["laser"].pose_base_sensor.planar()
        scan = next(frame.payload for frame in robot.frames() if isinstance(frame.payload, Scan))
    points = scan.points()
    return mounting @ points[np.hypot(*points.T) < scan.range_max_m]
