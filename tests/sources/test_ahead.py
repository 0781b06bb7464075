"""Pictures that are loaded before their turn: the same frames, errors and counts as one after the other."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from trailmark.config import SourceConfig
from trailmark.errors import SourceError
from trailmark.frames import Image, Payload, Scalar, SensorInfo
from trailmark.interfaces import Session
from trailmark.sources import Reading, Readings, RecordedSource, ahead
from trailmark.sources.ahead import loaded_ahead


@pytest.fixture(params=[1, 2], ids=["one core", "two cores"])
def cores(request, monkeypatch) -> int:
    monkeypatch.setattr(ahead, "n_cores", lambda: request.param)
    return request.param


class Camera(RecordedSource):
    """A camera from a list of readings."""

    loads_ahead = True

    def __init__(self, items: Iterable[Reading | SourceError], on_bad_frame: str = "error") -> None:
        super().__init__(SourceConfig.model_validate({"on_bad_frame": on_bad_frame}))
        self.items = list(items)

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        return [SensorInfo("cam", "image")]

    def readings(self) -> Readings:
        yield from self.items


def picture(stamp_s: float) -> Reading:
    return Reading("cam", stamp_s, f"file:{stamp_s}", lambda: Image(np.full((2, 3), int(stamp_s), np.uint8)))


def torn(stamp_s: float) -> Reading:
    def load() -> Payload:
        raise SourceError(f"file:{stamp_s}: torn")

    return Reading("cam", stamp_s, f"file:{stamp_s}", load)


def stamps_until_error(source: RecordedSource) -> tuple[list[float], str]:
    source.start(Session(name="cam"))
    seen: list[float] = []
    try:
        seen.extend(frame.stamp_s for frame in source.frames())
    except SourceError as error:
        return seen, str(error)
    return seen, ""


def test_pictures_come_in_order_with_their_own_pixels(cores) -> None:
    source = Camera(picture(float(i)) for i in range(20))
    source.start(Session(name="cam"))

    assert [(frame.stamp_s, int(frame.payload.pixels[0, 0])) for frame in source.frames()] == [
        (float(i), i) for i in range(20)
    ]


def test_a_bad_picture_ends_the_run_behind_the_pictures_before_it(cores) -> None:
    seen, error = stamps_until_error(Camera([picture(0.0), picture(1.0), torn(2.0), picture(3.0)]))

    assert seen == [0.0, 1.0]
    assert error.startswith("file:2.0: torn")


def test_a_bad_line_ends_the_run_behind_the_pictures_before_it(cores) -> None:
    seen, error = stamps_until_error(Camera([picture(0.0), picture(1.0), SourceError("file:9: no stamp")]))

    assert seen == [0.0, 1.0]
    assert error.startswith("file:9: no stamp")


def test_bad_pictures_are_skipped_and_counted(cores) -> None:
    source = Camera([picture(0.0), torn(1.0), picture(2.0)], on_bad_frame="skip")

    assert stamps_until_error(source) == ([0.0, 2.0], "")
    assert source.counters()["skipped"] == 1


def test_other_readings_are_loaded_at_their_turn_by_the_thread_that_asks(cores) -> None:
    threads: list[threading.Thread] = []

    def load() -> Payload:
        threads.append(threading.current_thread())
        return Scalar(20.0)

    readings = [picture(0.0), Reading("warm", 0.5, "file", load), picture(1.0)]
    for n_given, reading in enumerate(loaded_ahead(readings, {"cam"})):
        assert len(threads) == (n_given > 1)
        reading.load()

    assert threads == [threading.current_thread()]


def test_with_a_second_core_the_next_picture_is_loaded_while_one_is_worked_on(monkeypatch) -> None:
    monkeypatch.setattr(ahead, "n_cores", lambda: 2)
    loaded = threading.Event()

    def load() -> Payload:
        loaded.set()
        return Scalar(0.0)

    readings = loaded_ahead([picture(0.0), Reading("cam", 1.0, "file", load)], {"cam"})
    next(readings)

    assert loaded.wait(10.0)  # nobody has asked for it


def test_only_a_few_are_taken_ahead(monkeypatch) -> None:
    monkeypatch.setattr(ahead, "n_cores", lambda: 2)
    n_taken = 0

    def endless() -> Iterator[Reading]:
        nonlocal n_taken
        while True:
            n_taken += 1
            yield picture(float(n_taken))

    readings = loaded_ahead(endless(), {"cam"})
    for _ in range(10):
        next(readings)

    assert n_taken <= 13


def test_nothing_is_left_running(monkeypatch) -> None:
    monkeypatch.setattr(ahead, "n_cores", lambda: 2)
    source = Camera(picture(float(i)) for i in range(9))
    source.start(Session(name="cam"))
    frames = source.frames()
    next(frames)
    assert "pictures ahead" in {thread.name for thread in threading.enumerate()}

    frames.close()

    assert "pictures ahead" not in {thread.name for thread in threading.enumerate()}
