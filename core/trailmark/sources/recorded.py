"""What all sources over files share: lazy readings, the order of stamps, bad frames, closing."""

from __future__ import annotations

import logging
import math
import threading
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from trailmark.config import SourceConfig
from trailmark.errors import SourceError
from trailmark.frames import RGBD, Frame, Image, Payload, SensorInfo
from trailmark.interfaces import FrameSource, Session

__all__ = ["Reading", "Readings", "RecordedSource", "form_of"]

logger = logging.getLogger(__name__)

# Kinds of sensors whose frames are decoded.
_PICTURES = frozenset({"image", "rgbd"})

_REMEDY = "Set on_bad_frame: skip to count such frames and go on"


@dataclass(frozen=True, slots=True)
class Reading:
    """A frame that is known but not read yet.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    stamp_s : float
        When it was taken [s].
    where : str
        Where it stands, for messages: ``"rgb.txt:12 (rgb/000012.png)"``.
    load : callable
        Reads and returns the payload; raises `SourceError` where it cannot be used.
    """

    sensor: str
    stamp_s: float
    where: str
    load: Callable[[], Payload]


Readings = Generator[Reading | SourceError, None, None]
"""Readings in file order; what could not even be stamped, as the error that says so."""


class RecordedSource(FrameSource):
    """A source over files. Files are opened by `frames` and closed with it, so `close` need only end it.

    A format brings two methods: `open_recording`, which looks at the recording and tells its sensors, and `readings`,
    which gives what it holds, in file order. What follows is the same for all: stamps of one sensor strictly
    increase (a repeated one is dropped and counted), the sensors are merged by stamp, the payload is read last,
    and what is wrong ends the run or, with ``on_bad_frame: skip``, is counted.

    Attributes
    ----------
    counted : Counter of str
        What `counters` returns since `start`; a format adds its own.
    """

    config: SourceConfig

    #: How long a sensor's readings may stand behind those of others in the file [s].
    reorder_s: float = 0.0

    #: True where `load` of a picture depends on nothing but its reading, so that threads may call it before its turn.
    loads_ahead: ClassVar[bool] = False

    def __init__(self, config: SourceConfig) -> None:
        super().__init__(config)
        self._sensors: Mapping[str, SensorInfo] = MappingProxyType({})
        self.counted: Counter[str] = Counter()
        self._forms: dict[str, str] = {}  # of each sensor: every picture must look like the first one
        self._closed = threading.Event()
        self._closed.set()

    @abstractmethod
    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        """Inspect the recording and return its sensors; a source of one sensor calls it `name`.

        Raises
        ------
        SourceError
            If there is nothing to read, or it cannot be understood.
        """

    @abstractmethod
    def readings(self) -> Readings:
        """Yield the readings in file order; a line without a readable stamp as its error."""

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors, by name; known after `start`."""
        return self._sensors

    def start(self, session: Session) -> None:
        """Inspect the recording: sensors, sizes, the first picture.

        Raises
        ------
        SourceError
            If there is nothing to read, or it cannot be understood.
        """
        self._closed.set()
        self._closed = threading.Event()
        self.counted, self._forms = Counter(), {}
        self._sensors = MappingProxyType({info.name: info for info in self.open_recording(session.name)})

    def expect_form(self, sensor: str, payload: Payload) -> None:
        """Refuse later pictures of a sensor that differ in size, colour or depth from this one."""
        self._forms[sensor] = form_of(payload)

    def close(self) -> None:
        """End `frames`, from any thread."""
        self._closed.set()

    def counters(self) -> Mapping[str, int]:
        """Return what was counted: ``skipped`` bad frames, ``repeated`` stamps, and the format's own."""
        return dict(self.counted)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in stamp order.

        Raises
        ------
        SourceError
            If a frame is missing or unreadable, its size changes, or a stamp goes back; the message names the
            file and line. With ``on_bad_frame: skip`` these are counted instead.
        """
        return self._frames(self._closed)

    def _frames(self, closed: threading.Event) -> Iterator[Frame]:
        if closed.is_set():
            return
        with closing(self.readings()) as readings, closing(self._ordered(readings, closed)) as ordered:
            last_s = -math.inf
            for reading in ordered:
                if closed.is_set():
                    return
                if reading.stamp_s < last_s:
                    self._refuse_or_count(_late(reading, last_s))
                    continue
                last_s = reading.stamp_s
                payload = self._load_payload(reading)
                if payload is not None:
                    yield Frame(reading.sensor, reading.stamp_s, payload)

    def _ordered(self, readings: Readings, closed: threading.Event) -> Generator[Reading, None, None]:
        """Yield the readings by stamp; where that can be, the payloads of pictures are begun to load."""
        ordered, names = self._check_increasing(readings, closed), tuple(self._sensors)
        if len(names) > 1:
            from trailmark.sources.reorder import in_stamp_order  # one sensor is in order

            ordered = in_stamp_order(ordered, names, self.reorder_s)
        pictures = [name for name, info in self._sensors.items() if info.kind in _PICTURES]
        if self.loads_ahead and pictures:
            from trailmark.sources.ahead import loaded_ahead  # other readings are not worth a thread

            ordered = loaded_ahead(ordered, pictures)
        yield from ordered

    def _check_increasing(self, readings: Readings, closed: threading.Event) -> Iterator[Reading]:
        newest_s: dict[str, float] = {}
        for reading in readings:
            if closed.is_set():
                return
            if isinstance(reading, SourceError):
                self._refuse_or_count(reading)
                continue
            last_s = newest_s.get(reading.sensor, -math.inf)
            if not math.isfinite(reading.stamp_s):
                self._refuse_or_count(SourceError(f"{reading.where}: the stamp is not finite"))
            elif reading.stamp_s > last_s:
                newest_s[reading.sensor] = reading.stamp_s
                yield reading
            elif reading.stamp_s == last_s:
                self.counted["repeated"] += 1
            else:
                self._refuse_or_count(
                    SourceError(
                        f"{reading.where}: the stamp goes back: {reading.stamp_s:.6f} s after {last_s:.6f} s"
                        f" of sensor {reading.sensor!r}"
                    )
                )

    def _load_payload(self, reading: Reading) -> Payload | None:
        try:
            payload = reading.load()
            if payload.is_snapshot:
                form = form_of(payload)
                expected = self._forms.setdefault(reading.sensor, form)
                if form != expected:
                    raise SourceError(f"{reading.where}: a picture of {form} after pictures of {expected}")
        except SourceError as error:
            self._refuse_or_count(error)
            return None
        return payload

    def _refuse_or_count(self, error: SourceError) -> None:
        """Count a bad frame, or raise it."""
        if self.config.on_bad_frame == "error":
            raise SourceError(f"{error}. {_REMEDY}") from error
        if not self.counted["skipped"]:
            logger.warning("skipped a bad frame, and will skip others silently: %s", error)
        self.counted["skipped"] += 1
        logger.debug("skipped: %s", error)


def _late(reading: Reading, last_s: float) -> SourceError:
    return SourceError(
        f"{reading.where}: the frame of sensor {reading.sensor!r} comes too late to be put in order:"
        f" {reading.stamp_s:.6f} s, but {last_s:.6f} s was reached by another sensor"
    )


def form_of(payload: Payload) -> str:
    """Return what must not change from picture to picture, in words; empty for other payloads.

    Parameters
    ----------
    payload : Payload
        What a frame carries.

    Returns
    -------
    str
        Size, channels and depth of the pixels: ``640x480 colour, 8 bit``.
    """
    if isinstance(payload, RGBD):
        (height, width), (rows, columns) = payload.bgr.shape[:2], payload.depth_m.shape
        return f"{width}x{height} with depth {columns}x{rows}"
    if isinstance(payload, Image):
        width, height = payload.size
        kind = "colour" if payload.pixels.ndim == 3 else "grey"
        return f"{width}x{height} {kind}, {payload.pixels.dtype.itemsize * 8} bit"
    return ""
