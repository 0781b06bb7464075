"""How a camera looks at a scene: through which lens, from where, and over what time."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.lenses import Lens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.view import SceneView
from trailmark_sim.render.viewpoints import Moment, moments_between
from trailmark_sim.sensors.shutter import GLOBAL_SHUTTER, STEADY, Shaking, Shutter, poses_after, viewpoints_after
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState

__all__ = ["Sight", "pose_map_sensor"]

#: A smear of less than this is not rendered: the lens' own blur hides it [px].
_SMEAR_PX = 0.5
_MOST_INSTANTS = 15
#: Nothing that a camera sees is taken to be nearer than this when the smear is estimated [m].
_NEAR_M = 0.3
#: Between moments that are this far apart, people are taken to move straight on [s].
_STEP_S = 0.01


def pose_map_sensor(state: VehicleState, mounting: Pose3, shaking: Shaking = STEADY) -> Pose3:
    """Return where a sensor looks from."""
    return Pose3.from_planar(state.pose_map_base) @ shaking.at(state.travelled_m) @ mounting


class Sight:
    """Light and ranges as a moving camera sees them.

    While it exposes and reads, the vehicle is taken to keep the twist that it has at the stamp.

    Parameters
    ----------
    stage : Stage
        What it sees.
    lens : Lens
        Rays of its pixels.
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    shutter : Shutter
        When it sees each row, and for how long.
    shaking : Shaking
        How the floor shakes it.
    """

    def __init__(
        self,
        stage: Stage,
        lens: Lens,
        mounting: Pose3,
        *,
        shutter: Shutter = GLOBAL_SHUTTER,
        shaking: Shaking = STEADY,
    ) -> None:
        directions, self.mask = lens.directions()
        self.table = ray_table(directions, self.mask)
        self._rows = ray_table(directions, self.mask, by_row=True) if shutter.readout_s > 0.0 else self.table
        self._after_s = shutter.rows_after_s(lens.height) if shutter.readout_s > 0.0 else np.zeros(1)
        self._stage, self._scene, self._mounting = stage, stage.build_scene(), mounting
        self._moment_at, self._threads = stage.moment_at, stage.threads
        self._shutter, self._shaking = shutter, shaking

    def view(self, stamp_s: float, state: VehicleState) -> SceneView:
        """Return what is before the lens in the middle of the exposure, each row at its own time."""
        moment = self._moment_at(stamp_s, state.pose_map_base)
        if self._shutter.readout_s == 0.0 or (_stands(state) and moment.is_empty):
            pose = pose_map_sensor(state, self._mounting, self._shaking)
            return SceneView(self._scene, self.table, pose, moment, self._threads)
        return self._view_after(stamp_s, state, 0.0)

    def radiance(self, view: SceneView, stamp_s: float, state: VehicleState) -> Float32s:
        """Return the light of every pixel, (H, W, 3): the mean over the exposure around a view."""
        light = view.radiance()
        n = self._n_instants(view, stamp_s, state)
        for i in range(n):
            if i != n // 2:  # that is the view itself
                after_s = self._shutter.exposure_s * ((i + 0.5) / n - 0.5)
                light += self._view_after(stamp_s, state, after_s).radiance()
        # Light adds up: less of all lamps is less of every pixel.
        for share in (1.0 / n, self._stage.light_at(stamp_s)):
            if share != 1.0:
                light *= np.float32(share)
        return light

    def _view_after(self, stamp_s: float, state: VehicleState, after_s: float) -> SceneView:
        """Return a view of later or earlier, each row at its own time."""
        after = self._after_s + after_s
        points = viewpoints_after(state, self._mounting, self._shaking, after)
        return SceneView(self._scene, self._rows, points, self._moments(stamp_s, state, after), self._threads)

    def _moments(self, stamp_s: float, state: VehicleState, after_s: Floats) -> Moment:
        first_s, span_s = float(after_s[0]), float(after_s[-1] - after_s[0])
        n_steps = max(1, math.ceil(span_s / _STEP_S))
        known_s = first_s + span_s * np.arange(n_steps + 1) / n_steps
        bases = (Pose2(*pose) for pose in poses_after(state, known_s).tolist())
        known = [self._moment_at(stamp_s + at_s, base) for at_s, base in zip(known_s.tolist(), bases)]
        return moments_between(known, (after_s - first_s) * (n_steps / span_s if span_s > 0.0 else 0.0))

    def _n_instants(self, view: SceneView, stamp_s: float, state: VehicleState) -> int:
        """Return at how many instants of the exposure the camera looks: an odd number, a pixel apart at most."""
        if self._shutter.exposure_s == 0.0:
            return 1
        ends_s = np.array([-0.5, 0.5]) * self._shutter.exposure_s
        points = viewpoints_after(state, self._mounting, self._shaking, ends_s)
        near_m = max(_NEAR_M, float(view.ranges_m.min()))
        turned = float(np.linalg.norm(points.rotations[1] - points.rotations[0])) / math.sqrt(2.0)
        smear = turned + float(np.linalg.norm(points.eyes[1] - points.eyes[0])) / near_m
        smear += self._smear_of_movers(stamp_s, state, ends_s)
        smear_px = smear / float(self.table.pixel_rad.min())
        return 1 if smear_px < _SMEAR_PX else min(_MOST_INSTANTS, 2 * math.ceil((smear_px - 1.0) / 2.0) + 1)

    def _smear_of_movers(self, stamp_s: float, state: VehicleState, ends_s: Floats) -> float:
        """Return the greatest angle by which a person or box moves during the exposure, seen from the camera [rad]."""
        first, last = (self._moment_at(stamp_s + at_s, state.pose_map_base) for at_s in ends_s.tolist())
        if first.is_empty:
            return 0.0
        eye = np.array([state.pose_map_base.x, state.pose_map_base.y, self._mounting.z])
        away_m = np.maximum(_NEAR_M, np.linalg.norm(first.centres - eye, axis=1))
        return float((np.linalg.norm(last.centres - first.centres, axis=1) / away_m).max())


def _stands(state: VehicleState) -> bool:
    twist = state.twist
    return twist.forward_mps == 0.0 and twist.left_mps == 0.0 and twist.yaw_radps == 0.0
