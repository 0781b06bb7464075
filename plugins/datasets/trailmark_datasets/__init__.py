"""Recordings and devices as sources: films, pictures, cameras, tables, data sets, bags.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_datasets.camera import Camera
    from trailmark_datasets.carmen_log import CarmenLog
    from trailmark_datasets.config import (
        CameraConfig,
        CarmenLogConfig,
        CsvOdometryConfig,
        CsvRecordsConfig,
        EurocConfig,
        ImageFolderConfig,
        KittiOdometryConfig,
        RgbdFolderConfig,
        RosbagConfig,
        TumRgbdConfig,
        VideoConfig,
    )
    from trailmark_datasets.csv_odometry import CsvOdometry
    from trailmark_datasets.csv_records import CsvRecords
    from trailmark_datasets.euroc import Euroc
    from trailmark_datasets.image_folder import ImageFolder
    from trailmark_datasets.kitti_odometry import KittiOdometry
    from trailmark_datasets.rgbd_folder import RgbdFolder
    from trailmark_datasets.rosbag import Rosbag
    from trailmark_datasets.tum_rgbd import TumRgbd
    from trailmark_datasets.video import Video

__all__ = [
    "Camera",
    "CameraConfig",
    "CarmenLog",
    "CarmenLogConfig",
    "CsvOdometry",
    "CsvOdometryConfig",
    "CsvRecords",
    "CsvRecordsConfig",
    "Euroc",
    "EurocConfig",
    "ImageFolder",
    "ImageFolderConfig",
    "KittiOdometry",
    "KittiOdometryConfig",
    "RgbdFolder",
    "RgbdFolderConfig",
    "Rosbag",
    "RosbagConfig",
    "TumRgbd",
    "TumRgbdConfig",
    "Video",
    "VideoConfig",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "camera": ("Camera",),
        "carmen_log": ("CarmenLog",),
        "config": (
            "CameraConfig",
            "CarmenLogConfig",
            "CsvOdometryConfig",
            "CsvRecordsConfig",
            "EurocConfig",
            "ImageFolderConfig",
            "KittiOdometryConfig",
            "RgbdFolderConfig",
            "RosbagConfig",
            "TumRgbdConfig",
            "VideoConfig",
        ),
        "csv_odometry": ("CsvOdometry",),
        "csv_records": ("CsvRecords",),
        "euroc": ("Euroc",),
        "image_folder": ("ImageFolder",),
        "kitti_odometry": ("KittiOdometry",),
        "rgbd_folder": ("RgbdFolder",),
        "rosbag": ("Rosbag",),
        "tum_rgbd": ("TumRgbd",),
        "video": ("Video",),
    },
)
