"""What people would use instead: wheels, gyro, optical flow, features, correlation.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_baselines.appearance.config import ColumnNCCConfig, PatchNCCConfig, PhaseShiftConfig
    from trailmark_baselines.appearance.localizer import ColumnNCC, PatchNCC, PhaseShift
    from trailmark_baselines.config import ConstantSpeedConfig, ImuConfig, OdometryConfig, PoseFixesConfig
    from trailmark_baselines.constant_speed import ConstantSpeed
    from trailmark_baselines.ground.config import KLTConfig, ORBConfig, PhaseCorrelationConfig
    from trailmark_baselines.ground.klt import KLT
    from trailmark_baselines.ground.orb import ORB
    from trailmark_baselines.ground.phase import PhaseCorrelation
    from trailmark_baselines.imu import ImuLocalizer
    from trailmark_baselines.odometry import OdometryLocalizer
    from trailmark_baselines.pose_fixes import PoseFixes
    from trailmark_baselines.rgbd.config import OrbRgbdConfig
    from trailmark_baselines.rgbd.localizer import OrbRgbd

__all__ = [
    "KLT",
    "ORB",
    "ColumnNCC",
    "ColumnNCCConfig",
    "ConstantSpeed",
    "ConstantSpeedConfig",
    "ImuConfig",
    "ImuLocalizer",
    "KLTConfig",
    "ORBConfig",
    "OdometryConfig",
    "OdometryLocalizer",
    "OrbRgbd",
    "OrbRgbdConfig",
    "PatchNCC",
    "PatchNCCConfig",
    "PhaseCorrelation",
    "PhaseCorrelationConfig",
    "PhaseShift",
    "PhaseShiftConfig",
    "PoseFixes",
    "PoseFixesConfig",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "appearance.config": (
            "ColumnNCCConfig",
            "PatchNCCConfig",
            "PhaseShiftConfig",
        ),
        "appearance.localizer": (
            "ColumnNCC",
            "PatchNCC",
            "PhaseShift",
        ),
        "config": (
            "ConstantSpeedConfig",
            "ImuConfig",
            "OdometryConfig",
            "PoseFixesConfig",
        ),
        "constant_speed": ("ConstantSpeed",),
        "ground.config": (
            "KLTConfig",
            "ORBConfig",
            "PhaseCorrelationConfig",
        ),
        "ground.klt": ("KLT",),
        "ground.orb": ("ORB",),
        "ground.phase": ("PhaseCorrelation",),
        "imu": ("ImuLocalizer",),
        "odometry": ("OdometryLocalizer",),
        "pose_fixes": ("PoseFixes",),
        "rgbd.config": ("OrbRgbdConfig",),
        "rgbd.localizer": ("OrbRgbd",),
    },
)
