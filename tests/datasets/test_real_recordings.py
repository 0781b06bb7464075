"""The sources on recordings that are not shipped."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.io import loadmat

from trailmark import Pipeline
from trailmark.frames import DepthCamera
from trailmark.interfaces import FrameSource, Session
from trailmark_datasets.carmen_log import CarmenLog
from trailmark_datasets.config import (
    CarmenLogConfig,
    CsvOdometryConfig,
    ImageFolderConfig,
    KittiOdometryConfig,
    RosbagConfig,
    TumRgbdConfig,
)
from trailmark_datasets.csv_odometry import CsvOdometry
from trailmark_datasets.image_folder import ImageFolder
from trailmark_datasets.kitti_odometry import KittiOdometry
from trailmark_datasets.known import PLAZA1, PLAZA2
from trailmark_datasets.rosbag import Rosbag
from trailmark_datasets.tum_rgbd import TumRgbd

pytestmark = pytest.mark.data


def counted(source: FrameSource) -> tuple[Counter[str], dict[str, object]]:
    """Play a source, checking that stamps increase; return how many frames and the last payload of each sensor."""
    source.start(Session(name="front"))
    counts: Counter[str] = Counter()
    last_s: dict[str, float] = {}
    last: dict[str, object] = {}
    newest_s = -np.inf
    for frame in source.frames():
        assert frame.stamp_s > last_s.get(frame.sensor, -np.inf)
        assert frame.stamp_s >= newest_s
        last_s[frame.sensor] = newest_s = frame.stamp_s
        last[frame.sensor] = frame.payload
        counts[frame.sensor] += 1
    return counts, last


def test_every_colour_picture_of_the_rgbd_sequence_has_its_depth(data_folder):
    source = TumRgbd(TumRgbdConfig.model_validate({"path": data_folder / "rgbd/fr1_rpy_0_5s"}))

    counts, last = counted(source)
    truth = source.ground_truth()

    assert counts == {"front": 150}
    assert source.counters() == {"unpaired_colour": 0, "unpaired_depth": 0}
    assert source.sensors["front"].size == (640, 480)
    assert isinstance(source.sensors["front"].calibration, DepthCamera)
    assert 0.5 < np.nanmedian(last["front"].depth_m) < 5.0
    assert truth is not None
    assert len(truth) == 150
    np.testing.assert_allclose(truth.poses[0], 0.0, atol=1e-9)
    assert np.abs(np.diff(truth.positions, axis=0)).max() < 0.05  # 1.5 m/s


def test_the_wheel_odometry_of_the_bag_is_read(data_folder):
    config = {"path": data_folder / "fusion/rl_test1.bag", "topics": {"wheels": "/husky_velocity_controller/odom"}}
    source = Rosbag(RosbagConfig.model_validate(config))

    counts, _ = counted(source)

    assert counts == {"wheels": 3952}
    assert source.counters() == {}
    assert source.sensors["wheels"].rate_hz == pytest.approx(10, abs=0.1)


def test_the_imu_of_the_bag_is_merged_by_its_header_stamps(data_folder):
    source = Rosbag(RosbagConfig.model_validate({"path": data_folder / "fusion/rl_test1.bag"}))

    counts, _ = counted(source)

    assert counts == {"imu_data": 11865, "husky_velocity_controller_odom": 3952}


@pytest.mark.parametrize(("robot", "n_rows", "n_repeated"), [(1, 61785, 0), (4, 52916, 10)])
def test_the_odometry_and_truth_of_a_mrclam_robot_are_read_as_they_are(data_folder, robot, n_rows, n_repeated):
    folder = data_folder / "fusion/mrclam_D6"
    source = CsvOdometry(
        CsvOdometryConfig.model_validate(
            {
                "path": folder / f"Robot{robot}_Odometry.dat",
                "header": ["t", "v", "omega"],
                "poses": folder / f"Robot{robot}_Groundtruth.dat",
                "poses_header": ["t", "x", "y", "theta"],
            }
        )
    )

    counts, _ = counted(source)
    truth = source.ground_truth()

    assert counts == {"front": n_rows - n_repeated}
    assert source.counters() == ({"repeated": n_repeated} if n_repeated else {})
    assert truth is not None
    assert truth.length_m() > 40


def test_the_corrected_log_of_freiburg_is_read_whole(data_folder):
    path = data_folder / "omni/laser2d_carmen/freiburg-079-corrected.log.gz"
    source = CarmenLog(CarmenLogConfig.model_validate({"path": path}))

    counts, last = counted(source)
    truth = source.ground_truth()

    assert counts == {"laser": 4791, "odometry": 4934}
    assert source.counters() == {"restated": 4791}
    assert truth is not None
    assert len(truth) == 4791
    # The wheels' own drift has not been corrected away, which SLAM's poses agree with to centimetres.
    error = truth[0][1].between(truth[len(truth) - 1][1]).between(last["odometry"].pose_start_base)
    assert np.hypot(error.x, error.y) > 1.0


def test_the_log_of_intel_is_read_when_lines_out_of_time_are_skipped(data_folder):
    path = data_folder / "omni/laser2d_carmen/intel-corrected.log.gz"
    source = CarmenLog(CarmenLogConfig.model_validate({"path": path, "on_bad_frame": "skip"}))

    counts, _ = counted(source)

    lines = {"laser": 910, "odometry": 14541 - 910}
    told = source.counters()
    assert sum(counts.values()) + told["skipped"] + told["repeated"] == sum(lines.values())
    assert told["restated"] == 910
    assert counts["laser"] == 906


def test_a_plain_folder_of_kitti_and_the_corridor_are_read(data_folder):
    street = KittiOdometry(KittiOdometryConfig.model_validate({"path": data_folder / "divs/kitti_raw_stereo/left"}))
    corridor = ImageFolder(ImageFolderConfig.model_validate({"path": data_folder / "divs/corridor/ref", "rate_hz": 2}))

    assert counted(street)[0] == {"front": 300}
    assert counted(corridor)[0] == {"front": 111}


@pytest.mark.slow
@pytest.mark.parametrize(("number", "named"), [(1, PLAZA1), (2, PLAZA2)])
def test_a_lawn_mower_among_radios_is_found_by_the_recording_that_is_named(data_folder, number, named):
    """Wheels alone are off by 45 and 72 m at most."""
    file = data_folder / f"uwb/Plaza{number}_.mat"
    if not file.exists():
        pytest.skip(f"{file} holds the truth of these recordings, and is not here")
    rows = []
    with Pipeline(named.config_in(data_folder)) as pipeline:
        for step in pipeline:
            pose = step.belief.pose_map_base
            rows.append((step.stamp_s, pose.x, pose.y))

    stamps_s, x, y = np.array(rows).T
    truth = loadmat(file)["GT"]
    errors = np.hypot(*(np.interp(stamps_s, truth[:, 0], truth[:, k]) - way for k, way in ((1, x), (2, y))))
    assert np.sqrt(np.mean(errors**2)) < 0.6
