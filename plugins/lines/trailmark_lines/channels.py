"""Where lines come from, and commands go to."""

from __future__ import annotations

import io
import logging
import os
import select
import socket
import sys
import time
from abc import ABC, abstractmethod
from pathlib import Path

from trailmark.errors import SourceError

__all__ = ["Channel", "DeviceChannel", "StandardChannel", "TcpChannel", "UdpChannel"]

logger = logging.getLogger(__name__)

_CHUNK = 1 << 16

# Who does not take a command within this time is not listening [s].
_WRITE_S = 0.1


class Channel(ABC):
    """Bytes in both directions."""

    @abstractmethod
    def read(self, timeout_s: float) -> bytes | None:
        """Return what has come, empty after a time; None: nothing will come any more."""

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes, if a program is connected."""

    def close(self) -> None:  # noqa: B027  (a default on purpose)
        """Let go of it."""


class StandardChannel(Channel):
    """Standard input and output."""

    def read(self, timeout_s: float) -> bytes | None:
        """Read what stands in the pipe."""
        number = sys.stdin.fileno()
        if not select.select([number], [], [], timeout_s)[0]:
            return b""
        return os.read(number, _CHUNK) or None

    def write(self, data: bytes) -> None:
        """Write to standard output.

        Raises
        ------
        SourceError
            If nobody reads them, at the other end of a full pipe or of one that is closed.
        """
        sys.stdout.flush()
        try:
            number = sys.stdout.fileno()
        except io.UnsupportedOperation:  # it is replaced, as in a notebook
            sys.stdout.write(data.decode())
            return
        left = _write_in_time(number, data, "standard output")
        if left:
            raise SourceError("standard output takes no commands: nobody reads them")


class DeviceChannel(Channel):
    """A serial port, or what looks like one.

    Parameters
    ----------
    path : Path
        The device: ``/dev/ttyUSB0``.
    baud : int
        Bits per second.
    """

    def __init__(self, path: Path, baud: int) -> None:
        import termios
        import tty

        try:
            self._number = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise SourceError(f"cannot open {path}: {error.strerror or error}; is it plugged in, and yours?") from error
        self._path = path
        self._is_cut = False  # half a line was taken
        if os.isatty(self._number):
            tty.setraw(self._number)
            settings = termios.tcgetattr(self._number)
            settings[4] = settings[5] = getattr(termios, f"B{baud}")
            termios.tcsetattr(self._number, termios.TCSANOW, settings)

    def read(self, timeout_s: float) -> bytes | None:
        """Read what has come."""
        try:
            if not select.select([self._number], [], [], timeout_s)[0]:
                return b""
            return os.read(self._number, _CHUNK) or None
        except OSError as error:
            raise SourceError(f"{self._path} gives nothing any more: {error.strerror or error}") from error

    def write(self, data: bytes) -> None:
        """Write; half a line that was taken before is ended first, so that this one is read as it is.

        Raises
        ------
        SourceError
            If the device does not take it in time.
        """
        left = _write_in_time(self._number, (b"\n" if self._is_cut else b"") + data, str(self._path))
        self._is_cut = bool(left)
        if left:
            raise SourceError(f"{self._path} takes no commands: nobody reads them")

    def close(self) -> None:
        """Close the device."""
        number, self._number = self._number, -1
        if number >= 0:
            os.close(number)


class UdpChannel(Channel):
    """Packets, each with whole lines; commands go to who sent the last one.

    Parameters
    ----------
    host, port : str
        Where to listen.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bind(socket.SOCK_DGRAM, host, port)
        self._peer: tuple[str, int] | None = None

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._socket.getsockname()[1])

    def read(self, timeout_s: float) -> bytes | None:
        """Read a packet."""
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return b""
        data, self._peer = self._socket.recvfrom(_CHUNK)
        return data + b"\n"

    def write(self, data: bytes) -> None:
        """Send a packet."""
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except ConnectionError:
            return
        except OSError as error:
            raise SourceError(f"no command can be sent to {self._peer[0]}: {error.strerror or error}") from error

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class TcpChannel(Channel):
    """One TCP connection at a time; a program that disconnects may connect again.

    Parameters
    ----------
    host, port : str
        Where to listen.
    """

    def __init__(self, host: str, port: int) -> None:
        self._listener = _bind(socket.SOCK_STREAM, host, port)
        self._listener.listen(1)
        self._connection: socket.socket | None = None

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._listener.getsockname()[1])

    def read(self, timeout_s: float) -> bytes | None:
        """Read from the connection, or wait for one."""
        waiting = self._connection or self._listener
        if not select.select([waiting], [], [], timeout_s)[0]:
            return b""
        if self._connection is None:
            self._connection, _ = self._listener.accept()
            self._connection.settimeout(_WRITE_S)  # for writing: what is read is there
            return b""
        try:
            data = self._connection.recv(_CHUNK)
        except ConnectionError:
            data = b""
        if data:
            return data
        self._connection.close()
        self._connection = None
        logger.warning("the robot's program has left port %d; it may come again", self.port)
        return b"\n"  # half a line of who is gone is none

    def write(self, data: bytes) -> None:
        """Send to the connection.

        Raises
        ------
        SourceError
            If who is connected does not read; the connection is closed then, since half a line may have been sent.
        """
        connection = self._connection
        if connection is None:
            return
        try:
            connection.sendall(data)
        except ConnectionError:
            return
        except TimeoutError as error:
            connection.shutdown(socket.SHUT_RDWR)  # which ends it for the thread that reads
            raise SourceError("who is connected does not read the commands") from error
        except OSError as error:
            raise SourceError(f"no command can be sent: {error.strerror or error}") from error

    def close(self) -> None:
        """Close both sockets."""
        if self._connection is not None:
            self._connection.close()
        self._listener.close()


def _write_in_time(number: int, data: bytes, name: str) -> bytes:
    """Write to an open file as long as one waits for who reads it; return what it did not take."""
    until_s = time.monotonic() + _WRITE_S
    try:
        while data and select.select([], [number], [], max(0.0, until_s - time.monotonic()))[1]:
            data = data[os.write(number, data[: select.PIPE_BUF]) :]  # more might block
    except OSError as error:
        raise SourceError(f"{name} takes no commands: {error.strerror or error}") from error
    return data


def _bind(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, kind)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        opened.bind((host, port))
    except OSError as error:
        opened.close()
        raise SourceError(f"cannot listen at {host}:{port}: {error.strerror or error}") from error
    return opened
