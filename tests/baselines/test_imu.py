"""An inertial unit as a gyro and a compass."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Lost, Motion
from trailmark.frames import Frame, Imu, Scalar, SensorInfo
from trailmark.geometry import Pose3
from trailmark.interfaces import Session
from trailmark_baselines.config import ImuConfig
from trailmark_baselines.imu import ImuLocalizer

LEVEL = Pose3()
# As on a Husky of robot_localization's tests: rolled by 90 deg about x, then turned by -90 deg about z.
ON_ITS_SIDE = Pose3(y=-0.3, z=0.52, roll=math.pi / 2, yaw=-math.pi / 2)


def started(mounting: Pose3 = LEVEL, **keys) -> ImuLocalizer:
    made = ImuLocalizer(ImuConfig.model_validate({"imu": "imu", **keys}))
    made.start(Session(sensors={"imu": SensorInfo("imu", "imu", pose_base_sensor=mounting)}))
    return made


def reading(stamp_s: float, yaw_radps: float, mounting: Pose3 = LEVEL, heading_rad: float | None = None) -> Frame:
    """What a unit reads when base turns on level ground."""
    rotation = mounting.rotation()
    quat = None
    if heading_rad is not None:
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        quat = quaternion(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ rotation)
    return Frame("imu", stamp_s, Imu(rotation.T @ np.array([0.0, 0.0, yaw_radps]), None, quat))


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the quaternion of a rotation, as the eigenvector of Bar-Itzhack's matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    k = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.linalg.eigh(k)[1][:, -1]


def observed(made: ImuLocalizer, *frames: Frame) -> list:
    return [estimate for frame in frames for estimate in made.observe(frame, Belief(frame.stamp_s))]


@pytest.mark.parametrize("mounting", [LEVEL, ON_ITS_SIDE])
def test_the_turn_is_the_mean_rate_and_nothing_else_is_measured(mounting):
    first, second = reading(1.0, 0.2, mounting), reading(1.1, 0.4, mounting)

    (motion,) = observed(started(mounting, turn_sigma_deg=0.3), first, second)

    assert isinstance(motion, Motion)
    assert (motion.since_s, motion.stamp_s) == (1.0, 1.1)
    assert motion.pose_since_now.theta == pytest.approx(0.03)
    sigma_rad = math.radians(0.3) * math.sqrt(0.1)
    np.testing.assert_allclose(motion.information, np.diag([0.0, 0.0, sigma_rad**-2]), rtol=1e-9)


@pytest.mark.parametrize("mounting", [LEVEL, ON_ITS_SIDE])
@pytest.mark.parametrize("heading_rad", [-3.0, -0.4, 0.0, 1.0, 2.5])
def test_the_heading_is_that_of_base_however_the_unit_is_mounted(mounting, heading_rad):
    (fix,) = observed(started(mounting, heading_sigma_deg=2.0), reading(1.0, 0.0, mounting, heading_rad))

    assert isinstance(fix, Fix)
    assert fix.pose_map_base.theta == pytest.approx(heading_rad, abs=1e-9)
    assert np.linalg.matrix_rank(fix.information) == 1


def test_a_known_bias_is_taken_off_and_north_is_added():
    made = started(bias_deg_per_s=3.0, heading_sigma_deg=2.0, north_deg=90.0)

    _, motion, fix = observed(made, *(reading(stamp_s, math.radians(3.0), LEVEL, 0.1) for stamp_s in (1.0, 1.1)))

    assert motion.pose_since_now.theta == pytest.approx(0.0, abs=1e-12)
    assert fix.pose_map_base.theta == pytest.approx(0.1 + math.pi / 2)


def test_a_heading_is_not_told_unless_it_is_asked_for():
    assert observed(started(), reading(1.0, 0.0, LEVEL, 0.3)) == []


def test_a_gap_is_left_and_other_frames_are_not_looked_at():
    made = started(max_gap_s=0.5)

    assert observed(made, reading(1.0, 0.1), reading(2.0, 0.1), Frame("light", 2.1, Scalar(1.0))) == []
    assert len(observed(made, reading(2.4, 0.1))) == 1


def test_what_is_no_number_is_lost_and_the_next_reading_begins_anew():
    made = started()

    (lost,) = observed(made, reading(1.0, 0.1), reading(1.1, math.nan))

    assert isinstance(lost, Lost)
    assert observed(made, reading(1.2, 0.1)) == []


def test_zeros_in_place_of_an_orientation_are_no_heading():
    made = started(heading_sigma_deg=2.0)

    (lost,) = observed(made, Frame("imu", 1.0, Imu(np.zeros(3), None, np.zeros(4))))

    assert lost == Lost(1.0, "the orientation is no rotation: its quaternion has norm 0")


def test_starting_again_forgets_the_last_reading():
    made = started()
    observed(made, reading(1.0, 0.1))

    made.start(Session(sensors={"imu": SensorInfo("imu", "imu")}))

    assert observed(made, reading(1.1, 0.1)) == []


def pulled(stamp_s: float, force_mps2: tuple[float, float, float]) -> Frame:
    """What a unit reads that does not turn, and on which this force acts."""
    return Frame("imu", stamp_s, Imu(np.zeros(3), np.array(force_mps2)))


@pytest.mark.parametrize(
    ("force_mps2", "axis"), [((0.0, 9.8, 0.3), "y"), ((-9.8, 0.5, 0.0), "x"), ((7.5, 1.0, 6.3), "x")]
)
def test_a_unit_on_its_side_is_lost_and_says_along_which_axis_gravity_pulls(force_mps2, axis):
    said = observed(started(), *(pulled(0.02 * i, force_mps2) for i in range(100)))

    assert isinstance(said[-1], Lost)
    assert f"gravity pulls along {axis} of base" in said[-1].reason
    assert not any(isinstance(one, Motion) for one in said[30:])


def test_with_its_mounting_told_a_unit_on_its_side_is_heard():
    force = ON_ITS_SIDE.rotation().T @ np.array([0.0, 0.0, 9.81])

    said = observed(started(ON_ITS_SIDE), *(pulled(0.02 * i, tuple(force)) for i in range(100)))

    assert len(said) == 99
    assert all(isinstance(one, Motion) for one in said)


@pytest.mark.parametrize("force_mps2", [(0.2, 0.1, 0.0), (0.0, 30.0, 0.0), (math.nan, 9.8, 0.0), (0.0, 1e308, 0.0)])
def test_forces_that_are_no_gravity_say_nothing_of_the_mounting(force_mps2):
    said = observed(started(), *(pulled(0.02 * i, force_mps2) for i in range(100)))

    assert all(isinstance(one, Motion) for one in said)


def test_a_robot_that_shakes_and_brakes_lies_as_it_is_said():
    rng = np.random.default_rng(0)
    forces = [(6.0 * (20 <= i < 45) + rng.normal(0, 4), rng.normal(0, 4), 9.8 + rng.normal(0, 4)) for i in range(200)]

    said = observed(started(), *(pulled(0.02 * i, force) for i, force in enumerate(forces)))

    assert all(isinstance(one, Motion) for one in said)


def test_an_orientation_that_is_not_used_and_a_unit_upside_down_are_told_once(caplog):
    made = started()
    for i in range(100):
        observed(made, pulled(0.02 * i, (0.0, 0.3, -9.8)), reading(0.02 * i + 0.01, 0.0, heading_rad=0.3))

    assert [record.getMessage().split(": ")[1].split(",")[0] for record in caplog.records] == [
        "it tells an orientation",
        "gravity says that it hangs upside down",
    ]
