"""A robot whose time went back."""

from __future__ import annotations

import time
from collections.abc import Sequence

from trailmark.errors import SourceError
from trailmark_ros2.feeds import TopicFeed

__all__ = ["refuse_a_reset"]

#: Stamps that go back farther are of another time, not of messages that were overtaken [s].
_RESET_S = 3.0


def refuse_a_reset(feeds: Sequence[TopicFeed], recent_s: float) -> None:
    """Raise if every topic that is heard went back in time: the robot is not where it was either.

    Parameters
    ----------
    feeds : sequence of TopicFeed
        All topics.
    recent_s : float
        A topic without a message for so long is not heard [s].

    Raises
    ------
    SourceError
        With the topics, and by how much.
    """
    now_s = time.monotonic()
    heard = [feed for feed in feeds if now_s - feed.last_heard_s < recent_s]
    if heard and all(feed.back_by_s > _RESET_S for feed in heard):
        raise SourceError(
            f"the stamps of {', '.join(feed.topic for feed in heard)} went back by {heard[0].back_by_s:.1f} s: was the"
            " simulation reset, or the robot's clock set? What is known is of the time before: begin the run anew"
        )
