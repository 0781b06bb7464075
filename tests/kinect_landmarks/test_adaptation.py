"""What the localizer does with the light and with the time that it has: the pictures that its finders get."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.estimates import Fix
from trailmark_kinect_landmarks import eye as eye_module
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.effort import COSTS_MS, Effort
from trailmark_kinect_landmarks.finders import WorkingImage, find
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.localizer import KinectLandmarks

from .conftest import Drive, arc

FINDERS = ("blobs", "rectangles", "edges", "lines")


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[tuple[WorkingImage, tuple[str, ...]]]:
    """Return what the finders were shown, and which of them, picture by picture."""
    seen: list[tuple[WorkingImage, tuple[str, ...]]] = []

    def keep(view: WorkingImage, names: tuple[str, ...]) -> object:
        seen.append((view, tuple(names)))
        return find(view, names)

    monkeypatch.setattr(eye_module, "find", keep)
    return seen


def landmarks(**options: object) -> KinectLandmarks:
    return KinectLandmarks(KinectLandmarksConfig(camera="kinect", finders=FINDERS, **options))


def brightness(view: WorkingImage) -> float:
    return float(np.mean(view.whole))


@pytest.mark.parametrize("sensor", [None, "light"])
def test_a_darker_picture_is_brought_to_the_light_of_the_first(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]], sensor: str | None
) -> None:
    poses = arc(6)

    answers = drive(landmarks(adapt=False, light=sensor), poses, light=lambda i: 1.0 if i < 3 else 0.4)

    first, last = shown[0][0], shown[-1][0]
    assert brightness(last) == pytest.approx(brightness(first), rel=0.1)
    fix = answers[-1]
    assert isinstance(fix, Fix)
    assert fix.details["light"] == pytest.approx(0.4, abs=0.05)


def test_the_sensor_says_how_much_of_a_change_was_light(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]]
) -> None:
    """The pictures stay as bright while the sensor halves: the camera exposes by itself, and nothing is made up for."""
    poses, localizer = arc(6), landmarks(adapt=False, light="light")
    sensor_says = iter([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    take = localizer.observe

    def observe(frame: object, belief: object) -> object:
        if frame.sensor == "light":
            frame = type(frame)("light", frame.stamp_s, type(frame.payload)(next(sensor_says)))
        return take(frame, belief)

    localizer.observe = observe

    fix = drive(localizer, poses)[-1]

    assert isinstance(fix, Fix)
    assert fix.details["light"] == 0.5
    assert brightness(shown[-1][0]) == pytest.approx(brightness(shown[0][0]), rel=0.05)


def last_of(drive: Drive, latency_s: float, n: int = 12) -> Fix:
    slow: Callable[[], float] = lambda: latency_s  # noqa: E731
    fix = drive(landmarks(adapt=True, landmarks=8), arc(n), last_latency_s=slow)[-1]
    assert isinstance(fix, Fix)
    return fix


def test_a_picture_that_took_too_long_makes_the_next_one_smaller(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]]
) -> None:
    fix = last_of(drive, latency_s=0.2)  # six times what 30 Hz allows

    view, names = shown[-1]
    assert fix.details["scale"] == view.scale == 0.5
    assert view.grey.shape == (240, 320)
    assert fix.details["n_finders"] == len(names) < len(FINDERS)


def test_with_time_to_spare_the_whole_picture_is_looked_at(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]]
) -> None:
    fix = last_of(drive, latency_s=0.001)

    view, names = shown[-1]
    assert fix.details["scale"] == view.scale == 1.0
    assert view.grey.shape == (480, 640)
    assert fix.details["n_finders"] == len(names) > 1


@pytest.mark.parametrize(("refind", "share"), [("flow", 0.5), ("look", 1.0)])
def test_where_enough_are_followed_finders_look_at_every_second_picture(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]], refind: str, share: float
) -> None:
    n = 12

    fix = drive(landmarks(adapt=False, landmarks=12, refind=refind), arc(n))[-1]

    assert isinstance(fix, Fix)
    assert len(shown) == pytest.approx(share * n, abs=3)


def test_where_finders_rest_none_is_counted_and_none_is_charged(
    drive: Drive, shown: list[tuple[WorkingImage, tuple[str, ...]]]
) -> None:
    localizer = landmarks(adapt=False, landmarks=12)
    take, looks, modelled_ms = localizer.observe, list[bool](), list[float]()

    def observe(frame: object, belief: object) -> object:
        before = len(shown)
        answer = take(frame, belief)
        looks.append(len(shown) > before)
        modelled_ms.append(1e3 * localizer.latency_s())
        return answer

    localizer.observe = observe

    fixes = drive(localizer, arc(8))

    looks, modelled_ms = looks[1:], modelled_ms[1:]  # the first picture begins
    assert set(looks) == {True, False}
    assert [fix.details["n_finders"] for fix in fixes] == [len(FINDERS) if look else 0 for look in looks]
    finders_ms = sum(COSTS_MS[name] for name in FINDERS) * 0.3072
    least_ms = {look: min(ms for ms, did in zip(modelled_ms, looks) if did == look) for look in (True, False)}
    assert least_ms[True] - least_ms[False] == pytest.approx(finders_ms, abs=2.0)


@pytest.mark.parametrize(("working_s", "resting_s", "scale"), [(0.2, 0.001, 0.5), (0.001, 0.2, 1.0)])
def test_the_time_of_a_picture_at_which_finders_rest_plans_nothing(
    drive: Drive,
    shown: list[tuple[WorkingImage, tuple[str, ...]]],
    working_s: float,
    resting_s: float,
    scale: float,
) -> None:
    localizer, n_shown = landmarks(adapt=True, landmarks=12), 0

    def measured_s() -> float:
        nonlocal n_shown
        before, n_shown = n_shown, len(shown)
        return working_s if n_shown > before else resting_s

    drive(localizer, arc(12), last_latency_s=measured_s)

    assert 4 <= len(shown) < 12
    assert {view.scale for view, _ in shown[1:]} == {scale}


def test_a_reading_of_the_light_does_not_hide_how_long_the_picture_took() -> None:
    effort = Effort(KinectLandmarksConfig(camera="kinect", finders=FINDERS), 30.0)
    picture = SimpleNamespace(light=1.0, grey=np.zeros((480, 640), np.uint8))
    effort.note_picture(picture, SearchPlan(FINDERS, 1.0, True), 60, 60)

    effort.note_time(0.2)  # asked when the light comes
    effort.note_time(1e-5)  # asked when the next picture comes: so long the light took

    assert effort.plan().scale == 0.5
