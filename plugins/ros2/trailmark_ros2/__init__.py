"""Live ROS 2 without ROS installed: a robot's topics as a source, beliefs as a sink.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_ros2.config import Ros2SinkConfig, Ros2SourceConfig
    from trailmark_ros2.sink import Ros2Sink
    from trailmark_ros2.source import Ros2Source

__all__ = ["Ros2Sink", "Ros2SinkConfig", "Ros2Source", "Ros2SourceConfig"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": (
            "Ros2SinkConfig",
            "Ros2SourceConfig",
        ),
        "sink": ("Ros2Sink",),
        "source": ("Ros2Source",),
    },
)
