"""Where on a taught path the robot was put down: all places are tried before one is believed.

Ground may look the same in two places (printed laminate, tiles, a carpet's pattern). A place that fits is therefore
only a guess; guesses are carried along by odometry and compared in the same picture, by all patches that it shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from trailmark.geometry import Pose2

__all__ = ["Guess", "GuessVerdict", "StartSearch"]

#: Guesses nearer to one another than this are one: two patches that the same picture shows [m].
_SAME_M = 0.02

#: More guesses than this are no guesses: the ground looks the same everywhere.
_MOST = 64


@dataclass(slots=True)
class Guess:
    """A place where the robot may be.

    Attributes
    ----------
    pose_map_odom : Pose2
        Where odometry's origin then lies: it stays the same while the robot drives.
    since_m : float
        Way that the robot had driven when the guess was made [m].
    n_missed : int
        Pictures in a row that showed its ground, but not as taught.
    misfit : float
        As in the verdict on the last picture that showed its ground.
    """

    pose_map_odom: Pose2
    since_m: float
    n_missed: int = 0
    misfit: float = 1.0


@dataclass(frozen=True, slots=True)
class GuessVerdict:
    """How well a guess fits to a picture.

    Attributes
    ----------
    guess : Guess
        The guess.
    n_seen, n_found : int
        Patches that the picture would show, and those that it does show, where they should be.
    misfit : float
        Share of their variance that the picture does not explain, 1 - correlation^2, mean of all patches; a patch that
        was not found counts 1.
    """

    guess: Guess
    n_seen: int
    n_found: int
    misfit: float

    @property
    def holds(self) -> bool:
        """Most of its patches are where they should be."""
        return 2 * self.n_found > self.n_seen

    @property
    def is_whole(self) -> bool:
        """All of its patches are where they should be."""
        return self.n_found == self.n_seen


@dataclass(slots=True)
class StartSearch:
    """Keeps count of the places that were tried and of the guesses that are left.

    Parameters
    ----------
    n_places : int
        Places that were registered.
    margin : float
        A guess is believed when its misfit is at most this share of any other's.
    patience : int
        Pictures in a row in which a guess may fail.
    n_needed : int
        Patches that a picture must show for a guess to be believed.
    confirm_m : float
        Way over which a guess must have held before it is believed [m].
    """

    n_places: int
    margin: float
    patience: int
    n_needed: int = 1
    confirm_m: float = 0.0
    n_tried: int = 0
    guesses: list[Guess] = field(default_factory=list)

    @property
    def is_through(self) -> bool:
        """Every place was tried."""
        return self.n_tried >= self.n_places

    def next_places(self, n_most: int) -> range:
        """Return the places to try in this picture."""
        first = self.n_tried
        self.n_tried = min(self.n_places, first + n_most)
        return range(first, self.n_tried)

    def add(self, pose_map_base: Pose2, pose_odom_base: Pose2, travelled_m: float) -> None:
        """Take a place that fits as a guess, if it is a new one."""
        here = [guess.pose_map_odom @ pose_odom_base for guess in self.guesses]
        if len(here) < _MOST and all(pose.distance_to(pose_map_base) > _SAME_M for pose in here):
            self.guesses.append(Guess(pose_map_base @ pose_odom_base.inverse(), travelled_m))

    def judge(self, verdicts: Sequence[GuessVerdict], travelled_m: float) -> Guess | None:
        """Return the guess that is beyond doubt; forget those that failed too often, start anew when none is left."""
        for verdict in verdicts:
            if verdict.n_seen > 0:
                verdict.guess.n_missed = 0 if verdict.holds else verdict.guess.n_missed + 1
                verdict.guess.misfit = verdict.misfit
        self.guesses = [guess for guess in self.guesses if guess.n_missed < self.patience]
        if not self.guesses:
            self.n_tried = 0
            return None
        ready = [
            verdict
            for verdict in verdicts
            if verdict.is_whole
            and verdict.n_seen >= self.n_needed
            and travelled_m - verdict.guess.since_m >= self.confirm_m
        ]
        best = min(ready, key=lambda verdict: verdict.misfit, default=None)
        if best is None:
            return None
        rivals = [guess for guess in self.guesses if guess is not best.guess]
        return None if any(best.misfit > self.margin * rival.misfit for rival in rivals) else best.guess
