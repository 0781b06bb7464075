"""The camera's localizer in a round room: teach, find itself anywhere, track, notice what is wrong."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError, StoreError
from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Frame, Pinhole, Scalar, SensorInfo
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark_omni_surf import bearing_localizer
from trailmark_omni_surf.bearings import position_sigma
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.export import stored_candidates
from trailmark_omni_surf.flows import chance_agreements
from trailmark_omni_surf.landmark_map import LandmarkMap
from trailmark_omni_surf.localizer import OmniSurf

MOUNTING = Pose2(0.2, -0.1, 0.5)


def config(**changes: object) -> OmniSurfConfig:
    return OmniSurfConfig.model_validate({"camera": "omni", "confirm_pictures": 1, **changes})


@pytest.fixture(scope="module")
def room(omni: Any) -> Any:
    return omni.room()


@pytest.fixture(scope="module")
def taught(omni: Any, room: Any) -> Any:
    return omni.taught(room, config(), MOUNTING)


def started(
    room: Any, localizer_map: Any, mode: str = "replay", sensor: SensorInfo | None = None, **changes: Any
) -> OmniSurf:
    localizer = OmniSurf(config(**changes))
    info = sensor or room.sensor(mounting=MOUNTING)
    localizer.start(Session("omni", mode, {"omni": info}, map=localizer_map))  # type: ignore[arg-type]
    return localizer


def look(localizer: OmniSurf, omni: Any, room: Any, pose: Pose2, stamp_s: float = 0.0, **options: Any) -> Any:
    """Show the localizer the picture from a pose of base; it knows the motion, not the pose."""
    image = room.render(pose @ MOUNTING, **options)
    belief = Belief(stamp_s, pose_odom_base=pose, motion_age_s=0.0)
    (answer,) = localizer.observe(omni.frame(image, stamp_s), belief)
    return answer


def errors(answer: Fix, true: Pose2) -> tuple[float, float]:
    off = true.between(answer.pose_map_base)
    return math.hypot(off.x, off.y), abs(off.theta)


def test_landmarks_lie_on_the_wall(taught: Any) -> None:
    saved = taught.load("landmarks")

    distances = np.hypot(*saved["positions"].T)

    assert len(distances) >= 12
    assert (np.abs(distances - 4.0) < 0.6).mean() > 0.84  # T_d; the precision that the selection promises
    assert np.median(np.abs(distances - 4.0)) < 0.05


def test_finishing_again_gives_the_same_landmarks(room: Any, taught: Any) -> None:
    before = taught.load("landmarks")

    started(room, taught, "teach").finish()

    np.testing.assert_array_equal(taught.load("landmarks")["positions"], before["positions"])


@pytest.mark.parametrize("seed", range(4))
def test_it_finds_itself_anywhere_without_a_start_pose(omni: Any, room: Any, taught: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = Pose2(*rng.uniform(-1.2, 1.2, 2), rng.uniform(-3.0, 3.0))

    answer = look(started(room, taught), omni, room, true)

    assert isinstance(answer, Fix)
    distance_m, turn_rad = errors(answer, true)
    assert distance_m < 0.15
    assert turn_rad < math.radians(2)


def test_a_drive_is_tracked_and_every_answer_is_consistent(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught)
    poses = [Pose2(-1.2 + 0.03 * k, 0.3, 0.02 * k) for k in range(60)]

    answers = [look(localizer, omni, room, pose, k / 15) for k, pose in enumerate(poses)]

    assert all(isinstance(answer, Fix) for answer in answers)
    assert np.mean([errors(answer, pose)[0] for answer, pose in zip(answers, poses)]) < 0.10
    assert np.mean([nees(answer, pose) for answer, pose in zip(answers, poses)]) < 8.0
    assert localizer.counters()["main_flow"] >= 55
    assert localizer.counters()["sub_flow"] <= 5


def nees(answer: Fix, true: Pose2) -> float:
    off = answer.pose_map_base.array() - true.array()
    off[2] = wrap_angle(off[2])
    return float(off @ answer.information @ off)


def test_without_tracking_every_picture_is_detected(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught, use_tracking=False)

    for k in range(3):
        assert isinstance(look(localizer, omni, room, Pose2(0.02 * k, 0.0, 0.0), k / 15), Fix)

    assert localizer.counters()["sub_flow"] == 3
    assert localizer.counters()["main_flow"] == 0


def test_a_robot_carried_away_finds_itself_again(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught)
    assert isinstance(look(localizer, omni, room, Pose2(-1.0, 0.0, 0.0)), Fix)
    true = Pose2(0.9, 0.5, 2.0)

    image = room.render(true @ MOUNTING)
    answers = [
        localizer.observe(omni.frame(image, 1.0 + k), Belief(1.0 + k, pose_odom_base=Pose2(-1.0, 0.0, 0.0)))[0]
        for k in range(3)
    ]

    assert isinstance(answers[-1], Fix)
    assert errors(answers[-1], true)[0] < 0.15
    assert all(isinstance(answer, Lost) or errors(answer, true)[0] < 0.5 for answer in answers)


@pytest.mark.parametrize(("ago_s", "is_told", "n_lost"), [(0.1, False, 9), (0.1, True, 1), (7.0, False, 1)])
def test_a_place_to_which_odometry_does_not_lead_is_told_when_ten_pictures_agree(
    omni: Any, room: Any, taught: Any, ago_s: float, is_told: bool, n_lost: int
) -> None:
    """Not where the belief knows it, nor when the last answer is long ago."""
    localizer = started(room, taught, confirm_pictures=2)
    for k in range(2):
        look(localizer, omni, room, Pose2(-1.0, 0.0, 0.0), k / 15)
    true = Pose2(0.9, 0.5, 2.0)
    frames = [omni.frame(room.render(true @ MOUNTING), ago_s + k / 15) for k in range(1, 12)]

    answers = []
    for frame in frames:
        belief = Belief(frame.stamp_s, true if is_told else None, pose_odom_base=Pose2(-1.0), motion_age_s=0.0)
        answers += localizer.observe(frame, belief)

    assert [isinstance(answer, Lost) for answer in answers] == [k < n_lost for k in range(11)]


def test_a_pose_beside_the_taught_way_knows_less(omni: Any, room: Any, taught: Any, monkeypatch: Any) -> None:
    def sigmas(ratio: float, rad_per_m: float) -> Any:
        monkeypatch.setattr(bearing_localizer, "_ASIDE", ratio)
        monkeypatch.setattr(bearing_localizer, "_ASIDE_RAD_PER_M", rad_per_m)
        answer = look(started(room, taught), omni, room, beside)
        return np.sqrt(np.diag(np.linalg.inv(answer.information)))

    way = np.array([keyframe.pose_map_base.array() for keyframe in taught.keyframes()])
    beside = Pose2(way[:, 0].mean(), way[:, 1].max() + 0.5, 0.0)

    with_it, without = sigmas(bearing_localizer._ASIDE, bearing_localizer._ASIDE_RAD_PER_M), sigmas(0.0, 0.0)

    np.testing.assert_allclose(np.sqrt(with_it**2 - without**2), [0.1, 0.1, 0.02], rtol=0.1)


def test_answers_that_scatter_about_the_motion_say_less(omni: Any, room: Any, taught: Any) -> None:
    """Odometry that jumps to and fro stands for landmarks that do: who is wrong nobody knows."""
    localizer, on_way = started(room, taught), taught.keyframes()[len(taught.keyframes()) // 2].pose_map_base

    answers = []
    for k in range(30):
        frame = omni.frame(room.render(on_way @ MOUNTING), k / 15)
        belief = Belief(k / 15, pose_odom_base=Pose2(0.0, 0.2 * (k % 2), 0.0), motion_age_s=0.0)
        answers += localizer.observe(frame, belief)

    first, last = (position_sigma(answer.information) for answer in (answers[0], answers[-1]))
    assert first < 0.08
    assert last > 0.1


def test_a_place_that_is_less_certain_than_asked_is_none(omni: Any, room: Any, taught: Any) -> None:
    on_way = taught.keyframes()[len(taught.keyframes()) // 2].pose_map_base
    localizer = started(room, taught, max_position_sigma_m=0.08)

    answers = []
    for k in range(30):
        frame = omni.frame(room.render(on_way @ MOUNTING), k / 15)
        belief = Belief(k / 15, pose_odom_base=Pose2(0.0, 0.2 * (k % 2), 0.0), motion_age_s=0.0)
        answers += localizer.observe(frame, belief)

    assert isinstance(answers[0], Fix)
    assert answers[-1].reason.endswith("and 0.08 m are asked")


def test_an_unexpected_place_is_told_when_two_pictures_agree(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught, confirm_pictures=2)
    drive = [Pose2(-1.0 + 0.1 * k, 0.0, 0.2 * k) for k in range(4)]

    first, *others = (look(localizer, omni, room, pose, k / 15) for k, pose in enumerate(drive))

    assert isinstance(first, Lost)
    assert "looking again to make sure" in first.reason
    assert all(isinstance(answer, Fix) for answer in others)


def test_two_pictures_that_contradict_each_other_are_not_believed(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught, confirm_pictures=2)
    images = [room.render(Pose2(x, 0.2, 0.5) @ MOUNTING) for x in (-0.9, 0.9, -0.9, 0.9)]

    answers = [
        localizer.observe(omni.frame(image, float(k)), Belief(float(k), pose_odom_base=Pose2()))[0]
        for k, image in enumerate(images)
    ]

    assert all(isinstance(answer, Lost) for answer in answers)


def test_someone_in_the_way_costs_landmarks_but_not_the_pose(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught)
    look(localizer, omni, room, Pose2())

    answers = [look(localizer, omni, room, Pose2(0.02 * k, 0.0, 0.0), k / 15, blank=(0.0, 1.2)) for k in range(1, 6)]

    for k, answer in enumerate(answers, start=1):
        assert isinstance(answer, Fix)
        assert errors(answer, Pose2(0.02 * k, 0.0, 0.0))[0] < 0.2


def test_a_map_from_elsewhere_gives_lost_with_a_reason(omni: Any, taught: Any) -> None:
    elsewhere = omni.room(seed=77)
    localizer = started(elsewhere, taught)

    answers = [look(localizer, omni, elsewhere, Pose2(0.3 * k - 1.0, 0.2, 0.5 * k)) for k in range(6)]

    assert all(isinstance(answer, Lost) for answer in answers)
    assert all("landmarks" in answer.reason for answer in answers)


def test_a_stretched_picture_is_lost_not_wrong(omni: Any, room: Any, taught: Any) -> None:
    image = np.repeat(room.render(Pose2()), 2, axis=1)

    (answer,) = started(room, taught).observe(omni.frame(image, 0.0), Belief(0.0))

    assert isinstance(answer, Lost)
    assert "no image circle" in answer.reason


def test_a_mirror_turned_over_gives_no_wrong_fix(omni: Any, room: Any, taught: Any) -> None:
    other = omni.room(turns="clockwise")
    localizer = started(room, taught)  # still believes in counterclockwise

    answers = [look(localizer, omni, other, Pose2(0.2 * k, 0.1, 0.0)) for k in range(4)]

    assert all(isinstance(answer, Lost) for answer in answers)


def test_nothing_taught_is_said(omni: Any, room: Any) -> None:
    answer = look(started(room, omni.localizer_map()), omni, room, Pose2())

    assert answer == Lost(0.0, "no landmarks: nothing was taught here, or nothing could be measured")


def test_other_features_than_taught_are_refused(room: Any, taught: Any) -> None:
    with pytest.raises(ConfigError, match="taught with features: surf, but the config says sift"):
        started(room, taught, features="sift")


def test_descriptors_of_another_square_than_taught_are_refused(room: Any, taught: Any) -> None:
    with pytest.raises(ConfigError, match="taught with features: surf, but the config says surf compact"):
        started(room, taught, quality="compact")


def test_another_kind_of_camera_is_refused(room: Any, taught: Any) -> None:
    pinhole = SensorInfo("omni", "image", calibration=Pinhole(300, 300, 160, 120))

    with pytest.raises(ConfigError, match="takes an omnidirectional camera"):
        started(room, taught, sensor=pinhole)


def test_other_payloads_are_refused(room: Any, taught: Any) -> None:
    with pytest.raises(ShapeError, match="takes pictures"):
        started(room, taught).observe(Frame("omni", 0.0, Scalar(1.0)), Belief(0.0))


@pytest.mark.parametrize("selection", ["covariance", "all"])
def test_other_selections_work_without_the_machine(room: Any, taught: Any, selection: str) -> None:
    copied = type(taught)()
    for keyframe in taught.keyframes():
        copied.add(keyframe)

    started(room, copied, "teach", selection=selection).finish()

    assert copied.load("candidates")["is_chosen"].any()
    assert len(copied.load("landmarks")["positions"]) == copied.load("candidates")["is_chosen"].sum()


def test_finishing_without_keyframes_or_map_is_nothing(omni: Any, room: Any) -> None:
    localizer_map = omni.localizer_map()
    started(room, localizer_map, "teach").finish()
    started(room, None, "teach").finish()

    assert localizer_map.load("landmarks") is None


def test_a_damaged_store_says_so(omni: Any, room: Any) -> None:
    localizer_map = omni.localizer_map()
    localizer_map.add(Keyframe(0.0, 0.0, Pose2(), {"ids": np.array([1])}))

    with pytest.raises(StoreError, match="teach again"):
        started(room, localizer_map, "teach").finish()
    with pytest.raises(StoreError, match="has no array 'positions'"):
        LandmarkMap.from_arrays({})


def test_many_agreeing_are_no_chance_and_few_of_many_are() -> None:
    gate = math.radians(5)

    assert chance_agreements(8, 8, gate) < 1e-4
    assert chance_agreements(40, 5, gate) > 1.0
    assert chance_agreements(3, 3, gate) == pytest.approx(1.0)


def test_candidates_of_a_missing_store_are_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError):
        stored_candidates(tmp_path / "none.trail", "omni")


def test_tracking_is_refreshed_by_detection(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught, refresh_every=4)

    answers = [look(localizer, omni, room, Pose2(0.02 * k, 0.0, 0.0), k / 15) for k in range(10)]

    assert [answer.details["tracked"] for answer in answers] == [0, 1, 1, 1, 0, 1, 1, 1, 0, 1]
    assert localizer.counters()["sub_flow"] == 3


def test_what_is_tracked_and_recognised_no_more_is_soon_not_believed(
    omni: Any, room: Any, taught: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    localizer = started(room, taught, refresh_every=4)
    look(localizer, omni, room, Pose2(), 0.0)
    nothing = np.empty(0, dtype=np.intp)
    monkeypatch.setattr(LandmarkMap, "match", lambda *_: (nothing, nothing))

    answers = [look(localizer, omni, room, Pose2(0.02 * k, 0.0, 0.0), k / 15) for k in range(1, 12)]

    assert [isinstance(answer, Fix) for answer in answers] == [True] * 7 + [False] * 4
    assert answers[7].reason == "0 landmarks recognised, 10 are needed"


def test_errors_last_as_long_as_landmarks_are_seen_from_near_by(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught)

    first = look(localizer, omni, room, Pose2(), 0.0)
    moving = look(localizer, omni, room, Pose2(0.05, 0.0, 0.0), 0.1)
    resting = look(localizer, omni, room, Pose2(0.05, 0.0, 0.0), 0.2)

    assert first.correlation_s is None
    assert moving.correlation_s == pytest.approx(0.5)
    assert resting.correlation_s == pytest.approx(10.0)


def test_where_nothing_tells_of_motion_the_answers_tell_how_long_errors_last(omni: Any, room: Any, taught: Any) -> None:
    localizer = started(room, taught)

    for k in range(2):
        frame = omni.frame(room.render(Pose2(0.05 * k, 0.0, 0.0) @ MOUNTING), 0.1 * k)
        (answer,) = localizer.observe(frame, Belief(0.1 * k))

    assert answer.correlation_s == pytest.approx(0.5, rel=0.3)


def test_who_gives_up_what_was_tracked_starts_anew(
    omni: Any, room: Any, taught: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A place is detected, and not the one that was tracked: what is tracked from then on is recognised in its turn."""
    localizer = started(room, taught, refresh_every=4)
    look(localizer, omni, room, Pose2(), 0.0)
    monkeypatch.setattr(bearing_localizer, "_ENOUGH_SHARE", math.inf)
    monkeypatch.setattr(bearing_localizer, "_are_one", lambda *_: False)

    answers = [look(localizer, omni, room, Pose2(0.02 * k, 0.0, 0.0), k / 15) for k in range(1, 14)]

    assert [answer.details["tracked"] for answer in answers] == [1] * 7 + [0] + [1] * 5
