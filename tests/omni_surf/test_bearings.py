"""Localization from bearings, and landmarks measured from known poses."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from trailmark.arrays import Bools
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, wrap_angle, wrap_angles
from trailmark_omni_surf.bearing_kernels import bearing_errors, bearing_scales, closed_form, hypotheses
from trailmark_omni_surf.bearings import BearingFix, BearingNoise, locate, widened
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.landmarks import FEATURE_NAMES, landmark_features, measure_landmark

Array = npt.NDArray[np.float64]
SQUARE = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0], [3.0, 8.0]])

inside = st.floats(0.5, 5.5)
headings = st.floats(-math.pi, 3.14)


def bearings_at(pose: Pose2, landmarks: Array) -> Array:
    return wrap_angles(np.arctan2(landmarks[:, 1] - pose.y, landmarks[:, 0] - pose.x) - pose.theta)


@settings(deadline=None)
@given(x=inside, y=inside, theta=headings)
def test_exact_bearings_give_the_exact_pose_in_closed_form(x: float, y: float, theta: float) -> None:
    pose = Pose2(x, y, theta)

    found = closed_form(SQUARE, bearings_at(pose, SQUARE), np.ones(5))

    np.testing.assert_allclose(found[:2], [x, y], atol=1e-7)
    assert abs(wrap_angle(found[2] - theta)) < 1e-7


@settings(deadline=None)
@given(x=inside, y=inside, theta=headings)
def test_three_exact_bearings_are_enough_off_the_danger_circle(x: float, y: float, theta: float) -> None:
    pose = Pose2(x, y, theta)
    assume(abs(math.hypot(x - 3.0, y - 3.0) - math.hypot(3.0, 3.0)) > 0.5)

    fix = locate(SQUARE[:3], bearings_at(pose, SQUARE[:3]), BearingNoise(max_position_sigma_m=10.0))

    assert fix is not None
    assert fix.pose_map_base.distance_to(pose) < 1e-5


def two_of_seven_wrong(pose: Pose2, seed: int) -> tuple[BearingFix, Bools]:
    """Return what is found of seven landmarks, and which two of them are 0.6 to 2 rad off."""
    rng = np.random.default_rng(seed)
    landmarks = np.concatenate([SQUARE, [[-1.0, 3.0], [7.0, 2.5]]])
    bearings = bearings_at(pose, landmarks) + rng.normal(0.0, math.radians(0.3), 7)
    wrong = rng.choice(7, 2, replace=False)
    bearings[wrong] += rng.choice([-1, 1], 2) * rng.uniform(0.6, 2.0, 2)
    fix = locate(landmarks, wrap_angles(bearings))
    assert fix is not None
    return fix, np.isin(np.arange(7), wrong)


def is_told(fix: BearingFix) -> bool:
    """Return whether `omni_surf` tells this, or refuses it for another place that explains nearly as much."""
    return fix.rival_support <= OmniSurfConfig(camera="omni").max_rival_share * fix.support


@settings(deadline=None)
@given(x=st.floats(2, 4), y=st.floats(2, 4), theta=headings, seed=st.integers(0, 1000))
def test_two_of_seven_wrong_landmarks_are_found_out_or_nothing_is_told(
    x: float, y: float, theta: float, seed: int
) -> None:
    pose = Pose2(x, y, theta)

    fix, is_wrong = two_of_seven_wrong(pose, seed)

    is_right = fix.pose_map_base.distance_to(pose) < 0.25 and not fix.is_inlier[is_wrong].any()
    assert is_right or not is_told(fix)


def test_where_six_of_seven_agree_elsewhere_by_chance_nothing_is_told() -> None:
    fix, _ = two_of_seven_wrong(Pose2(2.0, 2.0, 0.0), seed=157)

    assert not is_told(fix)


def test_two_of_seven_wrong_landmarks_leave_an_answer_as_a_rule() -> None:
    found = [two_of_seven_wrong(Pose2(2.5, 3.0, 0.4), seed)[0] for seed in range(100)]

    assert sum(map(is_told, found)) >= 99


def test_landmarks_on_a_circle_with_the_robot_are_refused() -> None:
    angles = np.array([0.3, 1.5, 2.9, 4.0])
    circle = 3.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    assert locate(circle, bearings_at(Pose2(3.0, 0.0, 0.2), circle)) is None


@pytest.mark.parametrize("bearings", [[0.1, 0.1, 0.1], [0.0, np.nan, 1.0]])
def test_bearings_that_say_nothing_give_no_answer(bearings: list[float]) -> None:
    assert locate(SQUARE[:3], np.array(bearings)) is None


def test_two_landmarks_are_not_enough() -> None:
    assert locate(SQUARE[:2], np.zeros(2)) is None


def test_arrays_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"must be \(N, 2\) and \(N,\)"):
        locate(SQUARE, np.zeros(3))


def test_information_matches_the_scatter_of_many_noisy_fixes() -> None:
    rng = np.random.default_rng(3)
    pose, sigma_rad = Pose2(2.0, 2.5, 0.4), math.radians(1.0)
    fixes = [
        locate(SQUARE, bearings_at(pose, SQUARE) + rng.normal(0.0, sigma_rad, 5), BearingNoise(sigma_rad))
        for _ in range(800)
    ]

    errors = np.array([pose_error(fix.pose_map_base, pose) for fix in fixes if fix is not None])
    nees = np.einsum("ni,nij,nj->n", errors, np.array([fix.information for fix in fixes if fix is not None]), errors)

    assert len(errors) == 800
    assert 2.0 < nees.mean() < 3.6  # 3 degrees of freedom; the noise estimate only ever grows


def pose_error(found: Pose2, true: Pose2) -> tuple[float, float, float]:
    return found.x - true.x, found.y - true.y, wrap_angle(found.theta - true.theta)


@pytest.mark.parametrize("wrong_deg", [-4.5, 4.5])
def test_a_far_landmark_that_decides_alone_and_is_wrong_is_within_what_is_claimed(wrong_deg: float) -> None:
    """Near ones on one side hold the position; the heading is what the far one says, and no error shows that."""
    directions = np.radians([105.0, 115.0, 122.0, 130.0, 138.0, 145.0, 150.0, 189.0])
    distances = np.array([0.7, 0.9, 0.7, 0.8, 0.9, 0.7, 0.9, 7.0])
    landmarks = distances[:, None] * np.column_stack([np.cos(directions), np.sin(directions)])
    bearings = bearings_at(Pose2(), landmarks)
    bearings[-1] += math.radians(wrong_deg)

    fix = locate(landmarks, bearings, BearingNoise(math.radians(1.0)), Pose2())

    assert fix is not None
    error = np.array(pose_error(fix.pose_map_base, Pose2()))
    assert abs(error[2]) > math.radians(1.0)
    assert error @ fix.information @ error < 16.3  # chi square of 3 numbers, 99.9 %


def test_many_sightings_in_a_row_tell_no_more_than_four() -> None:
    """They err alike; and what is seen has a size."""
    ways = [np.column_stack([np.linspace(-1.0, 1.0, n), np.zeros(n), np.zeros(n)]) for n in (4, 40)]

    few, many = (measure_landmark(way, np.arctan2(3.0, -way[:, 0])) for way in ways)

    assert few is not None
    assert many is not None
    assert math.sqrt(many.covariance[1, 1]) > 0.9 * math.sqrt(few.covariance[1, 1])  # the ends weigh more among four
    assert np.linalg.eigvalsh(many.covariance)[0] > 0.05**2


@given(st.floats(0.0, 10.0), st.floats(0.0, math.pi))
def test_information_is_widened_to_a_covariance_and_where_it_says_more_it_stays(sigma: float, angle: float) -> None:
    information = np.diag([1.0, 4.0])
    axis = np.array([math.cos(angle), math.sin(angle)])

    covariance = np.linalg.inv(widened(information, sigma**2 * np.outer(axis, axis)))

    assert axis @ covariance @ axis > (1.0 - 1e-9) * sigma**2
    assert np.linalg.eigvalsh(covariance - np.linalg.inv(information))[0] > -1e-9
    if sigma < 0.5:
        np.testing.assert_allclose(covariance, np.linalg.inv(information), atol=1e-9)


@pytest.mark.parametrize("wrong_deg", [6.0, 10.0, 15.0])
def test_one_near_landmark_that_is_wrong_among_far_ones_is_within_what_is_claimed(wrong_deg: float) -> None:
    """It holds the position alone against twelve that lie within 80 degrees, so that hardly an error of it is left."""
    directions = np.radians(np.append(np.linspace(-40.0, 40.0, 12), 100.0))
    distances = np.append(np.full(12, 6.0), 0.8)
    landmarks = distances[:, None] * np.column_stack([np.cos(directions), np.sin(directions)])
    bearings = bearings_at(Pose2(), landmarks)
    bearings[-1] += math.radians(wrong_deg)

    fix = locate(landmarks, bearings, BearingNoise(math.radians(1.0)), Pose2(0.72 * math.radians(wrong_deg), 0.0, 0.0))

    assert fix is not None
    error = np.array(pose_error(fix.pose_map_base, Pose2()))
    assert math.hypot(*error[:2]) > 0.1
    assert error @ fix.information @ error < 16.3


@given(x=st.floats(-5, 5), y=st.floats(2, 8))
def test_rays_of_known_poses_meet_in_the_landmark(x: float, y: float) -> None:
    poses = np.array([[-1.0, 0.0, 0.3], [0.0, 0.1, -2.0], [1.0, -0.1, 1.0], [2.0, 0.0, 3.0]])
    bearings = np.arctan2(y - poses[:, 1], x - poses[:, 0]) - poses[:, 2]

    measurement = measure_landmark(poses, bearings)

    assert measurement is not None
    np.testing.assert_allclose(measurement.position, [x, y], atol=1e-6)


def test_the_printed_tangents_agree_away_from_ninety_degrees_and_fail_at_it() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]])
    ahead = np.arctan2(1.0 - poses[:, 1], 4.0)
    sideways = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    above = np.arctan2(3.0, 1.0 - sideways[:, 0])
    above[1] += 0.02  # the ray that points to 90 degrees is a little wrong, and its tangent is -50

    printed, ours = (measure_landmark(poses, ahead, form=form) for form in ("tangent", "sine_cosine"))
    blown, right = (measure_landmark(sideways, above, form=form) for form in ("tangent", "sine_cosine"))

    assert printed is not None
    assert ours is not None
    assert right is not None
    assert blown is not None
    np.testing.assert_allclose(printed.position, ours.position, atol=1e-9)
    assert np.linalg.norm(blown.position - [1.0, 3.0]) > 1.5 * np.linalg.norm(right.position - [1.0, 3.0])


def test_a_mismatched_observation_is_left_out() -> None:
    poses = np.column_stack([np.linspace(0, 3, 9), np.zeros(9), np.zeros(9)])
    bearings = np.arctan2(4.0, 1.5 - poses[:, 0])
    bearings[4] += 0.3

    measurement = measure_landmark(poses, bearings)

    assert measurement is not None
    assert not measurement.is_inlier[4]
    np.testing.assert_allclose(measurement.position, [1.5, 4.0], atol=1e-6)


def test_observations_from_one_place_measure_nothing() -> None:
    poses = np.zeros((5, 3))

    assert measure_landmark(poses, np.full(5, 0.7)) is None


def test_the_six_features_stand_in_the_papers_order() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 1.0, 0.0]])
    bearings = np.arctan2(4.0 - poses[:, 1], 1.0 - poses[:, 0])
    measurement = measure_landmark(poses, bearings)
    assert measurement is not None

    features = dict(zip(FEATURE_NAMES, landmark_features(poses, bearings, np.array([80, 90, 100.0]), measurement)))

    assert features["n_observations"] == 3
    assert features["error_rad2"] == pytest.approx(0.0, abs=1e-12)
    assert features["mean_image_distance_px"] == pytest.approx(90.0)
    assert features["variance_x_m2"] == pytest.approx(2 / 3)
    assert features["variance_y_m2"] == pytest.approx(2 / 9)
    assert features["variance_direction_rad2"] > 0


def roh_bearings(folder: Path) -> list[tuple[Pose2, Array]]:
    """Known positions and their measured bearings."""
    places = []
    for path in sorted(folder.glob("(*.csv")):
        x, y = map(float, re.findall(r"[XY]([\d.]+)[,)]", path.name))
        places.append((Pose2(x, y, math.pi / 2), np.radians(np.loadtxt(path, delimiter=","))))
    return places


@pytest.mark.data
def test_real_beacons_are_within_ten_centimetres_in_the_median(data_folder: Path) -> None:
    folder = data_folder / "omni" / "bearing"
    beacons = np.loadtxt(folder / "landmark.csv", delimiter=",")
    errors = []
    for pose, rows in roh_bearings(folder):
        for bearings in rows[::4]:
            fix = locate(beacons, bearings)
            assert fix is not None
            errors.append(fix.pose_map_base.distance_to(pose))

    assert np.median(errors) <= 0.10
    assert np.quantile(errors, 0.95) <= 0.30


@pytest.mark.data
def test_real_triples_are_within_a_metre_or_refused(data_folder: Path) -> None:
    folder = data_folder / "omni" / "bearing"
    beacons = np.loadtxt(folder / "landmark.csv", delimiter=",")
    answered = total = 0
    for pose, rows in roh_bearings(folder):
        for bearings, triple in itertools.product(rows[::4], itertools.combinations(range(4), 3)):
            fix = locate(beacons[list(triple)], bearings[list(triple)])
            total += 1
            if fix is not None:
                answered += 1
                assert fix.pose_map_base.distance_to(pose) <= 1.0

    assert answered >= 0.7 * total


def mismatched(seed: int = 11) -> tuple[Array, Array]:
    """Return eight landmarks and their bearings from (-0.7, 0.4, 0), three of them wrong."""
    rng = np.random.default_rng(seed)
    landmarks = rng.uniform(-5.0, 5.0, (8, 2))
    bearings = np.arctan2(landmarks[:, 1] - 0.4, landmarks[:, 0] + 0.7) + rng.normal(0.0, 0.02, 8)
    bearings[:3] += (1.0, -2.0, 0.7)
    return landmarks, bearings


def plain_support(landmarks: Array, bearings: Array, pose: Array, gate_rad: float) -> float:
    errors = np.abs(bearing_errors(landmarks, bearings, pose)) / gate_rad
    return float((1.0 - errors[errors <= 1.0] ** 2).sum()) if np.isfinite(pose).all() else -1.0


def test_hypotheses_are_all_triples_with_their_support() -> None:
    landmarks, bearings = mismatched()
    gate_rad = math.radians(5.0)
    triples = [list(idx) for idx in itertools.combinations(range(8), 3)]

    poses, supports = hypotheses(landmarks, bearings, gate_rad, 1)

    expected = [closed_form(landmarks, bearings, np.ones(8))]
    expected += [closed_form(landmarks[idx], bearings[idx], np.ones(3)) for idx in triples]
    np.testing.assert_allclose(poses, expected)
    np.testing.assert_allclose(supports, [plain_support(landmarks, bearings, pose, gate_rad) for pose in expected])
    np.testing.assert_allclose(poses[supports.argmax(), :2], (-0.7, 0.4), atol=0.3)
    assert len(hypotheses(landmarks, bearings, gate_rad, 5)[0]) == 1 + math.ceil(56 / 5)


def test_a_fix_knows_how_well_another_place_would_do() -> None:
    landmarks, bearings = mismatched()
    shifted = landmarks + np.array([3.0, 0.0])  # the same things once more, 3 m further

    clear = locate(landmarks, bearings)
    doubtful = locate(np.concatenate([landmarks, shifted]), np.concatenate([bearings, bearings]))

    assert clear is not None
    assert doubtful is not None
    assert clear.rival_support < 0.75 * clear.support
    assert doubtful.rival_support > 0.8 * doubtful.support


def test_the_widest_gap_goes_once_around() -> None:
    bearings = np.array([3.0, -3.0, 0.0, 1.0])
    seen = locate(10.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=1), bearings)

    assert seen is not None
    assert seen.widest_gap_rad(bearings) == pytest.approx(3.0)


def test_a_landmark_counts_by_how_well_it_was_measured_across_the_line_of_sight() -> None:
    landmarks = np.array([[4.0, 0.0], [0.0, 4.0]])
    along_x = np.tile(np.diag([0.25, 0.0]), (2, 1, 1))

    scales = bearing_scales(landmarks, along_x, np.zeros(3), math.radians(1.0))

    sigma_rad = math.hypot(math.radians(1.0), 0.5 / 4.0)
    np.testing.assert_allclose(scales, [1.0, math.radians(1.0) / sigma_rad])


def test_badly_measured_landmarks_do_not_bend_the_pose() -> None:
    pose = Pose2(2.5, 3.5, 0.4)
    landmarks = np.concatenate([SQUARE, [[3.0, 6.5], [6.5, 3.0]]])
    bearings = bearings_at(pose, landmarks)
    believed = landmarks + np.array([[0.0, 0.0]] * 5 + [[0.25, 0.0], [0.0, 0.25]])
    covariances = np.array([np.eye(2) * (1e-4 if k < 5 else 0.06) for k in range(7)])

    alike, weighed = locate(believed, bearings), locate(believed, bearings, covariances=covariances)

    assert alike is not None
    assert weighed is not None
    assert weighed.pose_map_base.distance_to(pose) < 0.25 * alike.pose_map_base.distance_to(pose)


def test_covariances_of_another_shape_are_refused() -> None:
    with pytest.raises(ShapeError, match="covariances of 5 landmarks"):
        locate(SQUARE, np.zeros(5), covariances=np.zeros((5, 2)))
