"""A live camera."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

import cv2
import numpy.typing as npt

from trailmark.errors import SourceError
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.interfaces import FrameSource, Session
from trailmark.sources import form_of
from trailmark.sources.pictures import as_payload_pixels
from trailmark_datasets.config import CameraConfig

__all__ = ["Camera", "Capture"]

logger = logging.getLogger(__name__)

#: How often a camera that is gone is looked for [s].
_LOOK_EVERY_S = 0.25
#: How long `close` waits for a picture that is being taken; after that `frames` releases the device itself.
_RELEASE_WAIT_S = 2.0


class _GoneError(SourceError):
    """The device gives no pictures any more."""


class Capture(Protocol):
    """What is used of ``cv2.VideoCapture``."""

    def grab(self) -> bool:
        """Wait for the next picture; False: there is none."""

    def retrieve(self) -> tuple[bool, npt.NDArray[Any]]:
        """Decode the picture that was grabbed."""

    def get(self, property_: int, /) -> float:
        """Return a property."""

    def set(self, property_: int, value: float, /) -> bool:
        """Request a property of the device."""

    def isOpened(self) -> bool:
        """Return whether the device is there."""

    def release(self) -> None:
        """Release the device."""


class Camera(FrameSource):
    """A camera or a stream. Stamps are monotonic and anchored to the epoch once, when it starts.

    Parameters
    ----------
    config : CameraConfig
        Which device, and what to ask it for.
    open_capture : callable, optional
        Opens the device; another one in tests.
    monotonic_s, epoch_s : callable, optional
        The clocks.
    """

    config: CameraConfig
    is_live: ClassVar[bool] = True

    def __init__(
        self,
        config: CameraConfig,
        open_capture: Callable[[int | str], Capture] | None = None,
        monotonic_s: Callable[[], float] = time.monotonic,
        epoch_s: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(config)
        self._open_capture = open_capture or _open_device
        self._monotonic_s, self._epoch_s = monotonic_s, epoch_s
        self._sensors: Mapping[str, SensorInfo] = MappingProxyType({})
        self._counts: Counter[str] = Counter()
        self._capture: Capture | None = None
        self._busy = threading.Lock()  # a device must not be released while another thread takes a picture
        self._closed = threading.Event()
        self._offset_s = 0.0
        self._name, self._form = "", ""

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The camera; known after `start`."""
        return self._sensors

    def counters(self) -> Mapping[str, int]:
        """Return what was counted: ``skipped`` pictures, ``reconnects`` of a camera that was gone."""
        return dict(self._counts)

    def start(self, session: Session) -> None:
        """Open the device and take a first picture, to know its size.

        Raises
        ------
        SourceError
            If the device cannot be opened or gives no picture.
        """
        self.close()
        self._closed, self._counts = threading.Event(), Counter()
        self._name = session.name or "camera"
        self._capture = capture = self._open_and_configure()
        try:
            first = self._take_picture(capture)[0]
        except SourceError:
            self.close()
            raise
        self._offset_s = self._epoch_s() - self._monotonic_s()
        self._form = form_of(first)
        rate_hz = self.config.rate_hz or float(capture.get(cv2.CAP_PROP_FPS))
        info = SensorInfo(self._name, "image", size=first.size, rate_hz=rate_hz if rate_hz > 0 else None)
        self._sensors = MappingProxyType({self._name: info})

    def close(self) -> None:
        """End `frames` and release the device."""
        self._closed.set()
        if self._busy.acquire(timeout=_RELEASE_WAIT_S):
            try:
                self._release()
            finally:
                self._busy.release()

    def frames(self) -> Iterator[Frame]:
        """Yield pictures as they come, until `close`.

        Raises
        ------
        SourceError
            If the device stops giving pictures or their size changes.
        """
        return self._frames(self._closed)

    def _frames(self, closed: threading.Event) -> Iterator[Frame]:
        failures = 0
        last_s = float("-inf")
        while not closed.is_set():
            with self._busy:
                capture = self._capture
                if closed.is_set() or capture is None:
                    break
                frame, gone = None, None
                try:
                    frame = self._next(capture, closed)
                except _GoneError as error:
                    gone = error
            if gone is not None:
                self._wait_until_back(gone, closed)
            elif frame is None:
                failures += 1
                if failures >= self.config.max_failures:
                    raise SourceError(f"camera {self.config.device!r}: no usable picture {failures} times in a row")
            elif frame.stamp_s > last_s:
                failures, last_s = 0, frame.stamp_s
                yield frame
        with self._busy:
            if self._closed is closed:  # not started anew meanwhile
                self._release()

    def _next(self, capture: Capture, closed: threading.Event) -> Frame | None:
        """Take a picture; None: it failed and is counted."""
        try:
            picture, monotonic_s = self._take_picture(capture)
            if form_of(picture) != self._form:
                raise SourceError(
                    f"camera {self.config.device!r}: a picture of {form_of(picture)} after pictures of {self._form}"
                )
            return Frame(self._name, monotonic_s + self._offset_s, picture)
        except SourceError as error:
            is_to_come_back = isinstance(error, _GoneError) and self.config.reconnect_s > 0.0
            if closed.is_set() or (self.config.on_bad_frame == "skip" and not is_to_come_back):
                self._counts["skipped"] += 1
                return None
            raise

    def _wait_until_back(self, gone: _GoneError, closed: threading.Event) -> None:
        """Open the device again as soon as it is there; raise if it stays away, return at once when closed."""
        if self.config.reconnect_s == 0.0:
            raise gone
        began_s = time.monotonic()
        logger.warning("%s; it is looked for again for %g s (reconnect_s)", gone, self.config.reconnect_s)
        while not closed.wait(_LOOK_EVERY_S):
            away_s = time.monotonic() - began_s
            with self._busy:
                if closed.is_set():
                    return
                self._release()
                try:
                    self._capture = capture = self._open_and_configure()
                    if not capture.grab():  # it is there, and gives nothing
                        raise gone
                except SourceError as error:
                    self._release()
                    if away_s > self.config.reconnect_s:
                        raise SourceError(f"{error} (it is gone for {away_s:.0f} s; reconnect_s)") from gone
                    continue
            self._counts["reconnects"] += 1
            logger.warning("camera %r is back after %.1f s", self.config.device, away_s)
            return

    def _take_picture(self, capture: Capture) -> tuple[Image, float]:
        """Take a picture, with the monotonic time at which it arrived."""
        if not capture.grab():
            raise _GoneError(f"camera {self.config.device!r} gives no picture; is it unplugged, or the stream over?")
        monotonic_s = self._monotonic_s()
        decoded, pixels = capture.retrieve()
        if not decoded:
            raise SourceError(f"camera {self.config.device!r}: a picture cannot be decoded")
        where = f"camera {self.config.device!r}"
        return Image(as_payload_pixels(pixels, where, bool(self.config.grey))), monotonic_s

    def _open_and_configure(self) -> Capture:
        capture = self._open_capture(self.config.device)
        if not capture.isOpened():
            capture.release()
            raise SourceError(f"cannot open camera {self.config.device!r}; is it plugged in, and free?")
        wanted = (
            (cv2.CAP_PROP_FRAME_WIDTH, self.config.width),
            (cv2.CAP_PROP_FRAME_HEIGHT, self.config.height),
            (cv2.CAP_PROP_FPS, self.config.rate_hz),
            (cv2.CAP_PROP_BUFFERSIZE, 1),  # an old picture is worth nothing
        )
        for property_, value in wanted:
            if value is not None:
                capture.set(property_, float(value))
        return capture

    def _release(self) -> None:
        capture, self._capture = self._capture, None
        if capture is not None:
            capture.release()


def _open_device(device: int | str) -> Capture:
    return cv2.VideoCapture(device)
