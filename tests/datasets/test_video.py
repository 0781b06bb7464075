"""Films."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.interfaces import Session
from trailmark_datasets.config import VideoConfig
from trailmark_datasets.video import Video


def film(path: Path, n_frames: int = 5, rate_hz: float = 20.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), rate_hz, (64, 48))
    assert writer.isOpened()
    for i in range(n_frames):
        writer.write(np.full((48, 64, 3), 40 * i, np.uint8))
    writer.release()
    return path


def video(path: Path, **keys) -> Video:
    return Video(VideoConfig.model_validate({"path": path, **keys}))


def test_frames_come_in_order_with_the_times_of_the_file(tmp_path, play):
    source = video(film(tmp_path / "a.avi"))

    frames = play(source, "front")

    np.testing.assert_allclose([frame.stamp_s for frame in frames], [0.0, 0.05, 0.1, 0.15, 0.2])
    np.testing.assert_allclose([frame.payload.pixels.mean() for frame in frames], [0, 40, 80, 120, 160], atol=3)
    info = source.sensors["front"]
    assert (info.kind, info.size, info.rate_hz) == ("image", (64, 48), 20.0)
    assert source.counters()["announced_but_missing"] == 0
    assert source.lasts_s() == pytest.approx(0.25)


def test_a_rate_replaces_the_times_of_the_file(tmp_path, play):
    frames = play(video(film(tmp_path / "a.avi"), rate_hz=10))

    np.testing.assert_allclose([frame.stamp_s for frame in frames], [0.0, 0.1, 0.2, 0.3, 0.4])


def test_grey_is_made_on_request(tmp_path, play):
    assert play(video(film(tmp_path / "a.avi"), grey=True))[0].payload.pixels.shape == (48, 64)


def test_pictures_stay_as_they_are_when_the_next_is_read(tmp_path):
    source = video(film(tmp_path / "a.avi"))
    source.start(Session())
    frames = source.frames()

    first = next(frames)
    next(frames)

    assert first.payload.pixels.mean() == pytest.approx(0, abs=3)


@pytest.mark.parametrize("content", [b"this is no film", b""])
def test_a_file_without_frames_is_refused(tmp_path, content):
    path = tmp_path / "a.mp4"
    path.write_bytes(content)

    with pytest.raises(SourceError, match=r"a\.mp4: no frames: no film, or a codec that OpenCV does not know"):
        video(path).start(Session())


def test_a_film_that_was_cut_off_is_refused_with_a_remedy(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"\0\0\0\x18ftypisom" + bytes(12) + b"\0\1\0\0mdat" + bytes(2000))

    with pytest.raises(SourceError, match=r"a\.mp4: no frames: an MP4 without its index: .*`untrunc` may mend it"):
        video(path).start(Session())


class StoppedClock:
    """A capture whose container tells no times."""

    def __init__(self, path: str) -> None:
        self.left = 3

    def grab(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def retrieve(self):
        return self.left != 0, np.zeros((4, 4, 3), np.uint8)

    def get(self, property_: int) -> float:
        return 0.0

    def release(self) -> None:
        pass


def test_a_container_without_times_asks_for_a_rate(tmp_path, play, monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", StoppedClock)
    path = tmp_path / "a.avi"
    path.touch()

    with pytest.raises(SourceError, match=r"a\.avi frame 1: .*0\.0+ s after 0\.0+ s; set rate_hz"):
        play(video(path))

    with pytest.raises(SourceError, match=r"a\.avi frame 2: cannot be decoded"):
        play(video(path, rate_hz=10))
