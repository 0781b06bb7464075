"""One topic of the robot as frames of one sensor."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

from trailmark.clock import live_stamp_s
from trailmark.errors import SourceError
from trailmark.frames import Frame, Payload
from trailmark.sources import ros_messages
from trailmark.sources.rgbd_pairs import RgbdPairs, StampedMessage
from trailmark_ros2.dds import Network, Quality, Sample, Subscription
from trailmark_ros2.frame_names import FrameNames
from trailmark_ros2.message_types import deserialize
from trailmark_ros2.readings import Reader
from trailmark_ros2.silence import reason_of_silence
from trailmark_ros2.stamping import Stamper
from trailmark_ros2.writers import WriterChoice

__all__ = ["DepthPairing", "TopicFeed"]

logger = logging.getLogger(__name__)

#: How many messages of a topic may wait for the program.
DEPTH = 32

#: So many of one stamp in a row are no reading that is sent again.
_MANY_REPEATED = 10

#: A message of more bytes is not looked at.
MAX_BYTES = 1 << 26


class DepthPairing:
    """Brings the pictures of two topics together to readings of one sensor."""

    kind = "rgbd"
    restarts = 0

    @staticmethod
    def own_part(message: Any) -> Any:
        """Return the message: each is a picture."""
        return message

    def __init__(self, depth_topic: str, max_difference_s: float) -> None:
        self.pairs = RgbdPairs(max_difference_s)
        self._depth_topic = depth_topic

    def readings(self, message: Any, stamp_s: float, topic: str) -> Iterator[tuple[float, Payload]]:
        """Yield the pairs that are certain now, each with the stamp of its colour picture."""
        picture = StampedMessage(stamp_s, topic, message)
        for colour, depth in self.pairs.push(picture, topic == self._depth_topic):
            yield colour.stamp_s, ros_messages.rgbd(colour, depth)


class TopicFeed:
    """A subscription, and what becomes of its messages.

    Attributes
    ----------
    sensor : str
        Whose frames it gives.
    subscription : Subscription
        Of the topic.
    counts : Counter of str
        What was left out, and why.
    last_heard_s : float
        When the last message came, in monotonic time [s].
    back_by_s : float
        How far the stamp of the last message is behind the newest; 0: it is the newest [s].
    """

    def __init__(
        self,
        sensor: str,
        subscription: Subscription,
        reader: Reader | DepthPairing,
        stamper: Stamper,
        *,
        skips: bool,
    ) -> None:
        self.sensor, self.subscription = sensor, subscription
        self.reader, self.stamper = reader, stamper
        self.counts: Counter[str] = Counter()
        self.last_heard_s = time.monotonic()
        self.back_by_s = 0.0
        self._writers, self._names = WriterChoice(), FrameNames()
        self._skips = skips
        self._last_stamp_s, self._n_standing = float("-inf"), 0
        self._is_silent = False
        self._refusal = ""

    @property
    def topic(self) -> str:
        """The topic."""
        return self.subscription.topic

    @property
    def frame_id(self) -> str:
        """Frame of its messages; empty before the first, and where they say none."""
        return self._names.frame_id

    @property
    def child_frame_id(self) -> str:
        """Frame whose pose they tell, if they tell one."""
        return self._names.child_frame_id

    def take(self) -> Iterator[Frame]:
        """Yield frames of the messages that have come.

        Raises
        ------
        SourceError
            If one cannot be used and such are not to be skipped.
        """
        for sample in self.subscription.take():
            came_s = live_stamp_s()
            try:
                yield from self._frames(sample, came_s)
            except Exception as error:  # a message from the network may hold anything
                self._refuse(error)
            if self.stamper.begun_ahead_s:
                raise SourceError(
                    f"{self.topic}: the first stamp was {self.stamper.begun_ahead_s:.0f} s ahead of all after it, and"
                    " the run began with it; begin anew"
                )

    def _frames(self, sample: Sample, came_s: float) -> Iterator[Frame]:
        if len(sample.cdr) > MAX_BYTES:
            raise SourceError(f"{len(sample.cdr)} bytes are more than {MAX_BYTES}")
        message = self.reader.own_part(deserialize(sample.cdr, self.subscription.type_name))
        if message is None:
            return
        self._note_message()
        if not self._writers.counts(sample.writer, self.last_heard_s):
            self._leave_out_other_writer()
            return
        self._note_frames(message, sample.writer)
        stamp_s = self.stamper.stamp_s(message, came_s)
        if stamp_s is None:
            raise SourceError("the header's stamp is empty; set stamps: receive")
        for reading_s, payload in self._readings(message, stamp_s, sample.writer):
            if reading_s <= self._last_stamp_s:
                self._leave_out(reading_s)
                continue
            self._last_stamp_s, self.back_by_s, self._n_standing = reading_s, 0.0, 0
            self.counts["received"] += 1
            yield Frame(self.sensor, reading_s, payload)

    def _note_frames(self, message: Any, writer: int) -> None:
        before = self.frame_id, self.child_frame_id
        if self._names.note_message(message, writer):
            self.counts["frame_changes"] += 1
            logger.warning(
                "%s: messages are of the frames %s now, and were of %s; they are used from now on as those before",
                self.topic,
                (self.frame_id, self.child_frame_id),
                before,
            )

    def _leave_out(self, reading_s: float) -> None:
        """Count a reading that is not newer than the one before it; of those that went back, the first is said."""
        if reading_s == self._last_stamp_s:
            self.counts["repeated"] += 1
            self._n_standing += 1
            if self._n_standing == _MANY_REPEATED:
                logger.warning(
                    "%s: stamps stand still at %.3f s, and such messages are left out: is the simulation paused?",
                    self.topic,
                    reading_s,
                )
            return
        self.back_by_s = self._last_stamp_s - reading_s
        if not self.counts["went_back"]:
            logger.warning(
                "%s: stamps went back from %.3f s to %.3f s; such messages are left out until the stamps are beyond the"
                " first one again, others silently: did the robot's clock begin anew?",
                self.topic,
                self._last_stamp_s,
                reading_s,
            )
        self.counts["went_back"] += 1

    def _leave_out_other_writer(self) -> None:
        if not self._writers.is_contested:  # of a program that was started again, its last
            self.counts["late_writer"] += 1
            return
        if not self.counts["other_writer"]:
            logger.warning(
                "%s is sent by two programs at once; messages of the one that came later are left out, others silently:"
                " does an old one still run?",
                self.topic,
            )
        self.counts["other_writer"] += 1

    def _readings(self, message: Any, stamp_s: float, writer: int) -> Iterator[tuple[float, Payload]]:
        if isinstance(self.reader, DepthPairing):
            yield from self.reader.readings(message, stamp_s, self.topic)
            return
        n_restarts = self.reader.restarts
        sender = hash((writer, self.counts["frame_changes"]))  # who changes frames is another, of another origin
        payload = self.reader.payload(message, stamp_s, sender)
        if self.reader.restarts > n_restarts:
            logger.warning("%s began anew at another origin; it goes on from where the robot was", self.topic)
        if payload is not None:
            yield stamp_s, payload

    def _refuse(self, error: Exception) -> None:
        self._note_message()
        what = error if isinstance(error, SourceError) else f"{type(error).__name__}: {error}"
        self._refusal = str(what)
        message = f"{self.topic}: a message cannot be used: {what}"
        if not self._skips:
            raise SourceError(message) from error
        if not self.counts["skipped"]:
            logger.warning("%s; others like it are skipped silently", message)
        self.counts["skipped"] += 1

    # --- silence ---------------------------------------------------------------------------------------------------

    def _note_message(self) -> None:
        now_s = time.monotonic()
        if self._is_silent:
            logger.warning("%s is back after %.1f s", self.topic, now_s - self.last_heard_s)
        self.last_heard_s, self._is_silent = now_s, False

    def check_silence(self, network: Network, silence_s: float) -> bool:
        """Warn of a silence, once; return whether the subscription was made anew to fit the writer that is there."""
        silent_s = time.monotonic() - self.last_heard_s
        if silent_s < silence_s:
            return False
        if not self._is_silent:
            self._is_silent = True
            self.counts["silences"] += 1
            logger.warning("%s is silent for %.0f s: %s", self.topic, silent_s, self.silence_reason(network))
        if not self.subscription.quality.is_reliable or self.subscription.refused_policy != "reliability":
            return False
        best_effort = Quality(is_reliable=False, depth=self.subscription.quality.depth)
        self.subscription = network.subscription(self.topic, self.subscription.type_name, best_effort)
        logger.warning("%s is asked for as best effort from now on", self.topic)
        return True

    def silence_reason(self, network: Network) -> str:
        """Return the likely reason why nothing comes, or nothing that can be used."""
        if self._refusal and not self.counts["received"]:
            return f"{self.counts['skipped']} messages came, and none could be used: {self._refusal}"
        others = [writer for writer in network.writers() if not network.is_own(writer)]
        subscription = self.subscription
        return reason_of_silence(self.topic, subscription.type_name, subscription.quality, others, network)

    def own_counts(self) -> dict[str, int]:
        """Return what was counted, with the offset of its stamps in milliseconds."""
        counts = {name: n for name, n in self.counts.items() if n}
        if self.stamper.offset_s == self.stamper.offset_s:  # it is known
            counts["offset_ms"] = round(1000 * self.stamper.offset_s)
        return counts | ({"restarts": self.reader.restarts} if self.reader.restarts else {})
