"""Small pictures: where streams are blind, and to find the place on the path."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Lost, PathOffset
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark.patches import small_picture
from trailmark.paths import Path, Waypoint
from trailmark.testing import MemoryMap
from trailmark_divs.config import DivsConfig
from trailmark_divs.eye import Look
from trailmark_divs.glance import Glances
from trailmark_divs.keyframe_writer import KeyframeWriter
from trailmark_divs.localizer import Divs
from trailmark_divs.pictures import PictureShifts, peak_confidence, peak_sigmas, shift_sigma_columns
from trailmark_divs.places import PicturePlaces
from trailmark_divs.taught_stream import TaughtStream


def way(n: int, seed: int = 0) -> list[np.ndarray]:
    """Return small pictures of places that have nothing to do with one another."""
    rng = np.random.default_rng(seed)
    return [
        small_picture(np.kron(rng.integers(20, 200, (6, 20)), np.ones((20, 20))).astype(np.uint8)) for _ in range(n)
    ]


@pytest.fixture(scope="module")
def recording(picture_stream):
    """Return what makes a taught stream of small pictures, one after the other."""

    def stream_of(pictures: list[np.ndarray], step_m: float = 0.1) -> TaughtStream:
        n = len(pictures)
        return picture_stream(pictures, np.stack([np.arange(n) - 1.0, np.arange(n)], axis=1) * step_m)

    return stream_of


def test_without_pictures_nothing_more_is_taught(taught):
    found = TaughtStream.from_keyframes(taught[0].keyframes())

    assert len(found.pictures) == len(found.picture_rows) == 0
    assert len(found) == 400


def test_a_small_picture_is_kept_every_so_often():
    localizer_map = MemoryMap()
    writer, pictures = KeyframeWriter(localizer_map, picture_spacing_m=0.1), way(40)

    for k, small in enumerate(pictures):
        stamps_s, way_m = (0.1 * k, 0.1 * (k + 1)), (0.05 * k, 0.05 * (k + 1))
        writer.add(Look(k, 0, np.ones(50, np.int64), np.ones(50), stamps_s, way_m, 0.0, small), Pose2())
    writer.flush()

    found = TaughtStream.from_keyframes(localizer_map.keyframes())
    np.testing.assert_array_equal(found.picture_rows, np.arange(0, 40, 2))
    np.testing.assert_allclose(found.pictures[3], pictures[6], atol=0.005)


def test_a_peak_that_stands_out_is_believed_and_noise_is_not():
    rng = np.random.default_rng(3)
    noise = [peak_sigmas(rng.normal(0.0, 0.1, 93)) for _ in range(200)]
    clear = rng.normal(0.0, 0.1, 93)
    clear[40] += 0.8

    assert np.mean([peak_confidence(sigmas) > 0.8 for sigmas in noise]) < 0.1
    assert peak_confidence(peak_sigmas(clear)) > 0.95


def test_the_place_is_found_while_driving(recording):
    pictures = way(60)
    places = PicturePlaces(recording(pictures), 0.1)
    rng = np.random.default_rng(1)

    for k in range(10):
        places.update(pictures[30 + k] + rng.normal(0.0, 0.3, (44, 115)).astype(np.float32), 0.1 * k, 1)

    match = places.match(0.8)
    assert match is not None
    assert match.row == 39


def test_the_place_is_not_told_of_pictures_of_elsewhere(recording):
    places = PicturePlaces(recording(way(60)), 0.1)

    for k, picture in enumerate(way(10, seed=9)):
        places.update(picture, 0.1 * k, 1)

    assert places.match(0.8) is None


def test_a_robot_that_stands_learns_nothing_new(recording):
    pictures = way(20)
    places = PicturePlaces(recording(pictures), 0.1)

    for _ in range(50):
        places.update(pictures[5], 1.0, 1)

    assert places.match(0.8) is None


def test_without_motion_a_replay_is_refused_with_the_remedy(taught, replaying, corridor):
    localizer = Divs(DivsConfig(camera="front"))
    localizer.start(replaying)
    picture = corridor.picture(Pose2(), np.random.default_rng(0))

    localizer.observe(Frame("front", 0.0, Image(picture)), Belief(0.0, Pose2()))
    with pytest.raises(ConfigError, match="no localizer has given any motion: add 'odometry'"):
        localizer.observe(Frame("front", 5.1, Image(picture)), Belief(5.1, Pose2()))


def test_a_robot_that_stands_with_wheels_is_waited_for(taught, replaying, corridor):
    localizer = Divs(DivsConfig(camera="front"))
    localizer.start(replaying)
    picture = corridor.picture(Pose2(), np.random.default_rng(0))

    for k in range(0, 200, 50):
        belief = Belief(0.05 * k, Pose2(), twist=Twist2(), motion_age_s=0.05)
        assert isinstance(localizer.observe(Frame("front", 0.05 * k, Image(picture)), belief), tuple)


def look(small: np.ndarray) -> Look:
    return Look(0, 0, np.ones(50, np.int64), np.ones(50), (0.0, 0.1), (0.0, 0.1), 0.0, small)


def turned(small: np.ndarray, right_px: int) -> np.ndarray:
    return np.roll(small, right_px, axis=1)


def shifts_of(taught: TaughtStream) -> PictureShifts:
    glances = Glances(taught, "distance", np.ones(50, np.bool_), 5, 20)
    return PictureShifts(
        taught, glances, columns_per_width=50.0, radians_per_column=math.radians(1.0), max_shift_columns=20
    )


def at_station(station_m: float) -> Belief:
    return Belief(0.1, Pose2(), on_path=PathOffset(0.1, station_m, 0.0, 0.0, np.zeros((3, 3))))


def test_a_picture_is_compared_with_what_was_taught_at_its_place(recording):
    pictures = way(12)

    found = shifts_of(recording(pictures)).at_present(look(turned(pictures[4], 23)), 0.0, at_station(0.4))

    assert found is not None
    assert found.shift.columns == pytest.approx(10.0, abs=0.5)  # 23 px of 115
    assert found.shift.confidence > 0.95


def test_between_two_headings_the_shift_is_to_the_heading_between(recording):
    first = way(1)[0]
    taught = recording([first, turned(first, 23)], step_m=1.0)
    taught = replace(taught, headings_rad=np.radians([0.0, 10.0]))

    found = shifts_of(taught).at_present(look(turned(first, 14)), 0.0, at_station(0.5))

    assert found is not None
    assert found.shift.columns == pytest.approx(14 / 2.3 - 5.0, abs=0.3)


def test_a_turn_between_two_pictures_that_nothing_measured_is_seen(recording):
    first = way(1)[0]

    found = shifts_of(recording([first, turned(first, 6)], step_m=1.0)).at_present(look(first), 0.0, at_station(0.5))

    assert found is not None
    assert found.shift.columns == pytest.approx(-3 / 2.3, abs=0.2)


def test_a_lower_peak_is_told_with_a_larger_sigma():
    assert shift_sigma_columns(0.9) == pytest.approx(0.1)
    assert shift_sigma_columns(0.25) > 4 * shift_sigma_columns(0.6) > 0.0
    assert shift_sigma_columns(-0.2) == shift_sigma_columns(0.0)


WINDING = DivsConfig(camera="front", when_blind="pictures")


def winding(n: int) -> list[Pose2]:
    """Return a way that swings by 25 deg every 2 m, in steps of 1.5 cm."""
    headings = 0.45 * np.sin(2.0 * math.pi * 0.015 * np.arange(n) / 2.0)
    xy = np.cumsum(0.015 * np.stack([np.cos(headings), np.sin(headings)], axis=1), axis=0)
    return [Pose2(x, y, t) for (x, y), t in zip(xy.tolist(), headings.tolist(), strict=True)]


def drive_winding(localizer, corridor, session, *, first=0, turned_rad=0.0, is_placed=True, seed=0):
    """Drive the winding way with a camera that looks aside, exact odometry and the place on the path, if any."""
    localizer.start(session)
    rng, poses = np.random.default_rng(seed), winding(240)
    answers = []
    for k in range(first, len(poses)):
        stamp_s, station_m = 0.05 * (k - first), 0.015 * k
        on_path = PathOffset(stamp_s, station_m, 0.0, 0.0, np.zeros((3, 3))) if is_placed else None
        belief = Belief(
            stamp_s,
            poses[k] if is_placed else None,
            pose_odom_base=poses[first].between(poses[k]),
            twist=Twist2(0.3),
            travelled_m=0.015 * (k - first),
            on_path=on_path,
            motion_age_s=0.0,
        )
        picture = Image(corridor.picture(poses[k] @ Pose2(0.0, 0.0, turned_rad), rng, noise=4.0))
        answers += [(k, answer) for answer in localizer.observe(Frame("front", stamp_s, picture), belief)]
    return answers


@pytest.fixture(scope="module")
def winding_session(corridor):
    sensors, localizer_map, localizer = {"front": corridor.sensor()}, MemoryMap(), Divs(WINDING)
    drive_winding(localizer, corridor, Session(name="divs", mode="teach", sensors=sensors, map=localizer_map), seed=5)
    localizer.finish()
    path = Path([Waypoint(k, 0.015 * k, pose) for k, pose in enumerate(winding(240))])
    return Session(name="divs", mode="replay", sensors=sensors, map=localizer_map, path=path)


def test_on_a_winding_way_pictures_answer_where_streams_are_blind(corridor, winding_session):
    answers = drive_winding(Divs(WINDING), corridor, winding_session, turned_rad=math.radians(4.0))

    told = [answer for _, answer in answers if isinstance(answer, PathOffset)]
    shifts_deg = [answer.details["shift_deg"] for answer in told]

    assert len(told) >= 0.95 * len(answers)
    assert np.mean(shifts_deg) == pytest.approx(4.0, abs=0.4)
    assert np.mean(np.abs(np.array(shifts_deg) - 4.0) < 2.4) > 0.95  # two columns


@pytest.mark.parametrize("first", [20, 90])
def test_on_a_winding_way_an_unknown_start_is_found(corridor, winding_session, first):
    answers = drive_winding(Divs(WINDING), corridor, winding_session, first=first, is_placed=False)

    told = [(k, answer) for k, answer in answers if isinstance(answer, PathOffset)]

    k, answer = told[0]
    assert (k - first) * 0.05 < 3.0
    assert answer.station_m == pytest.approx(0.015 * k, abs=0.4)
    assert np.linalg.eigvalsh(answer.information).min() > 0.0  # a pose to begin with


def with_other_boards(corridor, share):
    """Return a corridor of the same plan: so much of its walls shows something else."""
    twin, other, rng = copy.copy(corridor), type(corridor)(seed=9), np.random.default_rng(3)
    hung = [np.kron(rng.random((3, t.shape[1] // 100 + 1)) < share, np.ones((100, 100))) for t in corridor.textures]
    walls = zip(hung, other.textures, corridor.textures, strict=True)
    twin.textures = [np.where(boards[:300, : own.shape[1]] > 0, new, own) for boards, new, own in walls]
    return twin


def test_streams_do_not_tell_a_place_that_its_pictures_do_not_fit(corridor, drive, monkeypatch):
    config = DivsConfig(camera="front", when_blind="pictures", correspondence="appearance")
    sensors, localizer_map = {"front": corridor.sensor()}, MemoryMap()
    teaching = Session(name="divs", mode="teach", sensors=sensors, map=localizer_map)
    drive(corridor, config, teaching, 200, seed=5)[0].finish()
    path = Path([Waypoint(k, 0.1 * k, Pose2(0.1 * k, 0.0, 0.0)) for k in range(31)])
    session = Session(name="divs", mode="replay", sensors=sensors, map=localizer_map, path=path)
    monkeypatch.setattr("trailmark_divs.replay.PicturePlaces.match", lambda *_: None)  # no picture stands out

    def told_in(scene):
        answers = drive(scene, config, session, 100, start_m=0.8, has_path=False, seed=2)[2]
        return [answer for (answer,) in filter(None, answers) if isinstance(answer, PathOffset)]

    assert told_in(corridor)
    assert not told_in(with_other_boards(corridor, 0.3))


def test_a_map_without_pictures_is_warned_of(replaying, caplog):
    Divs(WINDING).start(replaying)

    assert "teach it anew" in caplog.text


def test_a_place_that_was_not_taught_is_not_found(winding_session):
    localizer, rng = Divs(WINDING), np.random.default_rng(2)
    localizer.start(winding_session)

    for k in range(100):
        scene = np.kron(rng.integers(20, 200, (12, 16)), np.ones((10, 10))).astype(np.uint8)
        belief = Belief(0.05 * k, None, twist=Twist2(0.3), travelled_m=0.015 * k, motion_age_s=0.0)
        answers = localizer.observe(Frame("front", 0.05 * k, Image(scene)), belief)
        assert all(isinstance(answer, Lost) for answer in answers)
