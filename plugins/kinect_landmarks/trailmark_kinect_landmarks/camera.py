"""From a picture of colour and depth to points in base axes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Grey8
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, DepthCamera, Pinhole, Scan, SensorInfo
from trailmark.geometry import Pose3
from trailmark_kinect_landmarks.alignment import AlignmentLimits
from trailmark_kinect_landmarks.calibration import Crop, depth_pixels, register_depth
from trailmark_kinect_landmarks.config import RgbdConfig
from trailmark_kinect_landmarks.depth import DepthLimits, correct_depth, depth_at, depth_sigma, scan_depth
from trailmark_kinect_landmarks.landmarks import point_covariances
from trailmark_kinect_landmarks.registration import Registration
from trailmark_kinect_landmarks.triangulation import DepthKind, Sights, pixel_angles, planar_range, sights

__all__ = ["DepthPixels", "LandmarkCamera", "alignment_limits"]


_MAX_BEAM_GAP_RAD = math.radians(1.0)
_MAX_BEAM_HEIGHT_M = 0.15  # a landmark this near to the laser's plane is what the laser sees
_SIGMA_SCAN_M = 0.02
_N_SCAN_STEPS = 3


@dataclass(frozen=True, slots=True, eq=False)
class DepthPixels:
    """Pixels with depth.

    Attributes
    ----------
    sights : Sights
        By the paper's names.
    points_base : (N, 3) float64
        NaN where there is no depth [m].
    cov_base : (N, 3, 3) float64
        Of the points [m^2].
    from_scan : (N,) bool
        Whose depth came from the laser.
    """

    sights: Sights
    points_base: Floats
    cov_base: Floats
    from_scan: npt.NDArray[np.bool_]


class LandmarkCamera:
    """Measures landmarks: angles from the colour picture, distances from depth.

    Parameters
    ----------
    config : RgbdConfig
        How.
    info : SensorInfo
        The camera.
    scan_info : SensorInfo, optional
        The laser that fills in.
    """

    def __init__(self, config: RgbdConfig, info: SensorInfo, scan_info: SensorInfo | None = None) -> None:
        self._config, self._info = config, info
        self._limits = DepthLimits(config.near_m, config.far_m)
        self._model = _depth_camera(info)
        calibrated: DepthKind = self._model.depth_kind if self._model else "z"
        self.depth_kind: DepthKind = config.depth_kind or calibrated
        crop = config.crop
        self._crop = Crop(crop.left, crop.right, crop.top, crop.bottom) if crop else None
        self._R_base_camera = info.pose_base_sensor.rotation()
        #: What was measured where depth does not lie on colour as the calibration says.
        self.registration: Registration | None = None
        self._pose_laser_camera = scan_info.pose_base_sensor.inverse() @ info.pose_base_sensor if scan_info else Pose3()

    def register_depth(self, payload: RGBD) -> npt.NDArray[np.float32]:
        """Return depth pixel by pixel as the colour picture, NaN where unknown; by what was measured, if anything was.

        Raises
        ------
        ConfigError
            If depth and colour differ in size and nothing says how they belong together.
        """
        as_given = self._registered_as_given(payload)
        return as_given if self.registration is None else self.registration.apply(as_given)

    def _registered_as_given(self, payload: RGBD) -> npt.NDArray[np.float32]:
        height, width = payload.bgr.shape[:2]
        if self._crop is not None:
            return _by_crop(payload.depth_m, self._crop, (width, height))
        if self._model is not None and self._model.depth is not None:
            return register_depth(payload.depth_m, self._model, (width, height))
        if payload.depth_m.shape != (height, width):
            raise ConfigError(
                f"sensor {self._info.name!r}: depth has {payload.depth_m.shape[1]} x {payload.depth_m.shape[0]} px and"
                f" colour {width} x {height}; give the calibration of both ('depth:', 'pose_colour_depth:'), or 'crop:'"
            )
        return payload.depth_m

    def clean_depth(self, registered_m: npt.NDArray[np.float32], grey: Grey8) -> npt.NDArray[np.float32]:
        """Return depth without the readings that are not reliable, NaN in their place."""
        return correct_depth(registered_m, grey, self._limits)

    def measure(
        self,
        uv: Floats,
        depth_m: npt.NDArray[np.float32],
        sigma_px: float,
        scan: Scan | None = None,
    ) -> DepthPixels:
        """Return where pixels stand, Eqs. (7)-(12) and the camera's mounting."""
        size = depth_m.shape[1], depth_m.shape[0]
        lens = self.lens(size)
        alpha, beta = pixel_angles(uv, lens, size, self._config.angles)
        measured_m = depth_at(depth_m, uv, limits=self._limits)
        dM = planar_range(measured_m, alpha, beta) if self.depth_kind == "range" else measured_m
        seen = sights(alpha, beta, dM, self.depth_kind)
        sigma_m = depth_sigma(seen.dV)
        filled = np.zeros(len(uv), np.bool_)
        if scan is not None:
            seen, filled = self._fill_from_scan(seen, scan)
            sigma_m = np.where(filled, _SIGMA_SCAN_M, sigma_m)
        points_sensor = seen.points_sensor()
        cov = point_covariances(points_sensor, np.full(len(uv), sigma_px), sigma_m, lens.fx)
        R = self._R_base_camera
        return DepthPixels(seen, self._info.pose_base_sensor.transform(points_sensor), R @ cov @ R.T, filled)

    def project(self, points_base: Floats, size: tuple[int, int]) -> Floats:
        """Return the pixels of points, (N, 2); NaN for those behind the camera."""
        lens = self.lens(size)
        ahead, left, up = self.in_camera(points_base).T
        ahead = np.where(ahead > 0.05, ahead, np.nan)
        if self._config.angles == "linear":
            return _linear_pixels(np.arctan(-left / ahead), np.arctan(up / ahead), lens, size)
        flat = np.stack([-left / ahead, -up / ahead, np.ones(len(ahead))], axis=1)
        if not lens.distortion:
            return np.asarray(flat[:, :2] * (lens.fx, lens.fy) + (lens.cx, lens.cy))
        found = np.full((len(flat), 2), np.nan)
        known = np.isfinite(flat).all(axis=1) & (np.abs(flat[:, :2]).max(axis=1) < 1.2)  # the polynomial folds beyond
        if known.any():
            no_turn = np.zeros(3)
            uv, _ = cv2.projectPoints(flat[known], no_turn, no_turn, lens.matrix(), np.array(lens.distortion))
            found[known] = np.asarray(uv).reshape(-1, 2)
        return found

    def in_camera(self, points_base: Floats) -> Floats:
        """Return points in the camera's sensor axes (x forward, y left, z up), (N, 3) [m]."""
        at = self._info.pose_base_sensor
        return np.asarray((points_base - (at.x, at.y, at.z)) @ self._R_base_camera)

    def lens(self, size: tuple[int, int]) -> Pinhole:
        """Return the colour camera; without a calibration, one of the configured capture angle."""
        if self._model is not None:
            return self._model.colour
        focal_px = size[0] / 2.0 / math.tan(math.radians(self._config.field_of_view_deg) / 2.0)
        return Pinhole(focal_px, focal_px, (size[0] - 1) / 2.0, (size[1] - 1) / 2.0)

    def _fill_from_scan(self, seen: Sights, scan: Scan) -> tuple[Sights, npt.NDArray[np.bool_]]:
        """Fill missing depths from a laser: a landmark near to its plane stands where the beam ends."""
        missing = ~np.isfinite(seen.dV)
        ray = np.stack([np.ones_like(seen.alpha), -np.tan(seen.alpha), np.tan(seen.beta)], axis=1)
        ray_laser = ray @ self._pose_laser_camera.rotation().T
        at = np.array([self._pose_laser_camera.x, self._pose_laser_camera.y, self._pose_laser_camera.z])
        dV, ranges = np.full(len(missing), 2.0), np.full(len(missing), np.nan)
        for _ in range(_N_SCAN_STEPS):  # the two do not stand at one place: which beam depends on the distance
            points = at + dV[:, None] * ray_laser
            ranges = scan_depth(scan, np.arctan2(points[:, 1], points[:, 0]), _MAX_BEAM_GAP_RAD)
            a, b = (ray_laser[:, :2] ** 2).sum(axis=1), ray_laser[:, :2] @ at[:2]
            dV = (-b + np.sqrt(np.maximum(b * b - a * (at[:2] @ at[:2] - ranges**2), 0.0))) / np.maximum(a, 1e-9)
        height_m = np.abs(at[2] + ray_laser[:, 2] * dV)
        good = missing & np.isfinite(dV) & (dV > 0.0) & (height_m < _MAX_BEAM_HEIGHT_M)
        filled = sights(seen.alpha, seen.beta, np.where(good, dV, seen.dV), "z")
        return Sights(seen.alpha, seen.beta, np.where(good, ranges, seen.dM), filled.dx, filled.dV, filled.dy), good


def alignment_limits(config: RgbdConfig) -> AlignmentLimits:
    """Return when landmarks carry a pose, as configured."""
    return AlignmentLimits(config.min_landmarks, config.min_separation_m, math.radians(config.min_angle_deg))


def _depth_camera(info: SensorInfo) -> DepthCamera | None:
    if isinstance(info.calibration, Pinhole):
        return DepthCamera(info.calibration)
    return info.calibration if isinstance(info.calibration, DepthCamera) else None


def _by_crop(depth_m: npt.NDArray[np.float32], crop: Crop, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Return depth looked up for every colour pixel by Eqs. (5)-(6)."""
    depth_size = depth_m.shape[1], depth_m.shape[0]
    columns, has_column = depth_pixels(
        np.stack([np.arange(size[0]), np.full(size[0], crop.top)], 1), crop, size, depth_size
    )
    rows, has_row = depth_pixels(np.stack([np.full(size[1], crop.left), np.arange(size[1])], 1), crop, size, depth_size)
    looked_up = depth_m[rows[:, 1][:, None], columns[:, 0][None, :]]
    return np.where(has_row[:, None] & has_column[None, :], looked_up, np.float32(np.nan))


def _linear_pixels(alpha: Floats, beta: Floats, lens: Pinhole, size: tuple[int, int]) -> Floats:
    half = np.arctan([size[0] / 2.0 / lens.fx, size[1] / 2.0 / lens.fy])
    scale = np.array(size) / 2.0 / half
    return np.asarray(np.stack([lens.cx + alpha * scale[0], lens.cy - beta * scale[1]], axis=1))
