"""Messages from bytes."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")

from trailmark_ros2.message_types import deserialize, serialize


def test_a_picture_is_not_copied(messages) -> None:
    pixels = np.random.default_rng(7).integers(0, 255, (480, 640), dtype=np.uint8)
    cdr = serialize(messages.image(pixels, "mono8"))

    message = deserialize(cdr, "sensor_msgs/msg/Image")

    assert np.shares_memory(message.data, np.frombuffer(cdr, np.uint8))
    np.testing.assert_array_equal(message.data.reshape(480, 640), pixels)
