"""The simulator as a source that can be driven."""

from __future__ import annotations

import hashlib
import math
import re
from itertools import islice
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.frames import Frame, Image, Imu, Odometry, Scalar, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode, Session
from trailmark.paths import Path, Waypoint
from trailmark_sim.config import SimConfig
from trailmark_sim.source import SimSource

SMALL = {"camera": {"width": 96, "height": 64, "field_mm": [37.5, 25.0]}}


def source(mode: Mode = "teach", seed: int = 0, session: Session | None = None, **keys: Any) -> SimSource:
    given = {"options": SMALL, "sensors": ["wheels", "floor"]} | keys
    made = SimSource(SimConfig.model_validate(given))
    made.start(session or Session(name="robot", mode=mode, rng=np.random.default_rng(seed)))
    return made


def digest(frames: list[Frame]) -> str:
    total = hashlib.sha256()
    for frame in frames:
        total.update(f"{frame.sensor} {frame.stamp_s!r}".encode())
        payload = frame.payload
        total.update(payload.pixels.tobytes() if isinstance(payload, Image) else repr(payload).encode())
    return total.hexdigest()


def drive_with(made: SimSource, command: Command, duration_s: float) -> list[Frame]:
    frames = []
    for frame in made.frames():
        frames.append(frame)
        if frame.stamp_s >= duration_s:
            return frames
        made.drive(command)
    return frames


@pytest.mark.parametrize(
    ("scale", "told"),
    [(1.3, "1.3 would be +130 %; the factor 1.3 is written 0.3"), (1.0, "the factor 1 is written 0. 0.5 at most")],
)
@pytest.mark.parametrize("key", ["scale", "turn_scale"])
def test_an_error_of_the_wheels_that_is_a_factor_is_refused(key: str, scale: float, told: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(told)):
        SimConfig.model_validate({"vehicle": {"kind": "differential", "wheels": {key: scale}}})


def test_it_teaches_its_route_and_ends_there() -> None:
    made = source(speed_mps=0.5, rates_hz={"floor": 10})

    frames = list(made.frames())

    truth = made.ground_truth()
    assert made.drives_itself
    assert truth.length_m() == pytest.approx(10.0, abs=5e-3)
    assert truth[len(truth) - 1][1].distance_to(Pose2(10.0)) < 5e-3
    assert frames[-1].stamp_s == pytest.approx(10.0 / 0.5, abs=4.0)
    assert made.counters() == {"collisions": 0}


def test_frames_come_at_their_rates_in_the_order_of_stamps() -> None:
    made = source(sensors=["wheels", "imu", "light", "floor"], rates_hz={"floor": 35}, duration_s=1.0)

    frames = list(made.frames())

    assert [frame.stamp_s for frame in frames] == sorted(frame.stamp_s for frame in frames)
    stamps = {name: [frame.stamp_s for frame in frames if frame.sensor == name] for name in made.sensors}
    for name, rate_hz in (("wheels", 50), ("imu", 100), ("light", 10), ("floor", 35)):
        assert stamps[name] == [k / rate_hz for k in range(rate_hz)]
    assert [frame.sensor for frame in frames[:4]] == ["wheels", "imu", "light", "floor"]


def test_sensors_give_the_payloads_of_their_kinds() -> None:
    made = source(sensors=["wheels", "imu", "light", "floor"])

    kinds = {frame.sensor: type(frame.payload) for frame in islice(made.frames(), 4)}

    assert kinds == {"wheels": Odometry, "imu": Imu, "light": Scalar, "floor": Image}
    assert made.sensors["floor"].size == (96, 64)


def test_a_sensor_that_is_asked_for_by_name_keeps_it() -> None:
    made = source(sensors=["floor"])

    assert set(made.sensors) == {"floor"}
    assert next(iter(made.frames())).sensor == "floor"


def test_the_same_seed_gives_the_same_bytes_with_one_and_two_threads() -> None:
    first, again, other = (
        digest(list(source(seed=seed, threads=threads, duration_s=0.5).frames()))
        for seed, threads in ((3, 1), (3, 2), (4, 2))
    )

    assert first == again
    assert other != first


def test_started_again_it_is_as_new() -> None:
    session = Session(name="robot", mode="teach", rng=np.random.default_rng(5))
    made = source(session=session, duration_s=0.4)
    first = digest(list(made.frames()))

    made.start(session)

    assert digest(list(made.frames())) == first


def test_frames_asked_for_again_are_the_same() -> None:
    made = source(duration_s=0.4)

    assert digest(list(made.frames())) == digest(list(made.frames()))


def test_adding_a_sensor_changes_no_other_sensors_frames() -> None:
    few, many = (
        [frame for frame in source(sensors=sensors, duration_s=0.5).frames() if frame.sensor in ("wheels", "floor")]
        for sensors in (["wheels", "floor"], ["wheels", "imu", "light", "floor"])
    )

    assert digest(few) == digest(many)


def test_teaching_and_replay_see_the_same_floor_with_other_noise() -> None:
    quiet = SMALL["camera"] | {"read_noise": 0, "shot_noise": 0, "height_jitter": 0, "tilt_jitter_mrad": 0}
    first = [
        next(iter(source(mode, sensors=["floor"], options={"camera": camera}).frames())).payload
        for camera in (quiet, SMALL["camera"])
        for mode in ("teach", "replay")
    ]
    taught, again, noisy_taught, noisy_again = (payload.pixels for payload in first if isinstance(payload, Image))

    np.testing.assert_array_equal(taught, again)
    assert (noisy_taught != noisy_again).mean() > 0.3


def test_another_world_seed_is_another_floor_and_the_runs_seed_is_not() -> None:
    quiet = SMALL["camera"] | {"read_noise": 0, "shot_noise": 0, "height_jitter": 0, "tilt_jitter_mrad": 0}

    def look(**keys: Any) -> np.ndarray[Any, Any]:
        payload = source(sensors=["floor"], options={"camera": quiet}, **keys).look()
        assert isinstance(payload, Image)
        return payload.pixels

    np.testing.assert_array_equal(look(seed=1), look(seed=2))
    assert (look(world_seed=1) != look(world_seed=2)).mean() > 0.5


def test_a_command_holds_from_the_last_frame_to_the_next_command() -> None:
    made = source("replay", vehicle={"kind": "four_wheel_steering", "speed_lag_s": 0.0})

    drive_with(made, Steer4WS(0.0, 0.0, 0.2), 1.0)

    truth = made.ground_truth()
    assert not made.drives_itself
    np.testing.assert_allclose(truth.positions[:, 0], 0.2 * truth.stamps_s, atol=1e-9)


def test_without_commands_it_stands_until_its_patience_ends() -> None:
    made = source("replay", patience_s=0.5)

    frames = list(made.frames())

    assert frames[-1].stamp_s == pytest.approx(0.5, abs=0.02)
    assert made.ground_truth().length_m() == 0.0


def test_a_stop_that_is_done_ends_the_frames() -> None:
    made = source("replay")
    stamps = []

    for frame in made.frames():
        stamps.append(frame.stamp_s)
        made.drive(Stop("there", done=True) if frame.stamp_s >= 0.5 else Steer4WS(0.0, 0.0, 0.2))

    assert stamps[-1] == pytest.approx(0.5 + 0.15 * math.log(0.2 / 1e-4), abs=0.05)


def test_in_track_the_route_drives_until_a_stop() -> None:
    made = source("track")

    for frame in islice(made.frames(), 600):
        made.drive(Stop("enough") if frame.stamp_s > 3.0 else Steer4WS(0.0, 0.0, -0.5))

    assert made.drives_itself
    before, after = (made.ground_truth().at([stamp]).poses[0, 0] for stamp in (3.0, 4.5))
    assert before > 0.5
    assert after - before < 0.26 * 0.2


def test_in_track_commands_drive_when_the_config_says_so() -> None:
    made = source("track", driver="commands")

    drive_with(made, Steer4WS(0.0, 0.0, 0.2), 1.0)

    assert not made.drives_itself
    assert made.ground_truth().length_m() == pytest.approx(0.2 * (1.0 - 0.15), rel=0.02)


def test_in_teach_only_stop_is_obeyed() -> None:
    made = source("teach")
    frames = []

    for frame in made.frames():
        frames.append(frame)
        made.drive(Steer4WS(0.3, -0.3, -0.2) if frame.stamp_s < 2.0 else Stop("the run is over", done=True))

    truth = made.ground_truth()
    assert truth.poses[:, 2] == pytest.approx(0.0)
    assert truth.length_m() == pytest.approx(0.26 * (2.0 - 0.15) + 0.26 * 0.15, abs=0.01)


def test_a_command_of_another_vehicle_is_refused() -> None:
    with pytest.raises(ConfigError, match="takes Steer4WS, Stop, not Velocity"):
        source("replay").drive(Velocity(0.1))


def test_closed_from_outside_the_frames_end() -> None:
    made = source()
    frames = made.frames()
    next(frames)

    made.close()
    made.close()

    assert list(frames) == []


def test_closed_before_the_first_frame_there_is_none() -> None:
    made = source()

    made.close()

    assert list(made.frames()) == []


def test_before_the_start_it_can_be_asked_and_closed() -> None:
    made = SimSource(SimConfig())

    made.close()

    assert made.counters() == {"collisions": 0}
    assert len(made.ground_truth()) == 0


def test_a_speed_beyond_the_vehicles_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"speed_mps is 2, but the vehicle drives 0.5 m/s at most"):
        source(speed_mps=2.0)


def taught(scale: float = 1.01, bend: float = 0.001) -> Path:
    """Return a path of 10 m as a drifting odometer would have taught it."""
    stations = np.arange(0.0, 10.001, 0.05) * scale
    return Path([Waypoint(i, s, Pose2(s, bend * s * s, 2 * bend * s)) for i, s in enumerate(stations.tolist())])


@pytest.mark.parametrize(("index", "expected_x"), [(0, 0.0), (-1, 10.0), (100, 5.0)])
def test_in_replay_it_stands_where_the_run_believes_on_the_true_route(index: int, expected_x: float) -> None:
    path = taught()
    believed = path[range(len(path))[index]].pose_map_base

    made = source(session=Session(name="robot", mode="replay", path=path, start_pose=believed))

    first = next(iter(made.frames()))
    pose = made.ground_truth()[0][1]
    assert first.stamp_s == 0.0
    np.testing.assert_allclose(pose.array(), [expected_x, 0.0, 0.0], atol=2e-3)  # the drift of 0.1 m is not the robot's


def test_at_the_end_of_a_path_that_stops_before_the_route_does_it_stands_there() -> None:
    part = Path(waypoint for waypoint in taught() if waypoint.station_m <= 4.0)

    made = source(session=Session(name="robot", mode="replay", path=part, start_pose=part[-1].pose_map_base))

    next(iter(made.frames()))
    np.testing.assert_allclose(made.ground_truth()[0][1].array(), [part.length_m, 0.0, 0.0], atol=2e-3)


def test_it_is_put_down_beside_the_start_in_replay_alone() -> None:
    off = [0.0, 0.01, 2.0]

    poses = []
    for mode in ("teach", "replay"):
        made = source(mode, put_off=off)
        next(iter(made.frames()))
        poses.append(made.ground_truth()[0][1])

    assert poses[0] == Pose2()
    np.testing.assert_allclose(poses[1].array(), [0.0, 0.01, math.radians(2.0)], atol=1e-12)


def test_a_start_in_the_config_is_where_it_stands() -> None:
    made = source("replay", start=[1.0, 0.5, 90.0])

    next(iter(made.frames()))

    np.testing.assert_allclose(made.ground_truth()[0][1].array(), [1.0, 0.5, math.pi / 2])


def test_a_start_inside_something_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"at \(1.50 m, 0.20 m, 0.0 deg\) the vehicle stands in the left pole of gate 1"
    ):
        source(route="indoor", start=[1.5, 0.2, 0.0])


def test_a_random_start_is_free_and_anywhere() -> None:
    keys = {"world": "supermarket", "sensors": ["wheels"], "start": "random", "options": {}}

    starts = []
    for seed in range(100):
        made = source("replay", seed=seed, **keys)
        next(iter(made.frames()))
        starts.append(made.ground_truth()[0][1])

    assert {made.world.collides(pose) for pose in starts} == {None}
    x, y, headings = np.array([pose.array() for pose in starts]).T
    assert min(np.ptp(x), np.ptp(y)) > 7.5  # of 10 m
    assert np.histogram(headings, 4, (-math.pi, math.pi))[0].min() > 10
    again = source("replay", seed=7, **keys)
    next(iter(again.frames()))
    assert again.ground_truth()[0][1] == starts[7]


def test_where_nothing_is_free_a_random_start_is_refused() -> None:
    fat = {"kind": "holonomic", "width_m": 9.9}
    with pytest.raises(ConfigError, match="no free place found in world 'supermarket' for start: random"):
        source("replay", world="supermarket", sensors=["wheels"], start="random", options={}, vehicle=fat)


@pytest.mark.parametrize("n_people", [0, 8])
def test_it_drives_around_the_supermarket_among_people(n_people: int) -> None:
    rates = {"wheels": 10, "laser": 1}
    keys = {"world": "supermarket", "route": "round", "sensors": ["wheels", "laser"], "rates_hz": rates}

    made = source(**keys, options={"people": n_people})
    scans = [frame.payload for frame in made.frames() if isinstance(frame.payload, Scan)]

    truth = made.ground_truth()
    assert made.counters() == {"collisions": 0}
    assert truth.length_m() == pytest.approx(made.world.routes["round"].length_m, abs=0.05)
    assert len(scans) > 60
    assert min(float(np.nanmin(scan.ranges_m)) for scan in scans) > 0.1


def test_touching_a_pole_is_counted_once_and_ends_the_run_unless_it_is_only_counted() -> None:
    counted, ended = (
        source("replay", route="indoor", start=[0.5, 0.07, 0.0], **keys) for keys in ({"on_collision": "count"}, {})
    )
    for made in (counted, ended):
        drive_with(made, Steer4WS(0.0, 0.0, 0.4), 6.0)

    assert counted.counters() == ended.counters() == {"collisions": 1}
    assert counted.ground_truth().poses[-1, 0] > 2.2  # beyond the gate
    assert ended.ground_truth().poses[-1, 0] < 1.5


@pytest.mark.parametrize(
    ("keys", "story"),
    [
        ({"world": "ground_cours"}, r"no world named 'ground_cours' \(did you mean 'ground_course'\?\)"),
        ({"rates_hz": {"floor": -1}}, "the rate of 'floor' must be positive, not -1 Hz"),
        ({"rates_hz": {"floor": math.inf}}, "finite"),
        ({"speed_mps": 0}, "greater than 0"),
        ({"options": {"flor": "wood"}}, r"unknown key \(did you mean 'floor'\?\)"),
        ({"options": {"camera": {"widht": 3}}}, r"unknown key \(did you mean 'width'\?\)"),
        ({"options": {"in_replay": {"wett": 0.5}}}, r"unknown key \(did you mean 'wet'\?\)"),
        ({"options": {"texture": "nowhere.jpg"}}, "no such file or folder"),
        ({"options": {"texture": __file__, "floor": "wood"}}, "not both"),
        ({"vehicle": {"kind": "tank"}}, "four_wheel_steering"),
        ({"sensors": []}, "at least 1"),
    ],
)
def test_a_wrong_config_says_what_is_wrong(keys: dict[str, Any], story: str) -> None:
    with pytest.raises(ValidationError, match=story):
        SimConfig.model_validate(keys)


@pytest.mark.parametrize(
    ("keys", "story"),
    [
        ({"sensors": ["flor"]}, r"world 'ground_course' has no sensor named 'flor' \(did you mean 'floor'\?\)"),
        ({"route": "indor"}, r"has no route named 'indor' \(did you mean 'indoor'\?\)"),
    ],
)
def test_what_the_world_does_not_have_is_one_clear_line(keys: dict[str, Any], story: str) -> None:
    with pytest.raises(ConfigError, match=story):
        source(**keys)


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("ackermann", Velocity(0.3)),
        ("differential", Velocity(0.3)),
        ("skid_steer", Velocity(0.3)),
        ("holonomic", Velocity(0.3)),
        ("four_wheel_steering", Steer4WS(0.0, 0.0, 0.3)),
    ],
)
def test_every_kind_of_vehicle_can_be_put_into_a_world(kind: str, command: Command) -> None:
    made = source("replay", vehicle={"kind": kind})

    drive_with(made, command, 1.0)

    assert made.accepts == {type(command), Stop}
    assert 0.2 < made.ground_truth().poses[-1, 0] < 0.3
