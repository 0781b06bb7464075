from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ConfigError, StoreError
from trailmark.estimates import Belief, Lost, PathOffset
from trailmark.frames import Frame, Image, Scalar
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark.interfaces import Session
from trailmark_divs.config import DivsConfig
from trailmark_divs.localizer import Divs
from trailmark_divs.taught_stream import TaughtStream

AFTERNOON = {"gamma": 0.7, "noise": 4.0}


def spoken(answers):
    return [answer for (answer,) in filter(None, answers) if isinstance(answer, PathOffset)]


def lost(answers):
    return [answer for (answer,) in filter(None, answers) if isinstance(answer, Lost)]


def median(offsets, name):
    return float(np.median([offset.details[name] for offset in offsets]))


def test_teaching_says_nothing_and_remembers_a_look_every_step(taught):
    localizer_map, _ = taught

    stations_m = TaughtStream.from_keyframes(localizer_map.keyframes()).stations_m
    np.testing.assert_allclose(np.diff(stations_m[:, 1]), 0.015, atol=1e-9)
    assert len(stations_m) == 400
    assert localizer_map.load("summary")["turning_share"] == 0.0


def test_finishing_again_changes_nothing(taught, replaying):
    localizer_map, _ = taught
    localizer = Divs(DivsConfig(camera="front"))
    localizer.start(replaying)
    before = len(localizer_map.keyframes()), localizer_map.load("summary")

    localizer.finish()

    assert (len(localizer_map.keyframes()), localizer_map.load("summary")) == before


@pytest.mark.parametrize("shift", ["robust", "paper"])
def test_on_the_path_the_drift_is_zero(corridor, replaying, drive, shift):
    config = DivsConfig(camera="front", shift=shift, when_blind="silent")

    _, _, answers = drive(corridor, config, replaying, 200, **AFTERNOON)

    offsets = spoken(answers)
    assert len(offsets) >= 120
    assert np.abs([offset.details["shift_columns"] for offset in offsets]).max() < 0.6


@pytest.mark.parametrize(("heading_deg", "y_m"), [(5, 0.0), (-5, 0.0), (0, 0.3), (0, -0.3)])
def test_turned_or_offset_to_the_left_is_positive(corridor, replaying, drive, heading_deg, y_m):
    config = DivsConfig(camera="front")

    _, _, answers = drive(corridor, config, replaying, 200, y_m=y_m, heading_rad=math.radians(heading_deg), **AFTERNOON)

    offsets = spoken(answers)
    side = math.copysign(1, heading_deg or y_m)
    assert len(offsets) >= 100
    assert all(side * offset.heading_rad > 0 and side * offset.lateral_m > 0 for offset in offsets)


def test_a_turn_shifts_by_its_angle(corridor, replaying, drive):
    _, _, answers = drive(corridor, DivsConfig(camera="front"), replaying, 80, heading_rad=0.087, **AFTERNOON)

    offset = spoken(answers)[-1]
    seen_rad = math.radians(offset.details["shift_deg"])
    assert seen_rad == pytest.approx(0.087, abs=0.025)
    assert offset.heading_rad + offset.lateral_m / 6.0 == pytest.approx(seen_rad)
    assert offset.details["shift_px"] == pytest.approx(3 * offset.details["shift_columns"])


def test_an_offset_is_about_the_middle_of_its_window(corridor, replaying, drive):
    config = DivsConfig(camera="front", when_blind="silent")

    _, poses, answers = drive(corridor, config, replaying, 150)

    offset = spoken(answers)[-1]
    newest_s = 0.05 * 149
    assert offset.stamp_s == pytest.approx(newest_s - 12.5 * 0.05)
    assert offset.station_m == pytest.approx(poses[-1].x - 12.5 * 0.015, abs=0.008)


def test_its_information_has_rank_one(corridor, replaying, drive):
    _, _, answers = drive(corridor, DivsConfig(camera="front"), replaying, 100)

    assert np.linalg.matrix_rank(spoken(answers)[-1].information) == 1


def test_until_the_window_is_full_it_is_silent_or_compares_single_pictures(corridor, replaying, drive):
    silent, single = (DivsConfig(camera="front", when_blind=how) for how in ("silent", "single"))

    _, _, answers = drive(corridor, silent, replaying, 120, **AFTERNOON)
    _, _, glances = drive(corridor, single, replaying, 120, **AFTERNOON)

    assert answers[0] == ()
    assert [answer.reason for answer in lost(answers[:25])] == ["the window is not full yet"] * 24
    assert len(spoken(glances)) > len(spoken(answers))


def turning_on_the_spot(corridor, session, config, turned_rad=0.35):
    """Drive 1.5 m, turn, and go on beside the taught heading."""
    localizer, rng = Divs(config), np.random.default_rng(3)
    localizer.start(session)
    pose, way_m, answers = Pose2(), 0.0, []
    for k in range(200):
        turn_rad = turned_rad / 10 if 100 <= k < 110 else 0.0
        pose = pose @ Pose2(0.015, 0.0, turn_rad)
        way_m += 0.015
        on_path = PathOffset(0.05 * k, pose.x, 0.0, 0.0, np.zeros((3, 3)))
        belief = Belief(0.05 * k, pose, pose_odom_base=pose, travelled_m=way_m, on_path=on_path, motion_age_s=0.0)
        frame = Frame("front", 0.05 * k, Image(corridor.picture(pose, rng)))
        answers.append(localizer.observe(frame, belief))
    return localizer, answers


def test_it_is_blind_in_a_turn_and_until_a_new_window_is_full(corridor, replaying):
    localizer, answers = turning_on_the_spot(corridor, replaying, DivsConfig(camera="front", when_blind="silent"), 0.1)

    reasons = {k: answer[0].reason for k, answer in enumerate(answers) if answer and isinstance(answer[0], Lost)}
    blind = [k for k, reason in reasons.items() if reason == "turning"]
    assert blind[0] in (100, 101, 102)
    assert blind == list(range(blind[0], blind[-1] + 1))
    assert 110 + 24 <= blind[-1] <= 110 + 24 + 6
    assert localizer.counters()["turning"] >= 10


def test_in_a_turn_single_pictures_follow_the_heading(corridor, replaying):
    _, answers = turning_on_the_spot(corridor, replaying, DivsConfig(camera="front"), turned_rad=0.15)

    turning = spoken(answers[104:125])
    assert len(turning) >= 15
    assert math.radians(turning[-1].details["shift_deg"]) == pytest.approx(0.15, abs=0.04)


@pytest.mark.parametrize("correspondence", ["index", "time"])
def test_counting_and_timing_need_no_odometry(corridor, replaying, drive, correspondence):
    config = DivsConfig(camera="front", correspondence=correspondence, select="every")

    _, _, answers = drive(corridor, config, replaying, 150, y_m=0.2, has_path=False)

    assert len(spoken(answers)) >= 100
    assert median(spoken(answers), "shift_columns") > 0.5


def test_by_distance_an_unknown_place_is_lost(corridor, replaying, drive):
    _, _, answers = drive(corridor, DivsConfig(camera="front"), replaying, 60, has_path=False)

    assert not spoken(answers)
    assert "when_blind: pictures" in lost(answers)[-1].reason


def test_by_appearance_it_starts_anywhere_and_tells_a_whole_pose(corridor, replaying, drive):
    config = DivsConfig(camera="front", correspondence="appearance")

    _, poses, answers = drive(corridor, config, replaying, 150, start_m=2.0, has_path=False, **AFTERNOON)

    assert lost(answers)[30].reason == "searching the place on the path"
    offset = spoken(answers)[-1]
    assert offset.station_m == pytest.approx(poses[-1].x - 12.5 * 0.015, abs=0.05)
    assert np.linalg.matrix_rank(offset.information) == 3


def test_by_appearance_a_robot_that_was_carried_elsewhere_is_found_again(corridor, replaying):
    config = DivsConfig(camera="front", correspondence="appearance", when_blind="silent")
    localizer, rng = Divs(config), np.random.default_rng(2)
    localizer.start(replaying)
    poses, answers = [], []
    for k in range(260):
        moved = Pose2(0.015 * k)  # all that the wheels know of
        pose = Pose2(0.5 + (1.0 if k >= 120 else 0.0)) @ moved
        on_path = PathOffset(0.05 * k, 0.5 + moved.x, 0.0, 0.0, np.eye(3))
        believed = {"pose_odom_base": moved, "travelled_m": moved.x, "on_path": on_path, "motion_age_s": 0.0}
        belief = Belief(0.05 * k, Pose2(0.5) @ moved, twist=Twist2(0.3), **believed)
        frame = Frame("front", 0.05 * k, Image(corridor.picture(pose, rng, **AFTERNOON)))
        answers.append(localizer.observe(frame, belief))
        poses.append(pose)

    wrong_m = [abs(told[0].station_m - (pose.x - 0.19)) for pose, told in zip(poses, answers) if spoken([told])]
    assert wrong_m[0] < 0.1
    assert max(wrong_m[-20:]) < 0.1
    assert len(spoken(answers[-20:])) == 20


def test_by_appearance_a_known_pose_is_corrected_along_and_across(corridor, replaying, drive):
    config = DivsConfig(camera="front", correspondence="appearance")

    _, _, answers = drive(corridor, config, replaying, 150)

    assert np.linalg.matrix_rank(spoken(answers)[-1].information) == 2


def test_landmarks_correct_the_place_along_the_path(corridor, replaying, drive):
    config = DivsConfig(camera="front", correspondence="index", select="every", landmark_spacing_m=1.0)

    _, poses, answers = drive(corridor, config, replaying, 250, start_m=0.12, has_path=False)

    error_m = [
        offset.station_m - (pose.x - 12.5 * 0.015)
        for pose, answer in zip(poses, answers)
        for offset in spoken([answer])
    ]
    assert error_m[30] == pytest.approx(-0.12, abs=0.02)
    assert np.median(error_m[-150:]) == pytest.approx(0.0, abs=0.02)
    assert np.abs(error_m[-150:]).max() < 0.08


def test_the_gain_is_learned_while_turning_against_the_drift(corridor, replaying):
    config = DivsConfig(camera="front", gain="learned", field_of_view_deg=120.0, turn_limit_deg=90.0)
    localizer, rng = Divs(config), np.random.default_rng(3)
    localizer.start(replaying)
    pose, gains = Pose2(), []
    for k in range(330):
        pose = pose @ Pose2(0.015, 0.0, 0.004 * math.cos(k / 15))
        on_path = PathOffset(0.05 * k, pose.x, 0.0, 0.0, np.zeros((3, 3)))
        belief = Belief(0.05 * k, pose, pose_odom_base=pose, travelled_m=0.015 * k, on_path=on_path)
        answer = localizer.observe(Frame("front", 0.05 * k, Image(corridor.picture(pose, rng))), belief)
        gains += [
            (offset.heading_rad + offset.lateral_m / 6) / offset.details["shift_columns"]
            for offset in spoken([answer])
            if abs(offset.details["shift_columns"]) > 0.5
        ]

    true_gain = 3 / corridor.focal_px  # told 120 deg, the lens has 60
    assert gains[0] == pytest.approx(3 / (80 / math.tan(math.radians(60))), rel=0.01)
    assert gains[-1] == pytest.approx(true_gain, rel=0.25)


def test_the_change_image_can_be_asked_for(corridor, replaying, drive):
    localizer, _, _ = drive(corridor, DivsConfig(camera="front", keep_change_image=True), replaying, 40)

    image = localizer.change_image()
    assert image.shape == (60, 160)
    assert 0.0 <= image.min() < image.max() <= 1.0
    with pytest.raises(ConfigError, match="keep_change_image"):
        drive(corridor, DivsConfig(camera="front"), replaying, 2)[0].change_image()


def test_started_again_it_answers_the_same(corridor, replaying, drive):
    config = DivsConfig(camera="front")

    _, _, first = drive(corridor, config, replaying, 60, y_m=0.1)
    localizer, _, second = drive(corridor, config, replaying, 60, y_m=0.1)
    localizer.start(replaying)

    assert [str(answer) for answer in first] == [str(answer) for answer in second]
    assert localizer.counters() == {"looks": 0, "turning": 0, "lost": 0}


def test_frames_that_are_not_pictures_are_left_alone(replaying):
    localizer = Divs(DivsConfig(camera="front"))
    localizer.start(replaying)

    assert localizer.observe(Frame("front", 0.0, Scalar(1.0)), Belief(0.0)) == ()


def test_teaching_nothing_is_said_when_it_finishes(corridor, localizer_map, caplog):
    localizer = Divs(DivsConfig(camera="front"))
    localizer.start(Session(name="streams", mode="teach", sensors={"front": corridor.sensor()}, map=localizer_map))

    localizer.finish()

    assert "streams: no picture was taught" in caplog.text


def test_a_path_taught_in_turns_only_is_warned_of(corridor, localizer_map, caplog, drive):
    config = DivsConfig(camera="front", turn_source="images", turn_limit_deg=1e-3)
    session = Session(name="streams", mode="teach", sensors={"front": corridor.sensor()}, map=localizer_map)

    localizer, _, _ = drive(corridor, config, session, 60)
    localizer.finish()

    assert "streams: turning on" in caplog.text


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"path": None}, ConfigError, "needs a taught path"),
        ({"map": None}, ConfigError, "give the run --store"),
    ],
)
def test_what_it_cannot_do_without_is_asked_for(replaying, change, error, message):
    with pytest.raises(error, match=message):
        Divs(DivsConfig(camera="front")).start(replace(replaying, **change))


def test_a_path_taught_without_it_is_refused(replaying, localizer_map):
    with pytest.raises(StoreError, match="nothing of this path is remembered"):
        Divs(DivsConfig(camera="front")).start(replace(replaying, map=localizer_map))


def test_a_camera_that_looks_sideways_is_refused(corridor, replaying):
    sideways = replace(corridor.sensor(), pose_base_sensor=Pose3(yaw=math.pi / 2))

    with pytest.raises(ConfigError, match="looks sideways"):
        Divs(DivsConfig(camera="front")).start(replace(replaying, sensors={"front": sideways}))


def test_a_path_taught_with_other_columns_is_refused(corridor, replaying, drive):
    with pytest.raises(ConfigError, match="taught with columns 50, but the config says 40"):
        drive(corridor, DivsConfig(camera="front", columns=40), replaying, 3)


@pytest.mark.parametrize("how", [{}, {"correspondence": "appearance"}, {"landmark_spacing_m": 1.0}])
def test_a_path_shorter_than_a_window_has_nothing_to_compare_but_single_pictures(
    corridor, localizer_map, replaying, drive, how
):
    config = DivsConfig(camera="front", **how)
    session = replace(replaying, map=localizer_map)

    localizer, _, _ = drive(corridor, config, replace(session, mode="teach", path=None), 20)
    localizer.finish()
    _, _, answers = drive(corridor, config, session, 60)

    assert {answer.reason for answer in lost(answers[40:])} <= {
        "nothing was taught here",
        "searching the place on the path",
    }
    assert len(lost(answers[40:])) == 20


@pytest.mark.parametrize("threshold", ["p90", "otsu", "blur_otsu"])
@pytest.mark.parametrize("is_colour", [False, True])
def test_read_only_grey_and_colour_pictures_give_the_same_drift(
    corridor, localizer_map, replaying, threshold, is_colour
):
    config = DivsConfig(camera="front", threshold=threshold)
    shifts = []
    for mode, y_m in (("teach", 0.0), ("replay", 0.2)):
        localizer, rng = Divs(config), np.random.default_rng(3)
        localizer.start(replace(replaying, mode=mode, map=localizer_map))
        for k in range(80):
            pose = Pose2(0.015 * k, y_m, 0.0)
            grey = corridor.picture(pose, rng)
            payload = Image(np.repeat(grey[:, :, None], 3, axis=2) if is_colour else grey)
            on_path = PathOffset(0.05 * k, pose.x, 0.0, 0.0, np.zeros((3, 3)))
            belief = Belief(0.05 * k, pose, pose_odom_base=Pose2(pose.x), travelled_m=pose.x, on_path=on_path)
            answer = localizer.observe(Frame("front", 0.05 * k, payload), belief)
            shifts += [offset.details["shift_columns"] for offset in spoken([answer])]
        localizer.finish()

    assert 0.5 < np.median(shifts) < 3.0


def test_before_it_is_started_it_has_counted_nothing_and_closes():
    localizer = Divs(DivsConfig(camera="front"))

    assert localizer.counters() == {"looks": 0, "turning": 0, "lost": 0}
    with pytest.raises(ConfigError, match="no change image"):
        localizer.change_image()
    localizer.close()
