"""The peers of a downward camera: KLT, ORB and phase correlation over a floor with known motions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame, GroundPlane, Image, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.geometry.rigid import fit_pose2
from trailmark.interfaces import Session
from trailmark.testing.ground import GroundCamera, MirroredFloor, ground_run
from trailmark_baselines.ground.config import KLTConfig, ORBConfig, PhaseCorrelationConfig
from trailmark_baselines.ground.klt import KLT
from trailmark_baselines.ground.orb import ORB
from trailmark_baselines.ground.phase import PhaseCorrelation
from trailmark_baselines.ground.rigid import alignment_covariance, ransac_rigid

PEERS = {
    "klt": (KLT, KLTConfig),
    "orb": (ORB, ORBConfig),
    "phase_correlation": (PhaseCorrelation, PhaseCorrelationConfig),
}
#: Largest error of one motion on the floor below [px, deg].
PRECISION = {"klt": (0.1, 0.03), "orb": (0.4, 0.15), "phase_correlation": (0.15, 0.06)}
SCALE_M = 3.9e-4
GROUND = MirroredFloor.procedural(seed=4, size_px=512, grain_px=1.5, contrast=20.0)
CAMERA = GroundCamera((320, 288), noise_sigma=2.0)


def make(name: str, sensor: SensorInfo, **keys: object):
    localizer_class, config_class = PEERS[name]
    localizer = localizer_class(config_class(camera="floor", **keys))
    localizer.start(Session(name=name, sensors={"floor": sensor}))
    return localizer


def drive(poses: list[Pose2], camera: GroundCamera = CAMERA):
    """Frames along poses, 70 a second."""
    return ground_run(lambda time_s: poses[round(time_s * 70)], len(poses), ground=GROUND, camera=camera)


def along(n_steps: int, *twist: float) -> list[Pose2]:
    """Poses of a steady motion: forward [px], left [px], turn [deg] a picture."""
    step = Pose2.exp(twist[0] * SCALE_M, twist[1] * SCALE_M, math.radians(twist[2]))
    poses = [Pose2(0.3, 0.2, 0.4)]
    for _ in range(n_steps):
        poses.append(poses[-1] @ step)
    return poses


def observed(localizer, run) -> list[object]:
    return [said for frame in run.frames for said in localizer.observe(frame, Belief(frame.stamp_s))]


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("twist", [(8.0, 0.0, 0.0), (5.0, -3.0, 0.8), (0.0, 0.0, -1.5), (0.0, 0.0, 0.0)])
def test_known_motions_are_found(name, twist):
    run = drive(along(8, *twist))

    said = observed(make(name, run.sensor), run)

    assert [type(estimate) for estimate in said] == [Motion] * 8
    for before, now, motion in zip(run.truth.stamps_s, run.truth.stamps_s[1:], said):
        assert (motion.since_s, motion.stamp_s) == (before, now)
    for n, motion in enumerate(said):
        error = run.truth[n][1].between(run.truth[n + 1][1]).between(motion.pose_since_now)
        assert math.hypot(error.x, error.y) < PRECISION[name][0] * SCALE_M
        assert abs(math.degrees(error.theta)) < PRECISION[name][1]
        np.linalg.cholesky(motion.information)


@pytest.mark.parametrize("name", PEERS)
def test_key_frames_keep_a_drive_from_drifting(name):
    run = drive(along(30, 4.0, 0.0, 0.2))
    keyed, single = make(name, run.sensor), make(name, run.sensor, key_shift=0.0)

    ends = []
    for localizer in (keyed, single):
        pose = run.truth[0][1]
        for motion in observed(localizer, run):
            pose = pose @ motion.pose_since_now
        ends.append(pose.distance_to(run.truth[-1][1]))

    assert single.counters()["key_frames"] == 31
    assert keyed.counters()["key_frames"] < 15
    assert ends[0] < 1.5 * SCALE_M
    assert ends[0] < 1.2 * ends[1]


@pytest.mark.parametrize("name", PEERS)
def test_mounting_and_two_scales_are_taken_into_account(name):
    camera = GroundCamera(
        (320, 288), (3.9e-4, 4.0e-4), Pose3(x=0.12, y=-0.05, yaw=math.radians(120.0)), noise_sigma=2.0
    )
    run = drive(along(5, 4.0, 1.0, 0.7), camera)

    said = observed(make(name, run.sensor), run)

    for n, motion in enumerate(said):
        error = run.truth[n][1].between(run.truth[n + 1][1]).between(motion.pose_since_now)
        assert math.hypot(error.x, error.y) < 2 * PRECISION[name][0] * SCALE_M


@pytest.mark.parametrize("name", PEERS)
def test_a_blank_picture_is_lost_and_the_next_motion_bridges_it(name):
    run = drive(along(6, 4.0, 0.0, 0.0))
    frames = list(run.frames)
    noise = np.random.default_rng(1).normal(128.0, 2.0, (288, 320)).astype(np.uint8)
    frames[3] = replace(frames[3], payload=Image(noise))
    localizer = make(name, run.sensor)

    said = [estimate for frame in frames for estimate in localizer.observe(frame, Belief(frame.stamp_s))]

    assert [type(estimate) for estimate in said] == [Motion, Motion, Lost, Motion, Motion, Motion]
    bridge = said[3]
    assert bridge.since_s == frames[2].stamp_s
    error = run.truth[2][1].between(run.truth[4][1]).between(bridge.pose_since_now)
    assert math.hypot(error.x, error.y) < 2 * PRECISION[name][0] * SCALE_M
    assert localizer.counters()["lost"] == 1


@pytest.mark.parametrize("name", PEERS)
def test_another_floor_is_lost_and_begun_anew(name):
    run = drive(along(9, 4.0, 0.0, 0.0))
    other = run.over(MirroredFloor.procedural(seed=9, size_px=512, grain_px=1.5, contrast=20.0))
    frames = [*list(run.frames)[:4], *list(other.frames)[4:]]
    localizer = make(name, run.sensor)

    said = [estimate for frame in frames for estimate in localizer.observe(frame, Belief(frame.stamp_s))]

    kinds = [type(estimate) for estimate in said]
    assert kinds[:3] == [Motion] * 3
    assert kinds[3] is Lost
    assert kinds[-1] is Motion
    assert said[-1].since_s >= frames[4].stamp_s
    for motion in (estimate for estimate in said if isinstance(estimate, Motion)):
        first, last = (round(70 * stamp_s) for stamp_s in (motion.since_s, motion.stamp_s))
        error = run.truth[first][1].between(run.truth[last][1]).between(motion.pose_since_now)
        assert math.hypot(error.x, error.y) < 2 * PRECISION[name][0] * SCALE_M


def test_covariance_is_of_the_size_of_the_error():
    """Normalised squared errors of KLT over drives, between a tenth and five."""
    squares = []
    for seed in range(6):
        poses = [Pose2(0.1 * seed, 0.2) @ pose for pose in along(40, 6.0, 0.0, 0.0)]
        run = ground_run(lambda t, p=poses: p[round(t * 70)], 41, ground=GROUND, camera=CAMERA, seed=seed)
        pose, covariance = Pose2(), np.zeros((3, 3))
        for motion in observed(make("klt", run.sensor), run):
            pose, covariance = pose @ motion.pose_since_now, covariance + np.linalg.inv(motion.information)
        error = run.truth[0][1].between(run.truth[-1][1]).between(pose)
        squares.append([error.x**2 / covariance[0, 0], error.theta**2 / covariance[2, 2]])

    assert np.all((np.mean(squares, axis=0) > 0.1) & (np.mean(squares, axis=0) < 5.0))


def test_a_camera_without_scale_is_refused():
    plane = GroundPlane((1e-3, 1e-3))
    with pytest.raises(ConfigError, match="metres_per_pixel"):
        make("klt", SensorInfo("floor", "image"))
    with pytest.raises(ConfigError, match="level"):
        make(
            "orb",
            SensorInfo("floor", "image", pose_base_sensor=Pose3(pitch=0.1), calibration=plane),
        )
    localizer = make("klt", SensorInfo("floor", "image", calibration=plane))
    with pytest.raises(ShapeError, match="8 bits"):
        localizer.observe(Frame("floor", 0.0, Image(np.zeros((48, 64), np.uint16))), Belief(0.0))


def test_a_rigid_fit_finds_the_pose_among_wrong_pairs():
    rng = np.random.default_rng(0)
    b = rng.uniform(-200.0, 200.0, (80, 2))
    true = Pose2(12.0, -7.0, 0.03)
    a = true @ b
    a[:30] = rng.uniform(-200.0, 200.0, (30, 2))

    found = ransac_rigid(a, b, 1.0)

    assert found is not None
    assert found[0].array() == pytest.approx(true.array(), abs=1e-9)
    assert not found[1][:30].any() or found[1].sum() < 53
    assert ransac_rigid(a[:2], b[:2], 1.0) is None


def test_the_covariance_of_a_fit_is_that_of_its_scatter():
    rng = np.random.default_rng(3)
    b, true = rng.uniform(-200.0, 200.0, (40, 2)), Pose2(3.0, 1.0, 0.2)
    fits = []
    for _ in range(400):
        a = true @ b + rng.normal(0.0, 0.5, (40, 2))
        fits.append(fit_pose2(a, b).array())
    predicted = alignment_covariance(a, true, b, 1e-9)

    np.testing.assert_allclose(np.diag(predicted), np.var(fits, axis=0), rtol=0.4)
