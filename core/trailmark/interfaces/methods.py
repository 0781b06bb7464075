"""What turns frames into estimates, estimates into a belief, and a belief into commands."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.commands import Command
from trailmark.estimates import Applied, Belief, Estimate, Fix, Lost
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.interfaces.session import Part
from trailmark.paths import Keyframe

__all__ = ["Controller", "Estimator", "Localizer"]


class Localizer(Part):
    """Turns frames into estimates."""

    #: Format of what it keeps in its map. Raise it when an older version could not read that any more: the pipeline
    #: keeps it beside the map, and a localizer is never started on a map of a newer format than its own.
    map_format: ClassVar[int] = 1

    #: True where it tells `Motion` besides something else: where that would count twice, it is unused instead of an
    #: error, and the motion of others counts.
    motion_is_spare: ClassVar[bool] = False

    #: False of one that does not look at the belief, as odometry: nothing is predicted for it, and `observe` is given a
    #: belief of the frame's stamp in which nothing is known.
    uses_belief: ClassVar[bool] = True

    #: False of one that takes frames for a clock: it is asked also where a sensor repeats itself, and is no witness of
    #: whether the robot moves.
    looks_at_frames: ClassVar[bool] = True

    #: True lets `observe` be called before its turn, while the localizers before this one are at work on the picture,
    #: in a thread that calls nothing else of it. For one that does not look at the belief, in step pace.
    begins_early: ClassVar[bool] = False

    @abstractmethod
    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Process a frame of a sensor that the config subscribes to.

        Parameters
        ----------
        frame : Frame
            The frame; its arrays are read-only.
        belief : Belief
            What is believed at the frame's stamp, with the estimates of the localizers before this one (see
            `uses_belief`).

        Returns
        -------
        sequence of Estimate
            Empty: it did not look. `Lost`: it looked and cannot say. It is not asked about a picture or scan that its
            sensor repeats bit by bit while the robot moves; `Lost` stands for its answer.
        """

    #: True where `relate` says how remembered places lie to each other.
    relates_keyframes: ClassVar[bool] = False

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | Lost:
        """Return the pose of base at one keyframe, relative to other keyframes; called at the end of teaching.

        Works from the localizer map alone. It is asked whether a place was seen twice: rather `Lost` than wrong.

        Parameters
        ----------
        known : mapping of int to Pose2
            Places near the guess, by their number in the localizer map, in axes that they share. These, and not those
            that the keyframes were laid with, are to be used.
        keyframe : int
            The number of the one that is asked about.
        guess : Pose2
            Where it is thought to lie, in the same axes.
        covariance : (3, 3) float64
            Of the guess; how far to look.

        Returns
        -------
        Fix or Lost
            Its pose in these axes; `Lost` where it does not fit, or fits in several places.
        """
        return Lost(0.0, f"{type(self).__name__} relates no keyframes")

    def moved(self, keyframe: Keyframe, pose_map_base: Pose2) -> Keyframe:
        """Return a keyframe at another pose, after loops were closed; what its arrays hold in map axes moves too.

        Parameters
        ----------
        keyframe : Keyframe
            As it was added to the localizer map.
        pose_map_base : Pose2
            Where base was when it was laid, as known now.

        Returns
        -------
        Keyframe
            The keyframe at that pose.
        """
        return replace(keyframe, pose_map_base=pose_map_base)

    def health(self) -> str:
        """Return what is wrong with what it sees, or with the map it sees it by; empty where all is well.

        It stands in `Belief.health` under the localizer's name, where the estimator has no word about it. The run asks
        after each estimate that the estimator was given; until then what was said before holds. One that runs beside
        the run (``async``) is asked while it may be at work on the next frame: it returns a text that it keeps.

        Returns
        -------
        str
            A line for people; more than 1000 letters are cut.
        """
        return ""

    def latency_s(self) -> float | None:
        """Return how long the last call takes by the localizer's own model [s]; None: it has none."""
        return None

    def finish(self) -> None:
        """End of teaching: select, train, index; works from the localizer map alone and may be repeated."""


class Estimator(Part):
    """Makes one belief of many estimates, whatever order they come in."""

    #: True when it can integrate the `Motion` of one localizer only: a second one needs ``use``.
    takes_one_motion: ClassVar[bool] = False

    @abstractmethod
    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Take an estimate of a localizer and say what became of it.

        The estimate may be about a past stamp: the estimator keeps a history and replays it.

        Parameters
        ----------
        source : str
            Name of the localizer.
        estimate : Estimate
            What it said; its information may be malformed.

        Returns
        -------
        Applied
            ``accepted``, ``gated``, ``late``, ``refused`` or ``unused``, and why.
        """

    @abstractmethod
    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: interpolated in the history, or predicted beyond it.

        None asks for the newest stamp it has heard of.

        Parameters
        ----------
        stamp_s : float or None
            The instant [s]; None: the newest stamp that the estimator has been given.

        Returns
        -------
        Belief
            Pose, covariance, twist and ages at that stamp.
        """

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: npt.NDArray[np.float64] | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Take a pose of base from a person or a program that knows it, in place of the belief.

        Parameters
        ----------
        pose_map_base : Pose2
            Base in the map.
        covariance : (3, 3) float64, optional
            Of (x, y, theta); left out, that of a known start.
        stamp_s : float, optional
            When; left out, at the newest stamp heard of [s].

        Returns
        -------
        Applied
            ``accepted``; ``late``, if it is about an instant older than the history; or why it is ``refused``. An
            estimator that cannot be told a pose, which is the default, refuses.

        Raises
        ------
        ShapeError
            If the covariance is not (3, 3).
        """
        return Applied("refused", f"{type(self).__name__} cannot be told a pose")


class Controller(Part):
    """Turns beliefs into commands. Path, goal and direction come with the session and the config."""

    @property
    @abstractmethod
    def gives(self) -> frozenset[type[Command]]:
        """The commands it may give."""

    def remedy_for(self, accepts: frozenset[type[Command]]) -> str:
        """Return what to change in the config so that a robot understands it; empty: another controller is needed.

        Parameters
        ----------
        accepts : frozenset of type
            The commands that the robot takes (`Drivable.accepts`), which are not those that it `gives`.
        """
        return ""

    @abstractmethod
    def step(self, belief: Belief) -> Command:
        """Return the command for a belief that is predicted to now.

        Parameters
        ----------
        belief : Belief
            The belief, predicted to the instant of the call.

        Returns
        -------
        Command
            One of the kinds in `gives`; ``Stop(done=True)`` ends the run.
        """
