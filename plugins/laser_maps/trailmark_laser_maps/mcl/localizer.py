"""The localizer ``grid_mcl``: where a planar laser is on an occupancy grid, found without a start pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError, StoreError
from trailmark.estimates import Belief, Estimate, Fix, Lost, information_from_covariance
from trailmark.frames import Frame, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.paths import Keyframe
from trailmark_laser_maps.carving import PlacedScan, carve_grid
from trailmark_laser_maps.grid import OccupancyGrid
from trailmark_laser_maps.map_yaml import read_map
from trailmark_laser_maps.mcl.config import GridMclConfig
from trailmark_laser_maps.mcl.field import GridField
from trailmark_laser_maps.mcl.filter import FilterSettings, GridFilter, Placed, Unplaced
from trailmark_laser_maps.mcl.hypotheses import ScanLook
from trailmark_laser_maps.mcl.particles import MotionNoise

__all__ = ["GridMcl"]

_MIN_POINTS = 20  # fewer returns say nothing about a place
_GRID = "grid"


class GridMcl(Localizer):
    """Particles on a map: a `Fix` where one place explains the scans, `Lost` where none or more than one does.

    The motion between scans is that of the belief, from whatever localizer gives `Motion`.
    """

    config: GridMclConfig

    def start(self, session: Session) -> None:
        """Read the map, and make its field."""
        self._mode, self._localizer_map = session.mode, session.map
        self._pose_base_laser = session.sensors[self.config.laser].pose_base_sensor.planar()
        self._last_keyframe: tuple[float, Pose2] | None = None
        self._counted = {"looks": 0, "found": 0}
        self._is_placed = False
        self._field: GridField | None = None
        grid = self._read_grid() if self._mode != "teach" else None
        if grid is None:
            return
        self._field = GridField.of(grid)
        self._filter = GridFilter(self._field, self._settings(), session.rng)
        if session.start_pose is not None:
            sigmas = self.config.start_sigma_m, self.config.start_sigma_m, math.radians(self.config.start_sigma_deg)
            in_grid = grid.pose_map_grid.inverse() @ session.start_pose
            self._filter.believe(in_grid.array(), np.diag(np.square(sigmas)))

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return a `Fix`, `Lost`, or nothing while the robot has not moved."""
        if not isinstance(frame.payload, Scan):
            raise ShapeError(f"grid_mcl takes scans, but sensor {frame.sensor!r} gave {type(frame.payload).__name__}")
        points_base = self._points(frame.payload)
        if self._mode == "teach":
            self._teach(frame.stamp_s, points_base, belief)
            return ()
        if self._field is None:
            return [Lost(frame.stamp_s, "no map: none is named by the key map, and nothing was taught here")]
        if len(points_base) < _MIN_POINTS:
            return [Lost(frame.stamp_s, f"only {len(points_base)} returns")]
        return self._localize(self._field, frame.stamp_s, points_base, belief)

    def finish(self) -> None:
        """Draw the grid of the remembered scans and save it."""
        if self._localizer_map is None or not (keyframes := self._localizer_map.keyframes()):
            return
        laser = (self._pose_base_laser.x, self._pose_base_laser.y)
        placed = [
            PlacedScan.at(keyframe.pose_map_base, keyframe.arrays["points"].astype(np.float64), laser)
            for keyframe in keyframes
        ]
        grid = carve_grid(placed, resolution_m=self.config.resolution_m, min_hits=min(2, len(placed)))
        corner = np.array([*grid.pose_map_grid.array(), grid.resolution_m])
        self._localizer_map.save(_GRID, {"cells": grid.cells, "corner": corner})

    def counters(self) -> Mapping[str, int]:
        """Return how many looks were taken, and how often a place was found."""
        return dict(self._counted)

    def _settings(self) -> FilterSettings:
        config = self.config
        across = MotionNoise().along if config.motion == "holonomic" else MotionNoise().across
        return FilterSettings(
            noise=MotionNoise(across=across),
            n_start=config.n_start,
            n_search=config.n_search,
            n_fewest=config.n_fewest,
            n_most=config.n_most,
            min_quality=config.min_quality,
            margin=config.margin,
        )

    def _read_grid(self) -> OccupancyGrid | None:
        if self.config.map is not None:
            return read_map(self.config.map)
        return _load_grid(self._localizer_map) if self._localizer_map is not None else None

    def _points(self, scan: Scan) -> Floats:
        return self._pose_base_laser @ scan.points_within(self.config.max_range_m)

    def _teach(self, stamp_s: float, points_base: Floats, belief: Belief) -> None:
        """Remember the scan where the robot is believed to be, every so far."""
        pose = belief.pose_map_base
        if pose is None or len(points_base) < _MIN_POINTS or self._localizer_map is None:
            return
        if self._last_keyframe is not None:
            station_m, last = self._last_keyframe
            turned = abs(last.between(pose).theta) >= math.radians(self.config.keyframe_deg)
            if belief.travelled_m - station_m < self.config.keyframe_m and not turned:
                return
        self._last_keyframe = belief.travelled_m, pose
        arrays = {"points": points_base.astype(np.float32)}
        self._localizer_map.add(Keyframe(belief.travelled_m, stamp_s, pose, arrays))

    def _localize(self, field: GridField, stamp_s: float, points_base: Floats, belief: Belief) -> list[Estimate]:
        chosen = np.linspace(0, len(points_base) - 1, min(self.config.n_rays, len(points_base))).astype(int)
        laser = np.array([self._pose_base_laser.x, self._pose_base_laser.y])
        look = ScanLook(belief.pose_odom_base, np.ascontiguousarray(points_base[chosen]), laser)
        hint = None if belief.pose_map_base is None else field.pose_map_grid.inverse() @ belief.pose_map_base
        answer = self._filter.update(look, None if hint is None else hint.array())
        if answer is None:
            return []
        self._counted["looks"] += 1
        self._counted["found"] += isinstance(answer, Placed) and not self._is_placed
        self._is_placed = isinstance(answer, Placed)
        if isinstance(answer, Unplaced):
            return [Lost(stamp_s, answer.reason, {"quality": answer.quality, "n_places": float(answer.n_places)})]
        return [self._fix(field, stamp_s, answer)]

    def _fix(self, field: GridField, stamp_s: float, placed: Placed) -> Fix:
        turn = np.eye(3)
        cos, sin = math.cos(field.pose_map_grid.theta), math.sin(field.pose_map_grid.theta)
        turn[:2, :2] = [[cos, -sin], [sin, cos]]
        sigmas = self.config.map_sigma_m, self.config.map_sigma_m, math.radians(self.config.map_sigma_deg)
        covariance = turn @ placed.covariance @ turn.T + np.diag(np.square(sigmas))
        pose = field.pose_map_grid @ Pose2.from_array(placed.pose)
        details = {"quality": placed.quality}
        return Fix(stamp_s, pose, information_from_covariance((covariance + covariance.T) / 2.0), details)


def _load_grid(localizer_map: LocalizerMap) -> OccupancyGrid | None:
    saved = localizer_map.load(_GRID)
    if saved is None:
        return None
    try:
        x, y, theta, resolution_m = saved["corner"].tolist()
        return OccupancyGrid(np.asarray(saved["cells"], np.int8), resolution_m, Pose2(x, y, theta))
    except (KeyError, ValueError) as error:
        raise StoreError(f"the grid in the store cannot be read ({error}): teach the place again") from error
