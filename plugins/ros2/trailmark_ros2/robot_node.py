"""A source as a robot of ROS 2, to try programs against: what it senses is sent, and it is driven by a topic."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

from trailmark.clock import live_stamp_s
from trailmark.commands import Stop
from trailmark.frames import Frame
from trailmark.interfaces import Drivable, FrameSource
from trailmark_ros2 import dds
from trailmark_ros2.driving import COMMAND_TYPES
from trailmark_ros2.message_types import deserialize
from trailmark_ros2.robot_messages import TOPIC_ENDS, TOPIC_TYPES, reading_message, velocity_of_twist

__all__ = ["RobotNode"]

#: How many messages wait for a reader that is slow.
_DEPTH = 32
#: How often a robot that stands and waits sends its readings [s].
_STANDING_S = 0.2
#: As late as this a reading is sent with the stamp that it should have had; beyond, time goes more slowly [s].
_LATE_S = 0.1
#: A robot that has no command for so long stands, as robots do [s].
_SILENT_S = 0.5


class RobotNode:
    """Sends the frames of a source as topics, at the pace of their stamps, and drives it by Twists.

    Stamps are of now. A source that is slower than its own stamps, such as a simulator on a busy machine, makes a robot
    that drives more slowly than it is told; what was lost is not caught up with.

    Parameters
    ----------
    network : dds.Network
        Where to send.
    source : FrameSource
        Has been started; one that can be driven takes commands.
    command : str
        Topic of Twists.
    pace : float
        Seconds of the source that pass in one second.
    """

    def __init__(self, network: dds.Network, source: FrameSource, *, command: str, pace: float = 1.0) -> None:
        self._source, self._pace = source, pace
        kinds = {name: source.sensors[name].kind for name in self.topics}
        self._publishers = {
            name: network.publisher(topic, TOPIC_TYPES[kinds[name]], dds.Quality(depth=_DEPTH))
            for name, topic in self.topics.items()
        }
        self._commands: dds.Subscription | None = None
        if isinstance(source, Drivable) and not source.drives_itself:
            self._commands = network.subscription(command, COMMAND_TYPES["twist"], dds.Quality(depth=_DEPTH))
        self._commanded_s: float | None = None

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each sensor that can be sent: ``/floor/image_raw``."""
        kinds = {name: info.kind for name, info in self._source.sensors.items()}
        return {name: f"/{name}/{TOPIC_ENDS[kind]}" for name, kind in kinds.items() if kind in TOPIC_ENDS}

    def run(self, wait_s: float = 60.0, stand_s: float = 1.0) -> bool:
        """Send until the source ends; False: nobody came to read.

        Parameters
        ----------
        wait_s : float
            How long to wait for a reader of every topic, standing [s].
        stand_s : float
            How long to stand on then: who starts up learns from the first readings what there is [s].
        """
        frames = iter(self._source.frames())
        first = self._first_frames(frames)
        if not self._stand(first, wait_s, stand_s):
            return False
        begin_s = last_s = min((frame.stamp_s for frame in first), default=0.0)
        origin_s = live_stamp_s()
        for frame in frames:
            due_s = origin_s + (frame.stamp_s - begin_s) / self._pace
            late_s = live_stamp_s() - due_s
            if late_s < 0.0:
                time.sleep(-late_s)
            elif late_s > _LATE_S and frame.stamp_s > last_s:  # readings of one instant bear one stamp
                origin_s += late_s - _LATE_S
                due_s += late_s - _LATE_S
            last_s = frame.stamp_s
            self._send(frame, due_s)
            self._take_command(frame.stamp_s)
        return True

    def _first_frames(self, frames: Iterator[Frame]) -> list[Frame]:
        """Return frames until every sensor that is sent has one."""
        found: list[Frame] = []
        while {frame.sensor for frame in found} < set(self._publishers):
            frame = next(frames, None)
            if frame is None:
                break
            found.append(frame)
        return found

    def _stand(self, first: list[Frame], wait_s: float, stand_s: float) -> bool:
        """Send the first readings again and again; return whether every topic has got a reader."""
        until_s = time.monotonic() + wait_s
        met_s: float | None = None
        while met_s is None or time.monotonic() < met_s + stand_s:
            now_s = time.monotonic()
            if met_s is None and all(publisher.n_matched for publisher in self._publishers.values()):
                met_s = now_s
            if met_s is None and now_s > until_s:
                return False
            for frame in first:
                self._send(frame, live_stamp_s())
            time.sleep(_STANDING_S)
        return True

    def _send(self, frame: Frame, stamp_s: float) -> None:
        publisher = self._publishers.get(frame.sensor)
        message = None if publisher is None else reading_message(frame.payload, stamp_s, frame.sensor)
        if publisher is not None and message is not None:
            publisher.send(message)

    def _take_command(self, now_s: float) -> None:
        """Follow the newest command; stand when there has been none for a while."""
        if self._commands is None:
            return
        assert isinstance(self._source, Drivable)
        samples = self._commands.take()
        if samples:
            self._commanded_s = now_s
            self._source.drive(velocity_of_twist(deserialize(samples[-1].cdr, self._commands.type_name)))
        elif self._commanded_s is not None and now_s - self._commanded_s > _SILENT_S:
            self._commanded_s = None
            self._source.drive(Stop("no command"))
