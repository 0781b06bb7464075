"""Live cameras, with a device that does as the test says."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark.api import create
from trailmark.errors import SourceError
from trailmark.estimates import Belief, Lost, Motion
from trailmark.interfaces import Session
from trailmark.testing.ground import GroundCamera, MirroredFloor, ground_run, straight
from trailmark_datasets.camera import Camera
from trailmark_datasets.config import CameraConfig

PICTURE = np.zeros((4, 6, 3), np.uint8)


class Device:
    """Gives pictures from a list; None is a failure to grab, a string one to decode."""

    def __init__(self, pictures: Iterable[Any], is_there: bool = True, on_grab: Callable[[], None] | None = None):
        self.pictures = iter(pictures)
        self.is_there = is_there
        self.on_grab = on_grab
        self.released = 0
        self.asked: dict[int, float] = {}
        self.current: Any = None

    def isOpened(self) -> bool:
        return self.is_there

    def grab(self) -> bool:
        if self.on_grab is not None:
            self.on_grab()
        self.current = next(self.pictures, None)
        return self.current is not None

    def retrieve(self) -> tuple[bool, Any]:
        return (False, None) if isinstance(self.current, str) else (True, self.current)

    def get(self, property_: int) -> float:
        return 30.0 if property_ == cv2.CAP_PROP_FPS else 0.0

    def set(self, property_: int, value: float) -> bool:
        self.asked[property_] = value
        return True

    def release(self) -> None:
        self.released += 1


def camera(capture: Device, clock: Callable[[], float] | None = None, **keys: Any) -> Camera:
    ticks = iter(np.arange(100.0, 1000.0, 0.5))
    config = CameraConfig.model_validate(keys)
    return Camera(config, lambda _: capture, clock or (lambda: float(next(ticks))), lambda: 5000.0)


def test_it_is_live_and_tells_its_size_and_rate():
    source = camera(Device([PICTURE]))

    source.start(Session(name="front"))

    info = source.sensors["front"]
    assert Camera.is_live
    assert (info.kind, info.size, info.rate_hz) == ("image", (6, 4), 30.0)


def test_stamps_are_monotonic_and_anchored_to_the_epoch_once():
    source = camera(Device([PICTURE] * 4))
    source.start(Session())  # 100.0: first picture; 100.5: anchor, epoch 5000.0

    frames = source.frames()
    stamps = [next(frames).stamp_s for _ in range(3)]

    assert stamps == [5000.5, 5001.0, 5001.5]


def test_what_the_config_asks_for_is_asked_of_the_device():
    device = Device([PICTURE])

    camera(device, width=640, height=480, rate_hz=15).start(Session())

    assert device.asked[cv2.CAP_PROP_FRAME_WIDTH] == 640
    assert device.asked[cv2.CAP_PROP_FRAME_HEIGHT] == 480
    assert device.asked[cv2.CAP_PROP_FPS] == 15


def test_grey_is_made_on_request():
    source = camera(Device([PICTURE] * 2), grey=True)
    source.start(Session())

    assert next(source.frames()).payload.pixels.shape == (4, 6)


def test_a_device_that_is_not_there_is_refused_and_released():
    device = Device([], is_there=False)

    with pytest.raises(SourceError, match="cannot open camera 3; is it plugged in, and free"):
        camera(device, device=3).start(Session())
    assert device.released == 1


def test_a_device_that_gives_nothing_is_refused_and_released():
    device = Device([])

    with pytest.raises(SourceError, match="camera 'rtsp://x' gives no picture; is it unplugged"):
        camera(device, device="rtsp://x").start(Session())
    assert device.released == 1


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (None, "camera 0 gives no picture"),
        ("undecodable", "camera 0: a picture cannot be decoded"),
        (np.zeros((4, 8, 3), np.uint8), "camera 0: a picture of 8x4 colour, 8 bit after pictures of 6x4 colour"),
    ],
)
def test_a_bad_picture_is_an_error_or_a_counted_skip(bad, message):
    source = camera(Device([PICTURE, PICTURE, bad, PICTURE]))
    source.start(Session())
    with pytest.raises(SourceError, match=message):
        list(source.frames())

    source = camera(Device([PICTURE, PICTURE, bad, PICTURE]), on_bad_frame="skip")
    source.start(Session())
    frames = source.frames()
    next(frames), next(frames)
    assert source.counters() == {"skipped": 1}


def test_a_device_that_fails_on_and_on_ends_the_run_even_when_skipping():
    device = Device([PICTURE, PICTURE])
    source = camera(device, on_bad_frame="skip", max_failures=3)
    source.start(Session())

    with pytest.raises(SourceError, match="camera 0: no usable picture 3 times in a row"):
        list(source.frames())
    source.close()
    assert device.released == 1


def test_a_picture_with_the_stamp_of_the_last_is_not_given_twice():
    clock = iter([100.0, 100.0, 101.0, 101.0, 102.0])
    source = camera(Device([PICTURE] * 4), clock=lambda: next(clock))
    source.start(Session())

    frames = source.frames()

    assert [next(frames).stamp_s, next(frames).stamp_s] == [5001.0, 5002.0]


def test_close_ends_frames_while_a_picture_is_being_taken():
    is_taking, may_go_on = threading.Event(), threading.Event()
    grabs = iter([None, "wait"])

    def on_grab() -> None:
        if next(grabs) == "wait":
            is_taking.set()
            assert may_go_on.wait(5)

    device = Device([PICTURE] * 9, on_grab=on_grab)
    source = camera(device)
    source.start(Session())
    given: list[Any] = []
    taker = threading.Thread(target=lambda: given.extend(source.frames()))
    closer = threading.Thread(target=source.close)
    taker.start()
    assert is_taking.wait(5)

    closer.start()
    assert source._closed.wait(5)  # close was called, and waits for the picture
    assert device.released == 0
    may_go_on.set()
    taker.join(5)
    closer.join(5)

    assert len(given) <= 1
    assert device.released == 1


def test_started_again_the_old_frames_end_and_the_device_is_opened_anew():
    devices = [Device([PICTURE] * 3), Device([PICTURE] * 3)]
    opened = iter(devices)
    source = Camera(CameraConfig.model_validate({}), lambda _: next(opened))
    source.start(Session())
    old = source.frames()
    next(old)

    source.start(Session())

    assert list(old) == []
    assert devices[0].released == 1
    assert next(source.frames()).payload.size == (6, 4)
    source.close()
    source.close()
    assert devices[1].released == 1


class Plug:
    """Gives another device each time one is opened; None: there is none."""

    def __init__(self, *devices: Device | None) -> None:
        self.devices = list(devices)

    def open(self, _: int | str) -> Device:
        device = self.devices.pop(0) if len(self.devices) > 1 else self.devices[0]
        return Device([], is_there=False) if device is None else device


def plugged(plug: Plug, clock: Callable[[], float] | None = None, **keys: Any) -> Camera:
    ticks = iter(np.arange(100.0, 1000.0, 0.5))
    config = CameraConfig.model_validate(keys)
    return Camera(config, plug.open, clock or (lambda: float(next(ticks))), lambda: 5000.0)


@pytest.mark.parametrize("on_bad_frame", ["error", "skip"])
def test_a_camera_that_is_unplugged_and_comes_back_goes_on(on_bad_frame: str, caplog: pytest.LogCaptureFixture):
    first, second = Device([PICTURE] * 3), Device([PICTURE] * 9)
    source = plugged(Plug(first, None, Device([]), second), reconnect_s=30, on_bad_frame=on_bad_frame)
    source.start(Session())
    frames = source.frames()

    stamps = [next(frames).stamp_s for _ in range(5)]

    assert source.counters() == {"reconnects": 1}
    assert stamps == sorted(set(stamps))
    assert first.released == 1
    assert "camera 0 gives no picture; is it unplugged" in caplog.text
    assert "camera 0 is back after" in caplog.text
    source.close()
    assert second.released == 1


def test_a_camera_that_stays_away_ends_the_run():
    source = plugged(Plug(Device([PICTURE] * 2), None), reconnect_s=0.3)
    source.start(Session())

    with pytest.raises(SourceError, match=r"cannot open camera 0; .* \(it is gone for \d s; reconnect_s\)"):
        list(source.frames())


def test_a_camera_that_is_closed_while_it_is_away_ends_quietly():
    source = plugged(Plug(Device([PICTURE] * 2), None), reconnect_s=60)
    source.start(Session())
    threading.Timer(0.3, source.close).start()

    assert len(list(source.frames())) == 1


def test_a_robot_whose_floor_camera_was_unplugged_is_lost_and_found_again():
    """It drives on by half a metre meanwhile, so that no picture after it shows what the last before it showed."""
    floor = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5)
    run = ground_run(straight(0.5), 120, ground=floor, camera=GroundCamera((320, 288), noise_sigma=3.0))
    seen = [frame.payload.pixels for k, frame in enumerate(run.frames) if not 40 <= k < 110]
    stamps = iter([run.frames[k].stamp_s for k in (0, 0, *range(1, 40), *range(110, 120))])
    plug = Plug(Device(seen[:40]), None, Device([seen[40], *seen[40:]]))  # the first after it is looked at, and dropped
    source = plugged(plug, lambda: float(next(stamps)), reconnect_s=30, grey=True)
    source.start(Session(name="floor"))
    localizer = create("localizer", "ground_vo", camera="floor", n_pixels=384)
    localizer.start(Session(name="vo", sensors={"floor": run.sensor}))

    frames, kinds, ends_s = source.frames(), [], []
    for _ in range(49):
        for estimate in localizer.observe(next(frames), Belief(0.0)):
            kinds.append(type(estimate))
            ends_s.append(estimate.stamp_s)

    gone = kinds.index(Lost)
    assert kinds[:gone] == [Motion] * gone
    assert gone >= 36
    assert ends_s[gone] - ends_s[gone - 1] == pytest.approx(71 / 70.0, abs=2e-2)
    assert kinds[-5:] == [Motion] * 5
    assert source.counters() == {"reconnects": 1}
