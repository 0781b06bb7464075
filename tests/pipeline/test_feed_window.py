"""Frames that are pushed by a program, of which one sensor lags behind another."""

from __future__ import annotations

import pytest

from trailmark.errors import SourceError
from trailmark.frames import Frame, Odometry, Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline

CONFIG = {"localizers": {"wheels": {"plugin": "odometry"}}, "estimator": {"plugin": "kalman"}}
SENSORS = [SensorInfo("wheels", "odometry"), SensorInfo("light", "scalar")]


def wheels(stamp_s: float) -> Frame:
    return Frame("wheels", stamp_s, Odometry(Pose2(stamp_s)))


def light(stamp_s: float) -> Frame:
    return Frame("light", stamp_s, Scalar(stamp_s))


def lagging(n: int, lag_s: float) -> list[Frame]:
    """Return frames of both sensors at 20 and 10 Hz in the order in which they come, the light late."""
    arrivals = [(0.05 * k, wheels(0.05 * k)) for k in range(n)]
    arrivals += [(0.1 * k + lag_s, light(0.1 * k)) for k in range(n // 2)]
    return [frame for _, frame in sorted(arrivals, key=lambda arrival: arrival[0])]


def test_a_sensor_that_lags_is_put_in_its_place() -> None:
    with Pipeline(CONFIG, sensors=SENSORS, reorder_s=0.5) as pipeline:
        steps = [pipeline.feed(frame) for frame in lagging(40, 0.22)]

    stamps = [step.stamp_s for step in steps if step is not None]
    assert stamps == sorted(stamps)
    assert pipeline.result.counters["frames"] == 60  # what waited at the end too
    assert "source.feed.late" not in pipeline.result.counters


def test_what_is_later_than_the_window_is_counted() -> None:
    with Pipeline(CONFIG, sensors=SENSORS, reorder_s=0.1) as pipeline:
        for frame in lagging(40, 0.32):
            pipeline.feed(frame)

    counters = pipeline.result.counters
    assert counters["source.feed.late"] > 10
    assert counters["frames"] + counters["source.feed.late"] == 60


def test_without_a_window_a_late_frame_is_refused() -> None:
    with Pipeline(CONFIG, sensors=SENSORS) as pipeline:
        pipeline.feed(wheels(1.0))

        with pytest.raises(SourceError, match="older than the source's frame before it"):
            pipeline.feed(light(0.9))
