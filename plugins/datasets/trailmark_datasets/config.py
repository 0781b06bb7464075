"""Configs of the sources over files and devices."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from trailmark.config import ExistingPath, LiveSourceConfig, PluginConfig, SourceConfig

__all__ = [
    "CameraConfig",
    "CarmenLogConfig",
    "CsvOdometryConfig",
    "CsvRecordsConfig",
    "EurocConfig",
    "ImageFolderConfig",
    "KittiOdometryConfig",
    "PosesConfig",
    "RgbdFolderConfig",
    "RgbdTopics",
    "RosbagConfig",
    "TumRgbdConfig",
    "VideoConfig",
]

TimeUnit = Literal["s", "ms", "us", "ns"]
AngleUnit = Literal["rad", "deg"]

POSE_COLUMNS = ("t", "file", "x", "y", "theta")
RECORD_COLUMNS = ("t", "id", "range", "bearing")
ODOMETRY_COLUMNS = ("t", "x", "y", "theta", "v", "omega", "left", "right", "distance", "turn")


def _known_columns(columns: dict[str, str], known: Iterable[str]) -> dict[str, str]:
    """Refuse a rename whose meaning is unknown, most likely because it is written the other way round."""
    for meaning, name in columns.items():
        if meaning not in known:
            hint = f"{{{name}: {meaning}}}" if name in known else "{quantity: name in the file}"
            raise ValueError(f"{meaning!r} is no quantity ({', '.join(known)}); write {hint}")
    return columns


class PosesConfig(SourceConfig):
    """Sources beside which a table may give the true poses."""

    poses: ExistingPath | None = None
    """Table of the true poses of base: columns x, y, theta and t (own stamps), file (name of the frame), or
    neither (a row for each frame)."""
    poses_header: tuple[str, ...] | None = None
    """Columns of a table of poses without a header row."""
    poses_columns: dict[str, str] = Field(default_factory=dict)
    """Columns of the table that bear other names: `quantity: name`."""
    poses_angle_unit: AngleUnit = "rad"
    """Unit of theta in the table."""
    poses_metres_per_unit: float = Field(1.0, gt=0)
    """Length of one unit of x and y in the table: 0.001 for millimetres [m]."""
    time_unit: TimeUnit = "s"
    """Unit of the stamps in the files."""

    @field_validator("poses_columns")
    @classmethod
    def _poses_columns_are_known(cls, columns: dict[str, str]) -> dict[str, str]:
        return _known_columns(columns, POSE_COLUMNS)


class ImageFolderConfig(PosesConfig):
    """Pictures in a folder, in natural order (2 before 10), at a rate or with a file of stamps."""

    path: ExistingPath
    """The folder."""
    pattern: str | None = None
    """Which files, for example `left_*.png` or `**/*.jpg`; left out: every picture in the folder."""
    rate_hz: float | None = Field(None, gt=0)
    """Pictures per second; the first has stamp 0 [Hz]."""
    timestamps: ExistingPath | None = None
    """File of stamps: one a line, in the order of the pictures, or with the picture's name beside it."""
    grey: bool | None = None
    """true: 8-bit grey; false: colour; left out: as stored, also 16 bit."""
    numbered: bool = True
    """With `rate_hz`: a number left out of names that count up is a missing picture, not a shorter time."""

    @model_validator(mode="after")
    def _one_clock(self) -> Self:
        if (self.rate_hz is None) == (self.timestamps is None):
            given = "both" if self.rate_hz is not None else "neither"
            raise ValueError(f"give rate_hz or timestamps, and only one of them; the config gives {given}")
        return self


class VideoConfig(SourceConfig):
    """A film."""

    path: ExistingPath
    """The file."""
    rate_hz: float | None = Field(None, gt=0)
    """Frames per second; left out: the times that stand in the file [Hz]."""
    grey: bool | None = None
    """true: grey; false or left out: colour."""


class CameraConfig(LiveSourceConfig):
    """A live camera."""

    device: int | str = 0
    """Number of the camera, or the URL of a stream."""
    width: int | None = Field(None, gt=0)
    """Width to ask for [px]."""
    height: int | None = Field(None, gt=0)
    """Height to ask for [px]."""
    rate_hz: float | None = Field(None, gt=0)
    """Rate to ask for [Hz]."""
    grey: bool | None = None
    """true: grey; false or left out: colour."""
    max_failures: int = Field(30, ge=1)
    """With `on_bad_frame: skip`: end after so many failures in a row."""
    reconnect_s: float = Field(0.0, ge=0)
    """A camera that is gone (unplugged) is looked for again for so long, and the run goes on when it is back; meanwhile
    localizers get no picture, and are lost at first when they do. 0: the run ends [s]."""


class TumRgbdConfig(SourceConfig):
    """A sequence of the TUM RGB-D benchmark, or a folder laid out like one."""

    path: ExistingPath
    """The folder with `rgb.txt`, `depth.txt` and, where known, `groundtruth.txt` and `camera.txt`."""
    max_difference_s: float = Field(0.02, gt=0)
    """Colour and depth farther apart are no pair; 0.02 is the benchmark's own [s]."""
    depth_factor: float | None = Field(None, gt=0)
    """Depth values per metre; left out: the second line of `camera.txt`, else 5000."""
    max_truth_gap_s: float = Field(0.1, gt=0)
    """Truth is not interpolated between poses farther apart [s]."""


class RgbdFolderConfig(SourceConfig):
    """Numbered files of colour, depth and poses: 7-Scenes, exports of ScanNet and others."""

    path: ExistingPath
    """The folder of the sequence."""
    colour: str | None = None
    """Pattern of the colour pictures below `path`; left out: `*.color.*`, `color/*` or `rgb/*`."""
    depth: str | None = None
    """Pattern of the depth pictures; left out: `*.depth.*` or `depth/*`."""
    poses: str | None = None
    """Pattern of the files of poses; left out: `*.pose.txt`, `pose/*.txt` or `poses/*.txt`."""
    rate_hz: float = Field(30.0, gt=0)
    """Pictures a second: the files have no stamps [Hz]."""
    depth_factor: float | None = Field(None, gt=0)
    """Depth values per metre; left out: the second line of `camera.txt`, else 1000. 0 and 65535 mean unknown."""


class KittiOdometryConfig(SourceConfig):
    """A sequence of the KITTI odometry benchmark, or a plain folder of numbered pictures."""

    path: ExistingPath
    """The sequence's folder (`.../sequences/00`), or the folder of the pictures themselves."""
    camera: Literal["image_0", "image_1", "image_2", "image_3"] = "image_0"
    """Which camera; not used for a plain folder."""
    rate_hz: float = Field(10.0, gt=0)
    """Pictures per second where there is no `times.txt`; KITTI's is 10 [Hz]."""
    poses: ExistingPath | None = None
    """Poses file; left out: `poses/XX.txt` beside the sequences, where it exists."""
    grey: bool | None = None
    """true: 8-bit grey; false: colour; left out: as stored."""


class EurocConfig(SourceConfig):
    """A sequence in the ASL layout: EuRoC MAV, TUM VI and others."""

    path: ExistingPath
    """The sequence's folder, with `mav0` in it; or `mav0` itself."""
    camera: str = Field("cam0", pattern=r"cam\d+")
    """Which camera; it is base unless `mounting` says otherwise."""
    imu: bool = True
    """true: the readings of imu0 come as a second sensor, mounted as the two `sensor.yaml` say."""
    max_truth_gap_s: float = Field(0.1, gt=0)
    """Between true poses farther apart than this none is interpolated [s]."""


class CarmenLogConfig(SourceConfig):
    """A CARMEN log: planar laser and odometry."""

    path: ExistingPath
    """The log, plain, `.gz` or `.bz2`."""
    range_max_m: float = Field(80.0, gt=0)
    """Ranges from here on mean that nothing came back (a SICK laser says 81.91) [m]."""
    angle_step_deg: float | None = Field(None, gt=0)
    """Angle between beams of FLASER lines; left out: by their number (180, 181: 1 deg; 360, 361: 0.5 deg) [deg]."""
    scan_poses: Literal["auto", "truth", "odometry"] = "auto"
    """What the laser poses of FLASER and ROBOTLASER lines are: corrected (by SLAM), so a ground truth, or odometry.
    auto: truth where the log shows that they were corrected."""


class CsvOdometryConfig(PosesConfig):
    """Odometry from a table."""

    path: ExistingPath
    """The table; commas, semicolons, tabs or blanks; `#`, `%` and `//` start a comment."""
    header: tuple[str, ...] | None = None
    """Columns of a table without a header row."""
    columns: dict[str, str] = Field(default_factory=dict)
    """Columns that bear other names: `quantity: name`, for example `{t: seconds, v: speed}`."""
    quantity: Literal["pose", "velocity", "wheels", "arc", "distance"] | None = None
    """Which columns to use; left out: the first that are there of x, y, theta; left, right; v, omega; distance, turn;
    distance."""
    angle_unit: AngleUnit = "rad"
    """Unit of theta, omega and turn."""
    metres_per_unit: float = Field(1.0, gt=0)
    """Length of one unit of x, y, v, left, right and distance: the length of a tick, 0.001 for millimetres [m]."""
    per_row: bool = False
    """true: left, right, distance and turn are since the row before; false: since the start."""
    track_width_m: float | None = Field(None, gt=0)
    """Distance between the left and right wheels; needed for left, right [m]."""
    hold: Literal["forward", "backward"] = "forward"
    """A velocity holds from its stamp until the next row (a command), or since the row before (a measurement)."""

    @field_validator("columns")
    @classmethod
    def _columns_are_known(cls, columns: dict[str, str]) -> dict[str, str]:
        return _known_columns(columns, ODOMETRY_COLUMNS)


class CsvRecordsConfig(PosesConfig):
    """Ranges and bearings to landmarks, from a table."""

    path: ExistingPath
    """The table; commas, semicolons, tabs or blanks; `#`, `%` and `//` start a comment."""
    header: tuple[str, ...] | None = None
    """Columns of a table without a header row: `[t, id, range, bearing]` where a row is one sighting, or
    `[t, "bearing:1", "range:1", "bearing:2"]` where a row is all that was seen at once of the landmarks 1, 2."""
    columns: dict[str, str] = Field(default_factory=dict)
    """Columns that bear other names: `quantity: name`, for example `{t: seconds, id: barcode}`."""
    rate_hz: float | None = Field(None, gt=0)
    """Rows per second of a table that has no column t [Hz]."""
    angle_unit: AngleUnit = "rad"
    """Unit of the bearings, which count counter-clockwise from forward."""
    metres_per_unit: float = Field(1.0, gt=0)
    """Length of one unit of a range; 0.93 for ranges that are 7 % too long [m]."""
    codes: ExistingPath | None = None
    """Table of the codes that `path` writes for landmarks, where the two differ (barcodes): columns id, code."""
    codes_header: tuple[str, ...] | None = None
    """Columns of a table of codes without a header row."""
    landmarks: ExistingPath | None = None
    """Where the landmarks stand: columns id, x, y; without id they are counted from 1 [m]."""
    landmarks_header: tuple[str, ...] | None = None
    """Columns of a table of landmarks without a header row."""

    @field_validator("columns")
    @classmethod
    def _columns_are_known(cls, columns: dict[str, str]) -> dict[str, str]:
        return _known_columns(columns, RECORD_COLUMNS)


class RgbdTopics(PluginConfig):
    """The two topics of one colour-and-depth camera."""

    colour: str
    """Topic of the colour pictures."""
    depth: str
    """Topic of the depth pictures: 16UC1 in millimetres or 32FC1 in metres."""
    max_difference_s: float = Field(0.02, gt=0)
    """Colour and depth farther apart are no pair [s]."""


class RosbagConfig(SourceConfig):
    """A recording of ROS 1 or ROS 2."""

    path: ExistingPath
    """A `.bag` file, a folder of a ROS 2 recording, or an `.mcap` or `.db3` file."""
    topics: dict[str, str] | None = None
    """Sensors and their topics: `name: /topic`; left out: every topic that is understood, under its own name. Absolute
    poses (PoseStamped, PoseWithCovarianceStamped, NavSatFix) are read where they are named here, and a transform as
    odometry: `name: "odom -> base_link"`."""
    ground_truth_topic: str | None = None
    """Topic of the true poses of base, or a transform, `"map -> base_link"`; satellite fixes lie in a local plane."""
    rgbd: dict[str, RgbdTopics] = Field(default_factory=dict)
    """Colour and depth topics to be paired to one sensor."""
    tf_static: bool = True
    """Take the mountings from /tf_static; what the config says of a sensor's mounting wins."""
    base_frame: str | None = None
    """The frame that is base; left out: base_link, base_footprint or base, whichever is in /tf_static."""
    stamps: Literal["header", "receive"] = "header"
    """Stamps of the messages' headers, or the times at which they were recorded."""
    reorder_s: float = Field(1.0, gt=0)
    """How far one topic may lag behind the others in the recording [s]."""
    distribution: Literal["ros2_foxy", "ros2_galactic", "ros2_humble", "ros2_iron", "ros2_jazzy"] = "ros2_humble"
    """Message definitions for ROS 2 recordings that bring none."""
