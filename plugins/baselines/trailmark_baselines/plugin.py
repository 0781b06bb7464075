"""Registers what people would use instead of the papers' methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizers."""
    _register_measured(registry)
    _register_appearance(registry)
    _register_ground(registry)


def _register_measured(registry: Registry) -> None:
    """Register those that say what another device has measured, or assume it."""
    registry.localizer(
        "odometry",
        "trailmark_baselines.odometry:OdometryLocalizer",
        config="trailmark_baselines.config:OdometryConfig",
        summary="Wheel odometry, with a covariance for slip",
        gives=("motion",),
    )
    registry.localizer(
        "constant_speed",
        "trailmark_baselines.constant_speed:ConstantSpeed",
        config="trailmark_baselines.config:ConstantSpeedConfig",
        summary="Drives on at a known speed, whatever it sees",
        reference="Perroni Filho & Ohya 2014 (correspondence by time)",
        gives=("motion",),
    )
    registry.localizer(
        "imu",
        "trailmark_baselines.imu:ImuLocalizer",
        config="trailmark_baselines.config:ImuConfig",
        summary="Turn of an inertial unit's gyro, and its absolute heading where it has one",
        gives=("motion", "fix"),
    )
    registry.localizer(
        "pose_fixes",
        "trailmark_baselines.pose_fixes:PoseFixes",
        config="trailmark_baselines.config:PoseFixesConfig",
        summary="Absolute poses from elsewhere: motion capture, a satellite receiver, another program",
        gives=("fix",),
    )


def _register_appearance(registry: Registry) -> None:
    """Register those that look ahead: offsets from taught pictures, and motion of an RGB-D camera."""
    for name, cls, summary in (
        ("column_ncc", "ColumnNCC", "Offset from taught pictures, by correlating the means of their columns"),
        ("patch_ncc", "PatchNCC", "Offset from taught pictures, by correlating small patch-normalised ones"),
        ("phase_shift", "PhaseShift", "Offset from taught pictures, by phase correlation"),
    ):
        registry.localizer(
            name,
            f"trailmark_baselines.appearance.localizer:{cls}",
            config=f"trailmark_baselines.appearance.config:{cls}Config",
            summary=summary,
            gives=("path_offset",),
        )
    registry.localizer(
        "orb_rgbd",
        "trailmark_baselines.rgbd.localizer:OrbRgbd",
        config="trailmark_baselines.rgbd.config:OrbRgbdConfig",
        summary="Motion of an RGB-D camera: ORB features with depth, aligned rigidly under RANSAC",
        gives=("motion",),
    )


def _register_ground(registry: Registry) -> None:
    """Register the motions of a downward camera."""
    for name, cls, summary in (
        ("klt", "klt:KLT", "Motion of a downward camera: corners tracked from key frames, rigid under RANSAC"),
        ("orb", "orb:ORB", "Motion of a downward camera: ORB features of key frames, rigid under RANSAC"),
        ("phase_correlation", "phase:PhaseCorrelation", "Motion of a downward camera: phase correlation of windows"),
    ):
        registry.localizer(
            name,
            f"trailmark_baselines.ground.{cls}",
            config=f"trailmark_baselines.ground.config:{cls.partition(':')[2]}Config",
            summary=summary,
            gives=("motion",),
        )
