"""Faults of a source: which sensors they befall, in which order, with which random numbers, and what they may do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ConfigError, RunError, SourceError
from trailmark.frames import Frame, Scalar, SensorInfo
from trailmark.geometry import Pose3
from trailmark.interfaces import Fault, Session
from trailmark.pipeline.lifecycle import part_rng
from trailmark.pipeline.sources.perturbing import Perturber

SENSORS = {name: SensorInfo(name, "scalar") for name in ("light", "sound")}


class Told(Fault):
    """Does what a function says; keeps how it was started and closed."""

    kinds = frozenset({"scalar"})

    def __init__(self, do: Callable[[Frame, np.random.Generator, float], Frame | None]) -> None:
        super().__init__(None)
        self._do = do
        self.is_closed = False

    def start(self, session: Session) -> None:
        self.session = session

    def close(self) -> None:
        self.is_closed = True

    def counters(self) -> Mapping[str, int]:
        return {"seen": 1}

    def believed(self, info: SensorInfo) -> SensorInfo:
        return replace(info, pose_base_sensor=Pose3(info.pose_base_sensor.x + 1.0))

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        return self._do(frame, rng, since_s)


def add(number: float) -> Callable[..., Frame]:
    return lambda frame, rng, since_s: Frame(frame.sensor, frame.stamp_s, Scalar(frame.payload.value + number))


def double(frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
    return Frame(frame.sensor, frame.stamp_s, Scalar(2.0 * frame.payload.value))


def draw(frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
    return Frame(frame.sensor, frame.stamp_s, Scalar(float(rng.random())))


def lose(frame: Frame, rng: np.random.Generator, since_s: float) -> None:
    return None


def delay(by_s: float) -> Callable[..., Frame]:
    return lambda frame, rng, since_s: Frame(frame.sensor, frame.stamp_s + by_s, frame.payload)


def readings(n: int = 4, sensors: tuple[str, ...] = ("light",), rate_hz: float = 10.0) -> list[Frame]:
    return [Frame(sensor, i / rate_hz, Scalar(1.0)) for i in range(n) for sensor in sensors]


def started(doing: Mapping[str, Callable[..., Frame | None]], wanted=None, seed=0, sensors=SENSORS) -> Perturber:
    made = {name: (lambda do=do: Told(do)) for name, do in doing.items()}
    perturber = Perturber("robot", made, wanted)
    perturber.start(Session("robot", rng=part_rng(seed, "source", "robot")), sensors)
    return perturber


def left(perturber: Perturber, frames: list[Frame]) -> list[tuple[str, float, float]]:
    return [(frame.sensor, frame.stamp_s, frame.payload.value) for frame in perturber.frames(iter(frames))]


def test_faults_are_applied_in_the_order_of_the_config() -> None:
    assert left(started({"add": add(3.0), "double": double}), readings(1)) == [("light", 0.0, 8.0)]
    assert left(started({"double": double, "add": add(3.0)}), readings(1)) == [("light", 0.0, 5.0)]


def test_a_fault_befalls_the_sensors_that_are_wanted_and_no_other() -> None:
    seen = left(started({"add": add(1.0)}, wanted=("sound",)), readings(1, ("light", "sound")))

    assert seen == [("light", 0.0, 1.0), ("sound", 0.0, 2.0)]


def test_each_sensor_has_a_fault_of_its_own() -> None:
    made: list[Told] = []

    def make() -> Told:
        made.append(Told(double))
        return made[-1]

    perturber = Perturber("robot", {"double": make}, None)
    perturber.start(Session("robot"), SENSORS)
    perturber.close()

    assert [tuple(fault.session.sensors) for fault in made] == [("light",), ("sound",)]
    assert [fault.session.name for fault in made] == ["double", "double"]
    assert all(fault.is_closed for fault in made)
    assert made[0].session.rng.random() != made[1].session.rng.random()


def test_a_fault_draws_the_same_whatever_stands_beside_it() -> None:
    frames = readings(5, ("light", "sound"))
    alone = [reading for reading in left(started({"draw": draw}), frames) if reading[0] == "light"]

    beside = left(started({"other": draw, "draw": draw}, wanted=("light",)), frames)

    assert [reading for reading in beside if reading[0] == "light"] == alone
    assert len({value for _, _, value in alone}) == 5


def test_the_seed_changes_what_is_drawn() -> None:
    first, again, other = (left(started({"draw": draw}, seed=seed), readings()) for seed in (1, 1, 2))

    assert first == again != other


def test_what_is_lost_reaches_no_later_fault() -> None:
    assert left(started({"lose": lose, "add": add(1.0)}, wanted=("light",)), readings(2, ("light", "sound"))) == [
        ("sound", 0.0, 1.0),
        ("sound", 0.1, 1.0),
    ]


def test_a_late_sensor_arrives_among_the_others_in_order() -> None:
    perturber = started({"delay": delay(0.025)}, wanted=("light",))
    frames = sorted(
        [*readings(5), *readings(50, ("sound",), rate_hz=100.0)], key=lambda frame: (frame.stamp_s, frame.sensor)
    )

    seen = left(perturber, frames)

    stamps = [stamp_s for _, stamp_s, _ in seen]
    assert stamps == sorted(stamps)
    np.testing.assert_allclose([s for name, s, _ in seen if name == "light"], np.arange(5) / 10 + 0.025)
    assert sum(name == "sound" for name, _, _ in seen) == 50


def test_time_counts_from_the_first_frame_that_can_be_worsened() -> None:
    since: list[float] = []

    def note(frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        since.append(since_s)
        return frame

    left(started({"note": note}), [Frame("light", 100.0, Scalar(0.0)), Frame("light", 100.5, Scalar(0.0))])

    assert since == [0.0, 0.5]


def test_counters_bear_the_name_of_the_fault() -> None:
    perturber = started({"add": add(1.0), "basic": double})

    assert perturber.counters() == {"perturb.add.seen": 2, "perturb.seen": 2}


def test_wrong_beliefs_add_up() -> None:
    perturber = started({"add": add(1.0), "double": double}, wanted=("light",))

    assert perturber.believed(SENSORS["light"]).pose_base_sensor.x == 2.0
    assert perturber.believed(SENSORS["sound"]) == SENSORS["sound"]


def test_a_sensor_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"sources.robot.perturb.sensors: the source has no sensor 'lihgt'; it has"):
        started({"add": add(1.0)}, wanted=("lihgt",))


def test_a_fault_that_can_befall_nothing_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"robot.perturb.add: befalls sensors of kind scalar, not laser \(scan\)"):
        started({"add": add(1.0)}, sensors={"laser": SensorInfo("laser", "scan")})


@pytest.mark.parametrize("do", [delay(-0.1), lambda frame, rng, since_s: Frame("sound", frame.stamp_s, frame.payload)])
def test_a_frame_of_another_sensor_or_an_earlier_time_is_refused(do) -> None:
    with pytest.raises(SourceError, match=r"fault 'wild' of source 'robot' made '\w+' at -?0\.\d+ s of 'light'"):
        left(started({"wild": do}), readings())


def test_a_fault_that_fails_is_named() -> None:
    def fail(frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        raise ZeroDivisionError("no light")

    with pytest.raises(SourceError, match="fault 'add' of source 'robot' failed in apply: ZeroDivisionError: no light"):
        left(started({"add": fail}), readings())


@pytest.mark.parametrize("answer", [None, ["density"], {"density"}, {"density": 3}, {3: "sensors of kind scan"}])
def test_a_wrong_answer_about_idle_options_is_the_fault_s(answer: Any) -> None:
    class Answers(Told):
        def idle_options(self, info: SensorInfo) -> Mapping[str, str]:
            return answer

    perturber = Perturber("robot", {"dust": lambda: Answers(double)}, None)
    with pytest.raises(RunError, match=r"fault 'dust' of source 'robot' failed in idle_options: TypeError: it"):
        perturber.start(Session(rng=part_rng(0, "source", "robot")), SENSORS)
