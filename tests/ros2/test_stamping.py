"""Stamps of live messages."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from trailmark.errors import SourceError
from trailmark.frames import Scalar
from trailmark_ros2.stamping import Stamper


def message(stamp_s: float) -> SimpleNamespace:
    return SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=int(stamp_s), nanosec=0)))


def test_one_stamp_of_the_future_is_refused_and_those_after_it_are_not() -> None:
    stamper = Stamper("/odom", "header", 1.0)
    for k in range(1, 11):
        stamper.stamp_s(message(k), float(k))

    with pytest.raises(SourceError, match=r"its stamp is 4000000000\.0 s ahead of those before it"):
        stamper.stamp_s(message(4_000_000_011), 11.0)

    assert stamper.stamp_s(message(12.0), 12.0) == 12.0


def test_one_stamp_that_is_seconds_ahead_costs_its_own_message_alone(feed) -> None:
    talker = feed([5.0, 5.1, 8.5, 5.3, 5.4])

    assert [frame.stamp_s for frame in talker.take()] == pytest.approx([5.0, 5.1, 5.3, 5.4])
    assert talker.counts == {"received": 4, "skipped": 1}


def test_where_arrivals_count_no_stamp_is_refused() -> None:
    stamper = Stamper("/odom", "receive", 1.0)
    for k in range(1, 11):
        stamper.stamp_s(message(k), float(k))

    assert stamper.stamp_s(message(4_000_000_011), 11.0) == 11.0


class Talker:
    """A subscription to a topic on which stamps come, one by one."""

    topic = "/odom"
    type_name = "odometry"

    def __init__(self, stamps: list[float], writers: list[int]) -> None:
        self._stamps, self._writers = stamps, writers

    def take(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(cdr=[stamp_s], writer=writer) for stamp_s, writer in zip(self._stamps, self._writers)]


@pytest.fixture
def feed(monkeypatch):
    """Makes a feed of stamps that come a tenth of a second one after another."""

    feeds = pytest.importorskip("trailmark_ros2.feeds", exc_type=ImportError)

    def make(stamps: list[float], writers: list[int] | None = None) -> Any:
        came_s = iter(0.1 * k for k in range(100))
        monkeypatch.setattr("trailmark_ros2.feeds.live_stamp_s", lambda: next(came_s))
        monkeypatch.setattr("trailmark_ros2.feeds.deserialize", lambda cdr, _: message_with_frame(cdr[0]))
        reader = SimpleNamespace(restarts=0, own_part=lambda message: message, payload=lambda *_: Scalar(0.0))
        talker = Talker(stamps, writers or [1] * len(stamps))
        return feeds.TopicFeed("wheels", talker, reader, Stamper("/odom", "header", 1e10), skips=True)

    return make


def message_with_frame(stamp_s: float) -> SimpleNamespace:
    stamp = SimpleNamespace(sec=int(stamp_s), nanosec=round(stamp_s % 1 * 1e9))
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id="odom"))


def test_a_late_message_of_a_program_that_was_started_again_is_left_out_silently(feed, caplog) -> None:
    talker = feed([5.0, 5.2, 5.3, 5.4, 5.5], writers=[1, 2, 1, 2, 2])

    assert [frame.stamp_s for frame in talker.take()] == pytest.approx([5.0, 5.2, 5.4, 5.5])
    assert talker.counts["late_writer"] == 1
    assert caplog.text == ""


def test_stamps_that_go_back_are_said_once(feed, caplog) -> None:
    talker = feed([5.0, 5.1, 1.0, 1.1, 5.2])

    assert [frame.stamp_s for frame in talker.take()] == pytest.approx([5.0, 5.1, 5.2])
    assert talker.counts["went_back"] == 2
    assert caplog.text.count("/odom: stamps went back from 5.100 s to 1.000 s") == 1
    assert caplog.text.count("went back") == 1


def test_a_first_stamp_of_the_future_ends_the_run(feed) -> None:
    with pytest.raises(SourceError, match="/odom: the first stamp was 4000000000 s ahead of all after it"):
        list(feed([4e9, 0.1, 0.2, 0.3, 0.4]).take())


@pytest.mark.parametrize("ahead_s", [3.4, 8.0])
def test_a_first_stamp_that_is_seconds_ahead_ends_the_run_with_its_reason(feed, ahead_s: float) -> None:
    with pytest.raises(SourceError, match=f"/odom: the first stamp was {ahead_s:.0f} s ahead of all after it"):
        list(feed([5.0 + ahead_s, 5.1, 5.2, 5.3, 5.4, 5.5, 5.6, 5.7]).take())


@pytest.mark.parametrize("rate", [3.0, 4.0])
def test_of_a_replay_that_is_faster_two_messages_are_lost(rate: float) -> None:
    stamper, refused = Stamper("/odom", "header", 1e10), 0
    for k in range(1, 61):
        try:
            stamper.stamp_s(message_with_frame(rate * k), 1.0 * k)
        except SourceError:
            refused += 1

    assert refused == (2 if rate - 1.0 > 2.0 else 0)


def test_a_clock_that_stands_still_is_said(feed, caplog) -> None:
    talker = feed([5.0, 5.1, *[5.2] * 40, 5.3])

    assert [frame.stamp_s for frame in talker.take()] == pytest.approx([5.0, 5.1, 5.2, 5.3])
    assert caplog.text.count("/odom: stamps stand still at 5.200 s, and such messages are left out") == 1
