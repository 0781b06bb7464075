"""What all sources over files share."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
import pytest

from trailmark.config import SourceConfig
from trailmark.errors import SourceError
from trailmark.frames import Image, Payload, Scalar, SensorInfo
from trailmark.interfaces import Session
from trailmark.sources import Reading, Readings, RecordedSource


class Listed(RecordedSource):
    """Gives readings from a list."""

    def __init__(self, items: Iterable[Reading | SourceError], sensors: str = "a", on_bad_frame: str = "error"):
        super().__init__(SourceConfig.model_validate({"on_bad_frame": on_bad_frame}))
        self.items = list(items)
        self.names = sensors
        self.reorder_s = 1.0
        self.was_closed = False

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        return [SensorInfo(sensor, "scalar") for sensor in self.names]

    def readings(self) -> Readings:
        try:
            yield from self.items
        finally:
            self.was_closed = True


def reading(stamp_s: float, sensor: str = "a", load: Callable[[], Payload] | None = None) -> Reading:
    return Reading(sensor, stamp_s, f"file:{stamp_s}", load or partial(Scalar, stamp_s))


def picture(stamp_s: float, width: int = 4) -> Reading:
    return reading(stamp_s, load=lambda: Image(np.zeros((3, width), np.uint8)))


def unreadable() -> Payload:
    raise SourceError("file:2: unreadable")


def stamps(frames) -> list[float]:
    return [frame.stamp_s for frame in frames]


def test_a_repeated_stamp_is_dropped_and_counted(play):
    source = Listed([reading(1.0), reading(1.0), reading(2.0)])

    assert stamps(play(source)) == [1.0, 2.0]
    assert source.counters() == {"repeated": 1}


BAD = {
    "back": (
        [reading(2.0), reading(1.5)],
        r"file:1\.5: the stamp goes back: 1\.50+ s after 2\.0+ s of sensor 'a'",
    ),
    "unreadable": ([reading(2.0), reading(3.0, load=unreadable)], "file:2: unreadable"),
    "unstamped": ([reading(2.0), SourceError("file:9: no stamp")], "file:9: no stamp"),
    "not finite": ([reading(2.0), reading(float("nan"))], "file:nan: the stamp is not finite"),
    "size": ([picture(2.0), picture(3.0, width=5)], r"file:3\.0: a picture of 5x3 grey, 8 bit after pictures of 4x3"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_frame_ends_the_run_and_says_how_to_go_on(play, case):
    items, message = BAD[case]

    with pytest.raises(SourceError, match=f"{message}.*Set on_bad_frame: skip"):
        play(Listed(items))


@pytest.mark.parametrize("case", BAD)
def test_a_bad_frame_is_skipped_and_counted_if_the_config_says_so(play, caplog, case):
    items, _ = BAD[case]
    source = Listed([*items, items[0].__class__("a", 5.0, "file:5", items[0].load)], on_bad_frame="skip")

    with caplog.at_level(logging.WARNING):
        frames = play(source)

    assert stamps(frames) == [2.0, 5.0]
    assert source.counters() == {"skipped": 1}
    assert "skipped a bad frame" in caplog.text


def test_sensors_are_merged_by_stamp(play):
    source = Listed([reading(1.0), reading(2.0), reading(0.5, "b"), reading(1.5, "b")], sensors="ab")

    assert stamps(play(source)) == [0.5, 1.0, 1.5, 2.0]


def test_a_sensor_that_lags_more_than_the_window_is_an_error(play):
    items = [reading(float(i)) for i in range(5)] + [reading(0.5, "b")]

    with pytest.raises(SourceError, match=r"file:0\.5: the frame of sensor 'b' comes too late"):
        play(Listed(items, sensors="ab"))


def test_payloads_are_read_only_when_their_frame_is_asked_for():
    loaded = []
    items = [reading(float(i), load=lambda i=i: loaded.append(i) or Scalar(i)) for i in range(3)]
    source = Listed(items)
    source.start(Session())
    frames = source.frames()

    next(frames)

    assert loaded == [0]


def test_close_ends_the_frames_from_another_thread_and_closes_the_file():
    source = Listed(reading(float(i)) for i in range(100))
    source.start(Session())
    frames = source.frames()
    next(frames)

    closer = threading.Thread(target=source.close)
    closer.start()
    closer.join()

    assert list(frames) == []
    assert source.was_closed
    source.close()


def test_before_start_and_after_close_there_are_no_frames():
    source = Listed([reading(1.0)])
    assert list(source.frames()) == []

    source.start(Session())
    source.close()

    assert list(source.frames()) == []


def test_started_again_a_source_is_as_new():
    source = Listed([reading(1.0), reading(1.0)])
    source.start(Session())
    old = source.frames()
    next(old)

    source.start(Session())

    assert list(old) == []
    assert stamps(source.frames()) == [1.0]
    assert source.counters() == {"repeated": 1}


def test_a_sensor_that_lags_too_much_is_skipped_if_the_config_says_so(play):
    items = [reading(float(i)) for i in range(5)] + [reading(0.5, "b"), reading(4.5, "b")]
    source = Listed(items, sensors="ab", on_bad_frame="skip")

    frames = play(source)

    assert stamps(frames) == [0.0, 1.0, 2.0, 3.0, 4.0, 4.5]
    assert source.counters() == {"skipped": 1}


def test_close_while_a_frame_is_looked_at_gives_none_after_it():
    source = Listed([reading(0.0), reading(0.5), reading(0.1, "b"), reading(0.6, "b")], sensors="ab")
    source.start(Session())
    frames = source.frames()
    next(frames)

    source.close()

    assert list(frames) == []
