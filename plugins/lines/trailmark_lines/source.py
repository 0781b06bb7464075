"""A robot of any language: frames as lines of JSON, commands back as lines."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from trailmark.clock import live_stamp_s
from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError, SourceError
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Drivable, Session
from trailmark.sources.clock_offset import ClockOffset
from trailmark_lines.channels import Channel, DeviceChannel, StandardChannel, TcpChannel, UdpChannel
from trailmark_lines.config import LinesConfig
from trailmark_lines.readings import LineReader, document_of

__all__ = ["LinesSource"]

logger = logging.getLogger(__name__)

_LONGEST_WAIT_S = 0.1
#: A robot that has sent nothing for so long is said to be silent [s].
_SILENCE_S = 5.0
#: A line of more bytes is none.
MAX_LINE = 1 << 25
#: So many lines more of one kind, with a stamp or without, outweigh all that came before.
_MOST_BALANCE = 5
#: Stamps that differ more from the time at which lines come, for longer, are told of [s].
_MOST_OFFSET_S, _MOST_WAITED_S = 1.0, 5.0
_COMMANDS: Mapping[str, type[Command]] = {"velocity": Velocity, "steer_4ws": Steer4WS}


class LinesSource(Drivable):
    """Lines ``{"sensor": ..., "stamp_s": ..., ...}``, one frame each; commands as the sink ``jsonl`` writes them."""

    config: LinesConfig
    is_live: ClassVar[bool] = True

    def __init__(self, config: LinesConfig) -> None:
        super().__init__(config)
        self._channel: Channel | None = None
        self._busy = threading.Lock()  # a channel must not be closed while it is read
        self._closed = threading.Event()
        self._counts: Counter[str] = Counter()
        self._told: set[tuple[str, str]] = set()  # sensors and problems of which a skipped line was told
        self._session = Session()
        self._quiet_since_s: float | None = None
        self._is_silent = self._is_driven = False
        self.drives_itself = config.command is None

    def start(self, session: Session) -> None:
        """Open the channel.

        Raises
        ------
        SourceError
            If it cannot be opened.
        """
        self.close()
        self._closed, self._session, self._counts, self._told = threading.Event(), session, Counter(), set()
        self._quiet_since_s, self._is_silent, self._is_driven = None, False, False
        self._timely_s: dict[str, float] = {}  # when a line of each sensor last came near its stamp
        self.drives_itself = self.config.command is None or session.mode == "teach"
        self._reader = LineReader(self.config.sensors, self.config.pictures)
        self._channel = self._open_channel()

    def close(self) -> None:
        """End `frames`, and close the channel."""
        self._closed.set()
        with self._busy:
            channel, self._channel = self._channel, None
            if channel is not None:
                channel.close()

    def counters(self) -> Mapping[str, int]:
        """Return what was counted: ``skipped`` lines, and stamps that ``went_back`` or were ``repeated``."""
        return dict(self._counts)

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors of the config."""
        return MappingProxyType({name: SensorInfo(name, kind) for name, kind in self.config.sensors.items()})

    @property
    def port(self) -> int | None:
        """Where it listens, over tcp and udp."""
        return getattr(self._channel, "port", None)

    @property
    def accepts(self) -> frozenset[type[Command]]:
        """What the config says of the robot; `Stop` always."""
        return frozenset({Stop} | ({_COMMANDS[self.config.command]} if self.config.command else set()))

    def drive(self, command: Command) -> None:
        """Send a command as a line.

        Raises
        ------
        ConfigError
            If the robot does not take it.
        """
        if type(command) not in self.accepts:
            raise ConfigError(f"the robot of these lines takes no {type(command).__name__}; see its key command")
        channel = self._channel
        if channel is None or self.config.command is None or (self.drives_itself and not isinstance(command, Stop)):
            return
        said = {"type": "command", "stamp_s": live_stamp_s(), "kind": type(command).__name__, **asdict(command)}
        self._is_driven = not isinstance(command, Stop)
        channel.write(json.dumps(said, separators=(",", ":")).encode() + b"\n")

    # --- lines -----------------------------------------------------------------------------------------------------

    def frames(self) -> Iterator[Frame]:
        """Yield frames as their lines come, until ``{"type": "end"}``, the end of the input, or `close`.

        Raises
        ------
        SourceError
            If a line cannot be used, with ``on_bad_frame: error``.
        """
        newest_s: dict[str, float] = {}
        balances: defaultdict[str, int] = defaultdict(int)
        clocks: defaultdict[str, ClockOffset] = defaultdict(ClockOffset)
        closed = self._closed
        for line in self._lines(closed):
            if closed.is_set():
                return
            sensor, problem = "", "unreadable"
            try:
                document = document_of(line)
                if document.get("type") == "end":
                    return
                if document.get("type") == "pose":
                    problem = "pose"
                    self._pass_told_pose(document)
                    continue
                came_s = live_stamp_s()
                sensor, problem = self._known_sensor(document), "numbers"
                frame = self._reader.frame(document, came_s)
                problem = "two clocks"
                self._weigh(balances, sensor, "stamp_s" in document)
                problem = "ahead"
                clock = clocks[frame.sensor]
                if ahead_s := clock.note_message(frame.stamp_s, came_s):
                    raise SourceError(
                        f"a stamp of {frame.sensor!r} is {ahead_s:.0f} s ahead of those before it; stamp_s are seconds"
                    )
            except SourceError as error:
                self._refuse(error, sensor, problem)
                continue
            if clock.begun_ahead_s:
                raise SourceError(
                    f"the first stamp of {frame.sensor!r} was {clock.begun_ahead_s:.0f} s ahead of all after it, and"
                    " the run began with it; begin anew"
                )
            self._warn_of_another_clock(frame, came_s)
            if frame.stamp_s <= newest_s.get(frame.sensor, -np.inf):
                self._leave_out(frame, newest_s[frame.sensor])
                continue
            newest_s[frame.sensor] = frame.stamp_s
            yield frame

    def _known_sensor(self, document: Mapping[str, Any]) -> str:
        """Return the sensor of a line; empty where the config has none of that name: there may be any number."""
        sensor = document.get("sensor")
        return sensor if isinstance(sensor, str) and sensor in self.config.sensors else ""

    def _weigh(self, balances: dict[str, int], sensor: str, has_stamp: bool) -> None:
        """Note by how many lines of a sensor those with a stamp outweigh those without; refuse one of the fewer.

        Those with a stamp are of another clock than those without. Which is right the first line alone cannot say.
        """
        before = balances.get(sensor, 0)
        after = max(-_MOST_BALANCE, min(_MOST_BALANCE, before + (1 if has_stamp else -1)))
        balances[sensor] = after
        kind = "with a stamp_s" if has_stamp else "without a stamp_s"
        if after == 0 or (after > 0) != has_stamp:
            raise SourceError(f"a line of {sensor!r} came {kind}, those before it were not so: two clocks")
        if before == 0 and (sensor, "two clocks") in self._told:
            self._tell_once(
                sensor, kind, f"most lines of {sensor!r} come {kind} now: they are used, others are skipped"
            )

    def _warn_of_another_clock(self, frame: Frame, came_s: float) -> None:
        """Say once that stamps are not of this machine's clock, by which commands are due; first lines have waited."""
        if self.drives_itself:
            return
        offset_s = frame.stamp_s - came_s
        if abs(offset_s) <= _MOST_OFFSET_S:
            self._timely_s[frame.sensor] = came_s
        elif came_s - self._timely_s.setdefault(frame.sensor, came_s) > _MOST_WAITED_S:
            way = "ahead" if offset_s > 0 else "behind"
            text = f"stamp_s of {frame.sensor!r} are {abs(offset_s):.3g} s {way} of this machine's clock"
            advice = "they are seconds of the epoch, and a robot without a clock leaves them out"
            self._tell_once(frame.sensor, "another clock", f"{text}; {advice}")

    def _leave_out(self, frame: Frame, newest_s: float) -> None:
        """Count a frame that is not newer than the one before it; of those that went back, the first is said."""
        if frame.stamp_s == newest_s:
            self._counts["repeated"] += 1
            return
        if not self._counts["went_back"]:
            logger.warning(
                "%s: stamp_s went back from %g s to %g s; such lines are skipped until the stamps are beyond the first"
                " one again, others silently: did the robot's clock begin anew?",
                frame.sensor,
                newest_s,
                frame.stamp_s,
            )
        self._counts["went_back"] += 1

    def _lines(self, closed: threading.Event) -> Iterator[bytes]:
        rest = b""
        while not closed.is_set():
            with self._busy:
                if self._channel is None:
                    return
                data = self._read(self._channel)
            self._note_silence(is_silent=data == b"")
            *lines, rest = (rest + (b"\n" if data is None else data)).split(b"\n")
            yield from (line for line in lines if line.strip())
            if data is None:
                self._end()
                return
            if len(rest) > MAX_LINE:
                self._refuse(SourceError(f"a line of more than {MAX_LINE} bytes"), "", "too long")
                rest = b""

    def _note_silence(self, *, is_silent: bool) -> None:
        """Say once that nothing comes, and when something does again; a run that works does not look."""
        now_s = time.monotonic()
        quiet_s = now_s - (now_s if self._quiet_since_s is None else self._quiet_since_s)
        if is_silent:
            self._quiet_since_s = now_s - quiet_s
            if quiet_s > _SILENCE_S and not self._is_silent:
                self._is_silent = True
                logger.warning("the robot is silent: nothing has come over %s for %.1f s", self.config.over, quiet_s)
            return
        if self._is_silent:
            logger.warning("the robot is back after %.1f s", quiet_s)
        self._quiet_since_s, self._is_silent = None, False

    def _end(self) -> None:
        """End a run whose robot goes away without a word while it is driven: it may be on its way still."""
        text = f'the robot\'s program is gone: {self.config.over} ended without a line {{"type": "end"}}'
        if self._is_driven:
            raise SourceError(f"{text} while it was driven")
        if not self.drives_itself:
            logger.warning("%s", text)

    def _read(self, channel: Channel) -> bytes | None:
        try:
            return channel.read(_LONGEST_WAIT_S)
        except (OSError, ValueError) as error:  # the latter if standard input was closed
            words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise SourceError(f"nothing can be read from {self.config.over} any more: {words}") from error

    def _pass_told_pose(self, document: Mapping[str, Any]) -> None:
        """Pass on where a person says that the robot is."""
        try:
            pose = Pose2(*(float(value) for value in document["pose_map_base"]))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise SourceError(f"a line of type pose needs pose_map_base: [x, y, theta]: {error}") from error
        self._session.tell_pose(pose, None)

    def _refuse(self, error: SourceError, sensor: str, problem: str) -> None:
        if self.config.on_bad_frame == "error":
            raise error
        self._tell_once(sensor, problem, f"{error}; others like it are skipped silently")
        self._counts["skipped"] += 1

    def _tell_once(self, sensor: str, problem: str, text: str) -> None:
        if (sensor, problem) not in self._told:
            self._told.add((sensor, problem))
            logger.warning("%s", text)

    def _open_channel(self) -> Channel:
        config = self.config
        match config.over:
            case "tcp":
                return TcpChannel(config.host, config.port)
            case "udp":
                return UdpChannel(config.host, config.port)
            case "device":
                assert config.device is not None  # the config sees to it
                return DeviceChannel(config.device, config.baud)
        return StandardChannel()
