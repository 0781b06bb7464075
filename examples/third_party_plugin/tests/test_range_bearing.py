"""The source and the localizer, on a recording made by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from trailmark_mrclam.config import MrclamLandmarksConfig, RangeBearingConfig
from trailmark_mrclam.localizer import RangeBearing, most_likely_fix, sighting, squares_of_curves
from trailmark_mrclam.source import MrclamLandmarks

from trailmark.errors import SourceError
from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Record
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

MOUNTED = Pose2(0.1, 0.05, 0.3)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    (tmp_path / "Barcodes.dat").write_text("# Subject # Barcode #\n 1 5\n 6 72\n 7 27\n")
    (tmp_path / "Landmark_Groundtruth.dat").write_text("6 4.0 0.0 0.001 0.001\n7 0.0 3.0 0.001 0.001\n")
    measurements = tmp_path / "Robot1_Measurement.dat"
    measurements.write_text("# Time\n10.0 72 4.0 0.0\n10.0 27 3.0 1.5708\n10.5 5 1.0 0.0\n11.0 72 3.5 0.1\n")
    return measurements


def opened(recording: Path) -> MrclamLandmarks:
    source = MrclamLandmarks(MrclamLandmarksConfig(path=recording))
    source.start(Session(name="landmarks"))
    return source


def test_sightings_of_one_instant_are_one_frame_and_other_robots_are_left_out(recording: Path) -> None:
    frames = list(opened(recording).frames())

    assert [frame.stamp_s for frame in frames] == [10.0, 11.0]
    assert isinstance(frames[0].payload, Record)
    assert frames[0].payload.arrays["ids"].tolist() == [6, 7]


@pytest.mark.parametrize("line", ["12.0 72 4.0", "12.0 72 nan 0.0", "12.0 72 far 0.0"])
def test_a_malformed_line_is_named(recording: Path, line: str) -> None:
    recording.write_text(recording.read_text() + line + "\n")

    with pytest.raises(SourceError, match=r"Robot1_Measurement.dat:6"):
        opened(recording)


def test_a_fix_says_what_a_sighting_says_and_no_more(recording: Path) -> None:
    source = opened(recording)
    localizer = RangeBearing(RangeBearingConfig(sightings="landmarks"))
    localizer.start(Session(sensors=source.sensors))
    frame = next(source.frames())

    fixes = localizer.observe(frame, Belief(10.0, Pose2(0.2, -0.1, 0.1), np.diag([0.1, 0.1, 0.1])))

    assert len(fixes) == 2
    for fix in fixes:
        assert isinstance(fix, Fix)
        assert np.linalg.matrix_rank(fix.information, tol=1e-6) == 2
    assert isinstance(localizer.observe(frame, Belief(10.0))[0], Lost)


def test_derivatives_are_those_of_the_sighting() -> None:
    pose, landmark, step = Pose2(1.0, 2.0, 0.7), (4.0, -1.0), 1e-6

    _, rows = sighting(pose, landmark, MOUNTED)

    for column, (dx, dy, turn) in enumerate(np.eye(3) * step):
        ahead, _ = sighting(Pose2(pose.x + dx, pose.y + dy, pose.theta + turn), landmark, MOUNTED)
        behind, _ = sighting(Pose2(pose.x - dx, pose.y - dy, pose.theta - turn), landmark, MOUNTED)
        np.testing.assert_allclose(rows[:, column], (ahead - behind) / (2 * step), atol=1e-6)


def test_what_the_derivatives_leave_out_is_what_is_drawn() -> None:
    pose, landmark, covariance = Pose2(1.0, 2.0, 0.7), (4.0, -1.0), np.diag([0.3, 0.2, 0.3]) ** 2
    expected, rows = sighting(pose, landmark, MOUNTED)
    shifts = np.random.default_rng(0).multivariate_normal(np.zeros(3), covariance, 20_000)
    seen = np.array([sighting(Pose2.from_array(pose.array() + one), landmark, MOUNTED)[0] for one in shifts])
    left = seen - expected - shifts @ rows.T

    squares = squares_of_curves(pose, landmark, MOUNTED, covariance)

    np.testing.assert_allclose(squares, left.T @ left / len(left), rtol=0.15, atol=2e-5)


def test_the_fix_leads_to_where_an_iterated_filter_arrives() -> None:
    believed, covariance, landmark = Pose2(1.0, 0.0, 0.2), np.diag([0.3, 0.2, 0.1]), (4.0, -1.0)
    seen, variances = np.array([2.6, -0.3]), np.array([0.04, 0.01])

    found = most_likely_fix(believed, covariance, landmark, seen, variances, MOUNTED)

    assert found is not None
    pose, rows = found
    information = (rows.T / variances) @ rows
    shift = np.linalg.solve(np.linalg.inv(covariance) + information, information @ (pose.array() - believed.array()))
    x, y, theta = believed.array() + shift
    predicted, rows = sighting(Pose2(x, y, theta), landmark, MOUNTED)
    gradient = np.linalg.solve(covariance, shift) - rows.T @ ((seen - predicted) / variances)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-4)


def test_from_on_top_of_a_landmark_it_is_lost() -> None:
    landmark, seen = (4.0, -1.0), np.array([1.0, 0.0])

    assert most_likely_fix(Pose2(*landmark), np.eye(3), landmark, seen, np.ones(2), Pose2()) is None
