"""Registers the sources over files and devices, and recordings by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry

_SOURCES = (
    ("image_folder", "ImageFolder", "Pictures in a folder, at a rate or with a file of stamps", ""),
    ("video", "Video", "A film", ""),
    ("camera", "Camera", "A live camera or stream", ""),
    ("tum_rgbd", "TumRgbd", "Colour and depth of the TUM RGB-D benchmark", "Sturm et al. 2012"),
    ("rgbd_folder", "RgbdFolder", "Numbered colour, depth and pose files: 7-Scenes, ScanNet", "Shotton et al. 2013"),
    ("kitti_odometry", "KittiOdometry", "One camera of the KITTI odometry benchmark", "Geiger et al. 2012"),
    ("euroc", "Euroc", "A camera and the inertial unit in the ASL layout: EuRoC MAV, TUM VI", "Burri et al. 2016"),
    ("carmen_log", "CarmenLog", "Planar laser and odometry of a CARMEN log", ""),
    ("csv_odometry", "CsvOdometry", "Odometry from a table: poses, wheels, velocities, arcs or distances", ""),
    ("csv_records", "CsvRecords", "Ranges and bearings to known landmarks, from a table", ""),
    ("rosbag", "Rosbag", "Recordings of ROS 1 and ROS 2, and MCAP", ""),
)

# What each plays when it is named without a config.
_OPENS = {
    "image_folder": ("*/*.png", "*/*.jpg", "*/*.jpeg", "*/*.bmp", "*/*.pgm", "*/*.tif", "*/*.tiff"),
    "video": ("*.mp4", "*.avi", "*.mov", "*.mkv", "*.webm", "*.m4v"),
    "tum_rgbd": ("*/rgb.txt",),
    "rgbd_folder": ("*/*.pose.txt", "*/intrinsic/intrinsic_color.txt"),
    "kitti_odometry": ("*/times.txt",),
    "euroc": ("*/mav0/cam0/data.csv", "*/cam0/data.csv"),
    "carmen_log": ("*.log", "*.clf", "*.log.gz", "*.clf.gz", "*.log.bz2", "*.clf.bz2"),
    "csv_odometry": ("*.csv",),
    "rosbag": ("*.bag", "*.mcap", "*.db3", "*/metadata.yaml"),
}

_KNOWN = (
    ("intel", "Intel Research Lab: laser and odometry, corrected poses"),
    ("fr079_corrected", "Freiburg 079: laser and odometry, corrected poses"),
    ("fr079", "Freiburg 079: laser and raw odometry"),
    ("aces", "ACES building, Austin: laser and raw odometry, relations"),
    ("husky", "A Husky outdoors: odometry, inertial unit, GPS"),
    ("plaza1", "A lawn mower among four radios, 1.9 km: odometry, ranges"),
    ("plaza2", "A lawn mower among four radios, 1.4 km: odometry, ranges"),
    ("fr1_rpy", "TUM RGB-D freiburg1_rpy, its first 5 s: a Kinect in the hand"),
    *((f"mrclam_d6_robot{robot}", f"UTIAS MRCLAM data set 6, robot {robot}") for robot in range(1, 6)),
)


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register every source and every known recording, by import string."""
    for name, summary in _KNOWN:
        registry.dataset(name, f"trailmark_datasets.known:{name.upper()}", summary=summary)
    for name, cls, summary, reference in _SOURCES:
        registry.source(
            name,
            f"trailmark_datasets.{name}:{cls}",
            config=f"trailmark_datasets.config:{cls}Config",
            summary=summary,
            reference=reference,
            extra="bags" if name == "rosbag" else None,
            opens=_OPENS.get(name, ()),
        )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark data`."""
    from trailmark_datasets.commands import data_group

    group.add_command(data_group)
