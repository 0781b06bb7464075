"""Sources of frames, and faults that disturb them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

import numpy as np

import trailmark.frames
from trailmark.commands import Command
from trailmark.errors import ConfigError
from trailmark.frames import Frame, SensorInfo, SensorOrigin
from trailmark.geometry import Trajectory
from trailmark.interfaces.session import Part

__all__ = ["Drivable", "Fault", "FrameSource"]


class FrameSource(Part):
    """Gives the frames of one or several sensors in the order of their stamps."""

    @property
    @abstractmethod
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors, by name; known after `start`."""

    @abstractmethod
    def frames(self) -> Iterator[Frame]:
        """Yield all frames once, in stamp order; a live source may yield those of several sensors as they come.

        The iterator ends at the end of the recording or after `close`.

        Raises
        ------
        SourceError
            If a frame is missing or unreadable, its size changes, or a stamp goes back.
        """

    def ground_truth(self) -> Trajectory | None:
        """Return the true trajectory of base where it is known; asked after the last frame."""
        return None

    def outlines(self) -> trailmark.frames.Outlines | None:
        """Return what stands around and how large the robot is, where it is known, for drawing; asked at the end."""
        return None

    def lasts_s(self) -> float | None:
        """Return about how long its frames go on, for progress, where that is known beforehand [s]; after `start`."""
        return None

    def unread(self) -> Mapping[str, str]:
        """Return what the recording holds and the source does not give, with the reason; known after `start`."""
        return {}

    def origins(self) -> Mapping[str, SensorOrigin]:
        """Return where the recording says mountings and calibrations, by sensor; known after `start`."""
        return {}

    @classmethod
    def survey(cls, where: str) -> Sequence[Mapping[str, str]]:
        """Return what is on a network, for ``trailmark inspect NAME://WHERE``: rows of a table, by column.

        Parameters
        ----------
        where : str
            The place, as the source writes it: an address, a domain number.

        Returns
        -------
        sequence of mapping of str to str
            A mapping for each sensor or topic found, from column to text.

        Raises
        ------
        ConfigError
            If `where` is no such place, or the source reads no network, which is the default.
        """
        raise ConfigError(f"{cls.__name__} reads no network: {where!r} cannot be looked at")

    #: True for devices: frames come when they come, and what is not taken is lost.
    is_live: ClassVar[bool] = False


class Drivable(FrameSource):
    """A source that is a robot: it can be driven. It may also drive itself (a person, a scripted route)."""

    @property
    @abstractmethod
    def accepts(self) -> frozenset[type[Command]]:
        """The commands it understands; `Stop` always is one of them."""

    @abstractmethod
    def drive(self, command: Command) -> None:
        """Take a command. It holds from the last frame yielded until the next command.

        `Stop` may come from another thread, also while another call hangs: at a signal, and from the watchdog.

        Parameters
        ----------
        command : Command
            One of the kinds in `accepts`.
        """

    #: True when it drives itself, so that a run needs no controller.
    drives_itself: bool = False


class Fault(Part):
    """Makes what one sensor gives worse, on purpose, as a wrapper around it: faults can be put around faults.

    One is made for each sensor that it befalls: its state is of that sensor alone, and so are its random numbers, which
    come from (seed, source, sensor, fault). `start` gets a session whose `Session.sensors` is that sensor, and whose
    `Session.rng` is for what stays as it is over the run, such as where dirt sits on a lens.
    """

    #: Kinds of sensor that it can befall; empty: any.
    kinds: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        """Return a frame as the fault leaves it.

        Parameters
        ----------
        frame : Frame
            The next frame of the sensor; its arrays are read-only.
        rng : numpy.random.Generator
            For this frame alone: what is drawn for one frame does not depend on the frames before it.
        since_s : float
            Time since the first frame of the source [s].

        Returns
        -------
        Frame or None
            Of the same sensor and of the same size. A later stamp delays it: other frames may pass. None: it is lost.
        """

    def idle_options(self, info: SensorInfo) -> Mapping[str, str]:
        """Return the options that are in use and change nothing of a sensor, and what they do befall.

        Asked before the start. A run in which an option befalls no sensor is refused.

        Parameters
        ----------
        info : SensorInfo
            A sensor of one of `kinds`.

        Returns
        -------
        mapping of str to str
            By option: ``"sensors of kind image"``.
        """
        return {}

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return the sensor as the run shall know it: the truth, unless the fault is a wrong calibration.

        Parameters
        ----------
        info : SensorInfo
            The sensor as it is.

        Returns
        -------
        SensorInfo
            The sensor with the calibration and mounting that localizers are given.
        """
        return info
