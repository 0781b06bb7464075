"""From frames to looks and windows: what teaching and replaying have in common."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Float32s
from trailmark.estimates import Belief
from trailmark.geometry import wrap_angle
from trailmark.patches import PATCH_PX, SMALL_PX, small_picture
from trailmark_divs.config import DivsConfig
from trailmark_divs.difference import column_means
from trailmark_divs.layout import ColumnLayout
from trailmark_divs.stream import ChangeStream
from trailmark_divs.turning import TurnGate, turned_columns

__all__ = ["TURNING", "DifferenceWindow", "ImagePreprocessor", "Look", "clear_pixels"]

#: Run number of what was seen while turning.
TURNING = -1

_MOST_TURN_COLUMNS = 6  # between two pictures
_RECENT_WINDOWS = 4  # a way that was winding will wind again
_OVER_EXPOSED, _MOST_BRIGHT, _GLOW_PX = 250, 0.1, 5  # grey level, share of a small pixel, its surroundings [px]
_ROUNDING_RAD = 1e-6  # an estimator that was never told of a turn may still turn by rounding


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One picture of the stream and its difference to the one before.

    Attributes
    ----------
    ordinal : int
        0, 1, 2, ... since the start.
    run : int
        Counts the straight pieces between turns; `TURNING` in a turn.
    sums : (d,) int64
        Changed pixels in each column.
    profile : (d,) float64
        Mean brightness of each column of the newer picture [grey levels].
    stamps_s : (float, float)
        Of the older and the newer picture [s].
    travelled_m : (float, float)
        Way driven until each [m].
    heading_rad : float
        Turn since the start by motion alone, not wrapped, at the newer picture [rad].
    small : (h, w) float32
        The newer picture, small and normalised by patches; empty where pictures are not compared.
    clear : (h, w) bool
        Which of its pixels are not over-exposed; empty where pictures are not compared.
    """

    ordinal: int
    run: int
    sums: npt.NDArray[np.int64]
    profile: npt.NDArray[np.float64]
    stamps_s: tuple[float, float]
    travelled_m: tuple[float, float]
    heading_rad: float
    small: Float32s = field(default_factory=lambda: np.empty((0, 0), np.float32))
    clear: Bools = field(default_factory=lambda: np.empty((0, 0), np.bool_))


@dataclass(frozen=True, slots=True, eq=False)
class DifferenceWindow:
    """A full window of differences; its stamp and station are those of its middle.

    Attributes
    ----------
    ordinal : int
        Of its newest look.
    vector : (d,) float64
        Change vector.
    stamp_s, travelled_m, heading_rad : float
        Of its middle [s, m, rad].
    """

    ordinal: int
    vector: npt.NDArray[np.float64]
    stamp_s: float
    travelled_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class _TimedPicture:
    stamp_s: float
    travelled_m: float
    odom_rad: float
    profile: npt.NDArray[np.float64]


class ImagePreprocessor:
    """Takes the pictures of the stream, notices turns, and keeps the window.

    Parameters
    ----------
    config : DivsConfig
        Config.
    layout : ColumnLayout
        Region and columns of the camera's pictures.
    radians_per_column : float
        Angle of a column, for turns seen in pictures [rad].
    """

    def __init__(self, config: DivsConfig, layout: ColumnLayout, radians_per_column: float) -> None:
        self._config = config
        self._layout = layout
        self._radians_per_column = radians_per_column
        self._stream = ChangeStream(layout, config.window, config.threshold, config.average, config.keep_change_image)
        self._gate = TurnGate(math.radians(config.turn_limit_deg), config.window)
        self._middles = np.empty((config.window, 3))  # stamp, way and heading of each difference in the window
        mask = layout.mask  # patches at its edge would show the edge
        self._inside = None if mask is None else (_reduce_mask(mask) == 255).astype(np.float32)
        self._swing: deque[float] = deque(maxlen=_RECENT_WINDOWS * config.window)
        self._picture: _TimedPicture | None = None
        self._look: Look | None = None
        self._belief_turns = config.turn_source == "belief"
        self._n_looks = 0
        self._n_runs = 0
        self._is_turning = False
        self._heading_rad = 0.0

    @property
    def are_turns_measured(self) -> bool:
        """True when the belief has turns; see `turn_source`."""
        return self._belief_turns

    def look(self, grey: npt.NDArray[np.uint8], stamp_s: float, belief: Belief) -> Look | None:
        """Take a picture of the stream; None for the first, which has nothing to differ from.

        Parameters
        ----------
        grey : (rows, width) uint8
            Region of interest.
        stamp_s : float
            When it was taken [s].
        belief : Belief
            What is believed then; its way and heading from motion alone are used.
        """
        sums = self._stream.push(grey)
        profile = column_means(self._stream.newest, self._layout.area, self._layout.column_px)
        before = self._picture
        now = self._picture = _TimedPicture(stamp_s, belief.travelled_m, belief.pose_odom_base.theta, profile)
        if sums is None or before is None:
            return None
        step_rad = wrap_angle(now.odom_rad - before.odom_rad)
        self._heading_rad += step_rad
        turn_rad = self._turn(before, now, belief)
        self._swing.append((self._swing[-1] if self._swing else 0.0) + turn_rad)
        self._gate_turn(turn_rad)
        if not self._is_turning:
            middle = (before.stamp_s + stamp_s) / 2, (before.travelled_m + now.travelled_m) / 2
            self._middles[self._n_looks % len(self._middles)] = *middle, self._heading_rad - step_rad / 2
        run = TURNING if self._is_turning else self._n_runs
        stamps_s, travelled_m = (before.stamp_s, stamp_s), (before.travelled_m, now.travelled_m)
        is_compared = self._config.when_blind == "pictures"
        small = small_picture(grey) if is_compared else np.empty((0, 0), np.float32)
        if is_compared and self._inside is not None:
            small *= self._inside
        clear = clear_pixels(grey) if is_compared else np.empty((0, 0), np.bool_)
        self._look = Look(self._n_looks, run, sums, profile, stamps_s, travelled_m, self._heading_rad, small, clear)
        self._n_looks += 1
        return self._look

    @property
    def bend_columns(self) -> float:
        """How far the view has swung to and fro of late, by the belief or by what pictures show [columns]."""
        return float(np.ptp(self._swing)) / self._radians_per_column if len(self._swing) else 0.0

    def window(self) -> DifferenceWindow | None:
        """Return the window; None while turning and until it is full again."""
        if self._look is None or self._is_turning or not self._stream.is_full:
            return None
        stamp_s, travelled_m, heading_rad = self._middles.mean(axis=0).tolist()
        return DifferenceWindow(self._look.ordinal, self._stream.vector(), stamp_s, travelled_m, heading_rad)

    def change_image(self) -> npt.NDArray[np.float32]:
        """Return the change image of the window so far; see `ChangeStream.change_image`."""
        return self._stream.change_image()

    def _turn(self, before: _TimedPicture, now: _TimedPicture, belief: Belief) -> float:
        """Return the turn between two pictures, by the belief or by what they show [rad]."""
        config = self._config
        step_rad = wrap_angle(now.odom_rad - before.odom_rad)
        if config.turn_source == "auto" and max(abs(step_rad), abs(belief.twist.yaw_radps)) > _ROUNDING_RAD:
            self._belief_turns = True  # something on this robot measures turns
        if self._belief_turns:
            return step_rad
        reach = min(_MOST_TURN_COLUMNS, config.columns - config.correlation_window)
        usable = self._layout.usable
        columns = turned_columns(before.profile, now.profile, usable, config.correlation_window, reach)
        return columns * self._radians_per_column

    def _gate_turn(self, step_rad: float) -> None:
        was_turning, self._is_turning = self._is_turning, self._gate.push(step_rad)
        if self._is_turning:
            self._stream.restart()
        elif was_turning:  # a new "time zero"
            self._n_runs += 1


def clear_pixels(grey: npt.NDArray[np.uint8]) -> Bools:
    """Return which pixels of the small picture are neither over-exposed nor next to one that is, (h, w)."""
    import cv2

    bright = cv2.resize((grey >= _OVER_EXPOSED).astype(np.float32), SMALL_PX, interpolation=cv2.INTER_AREA)
    side = np.ones((_GLOW_PX, _GLOW_PX), np.uint8)
    return np.asarray(cv2.dilate((bright > _MOST_BRIGHT).astype(np.uint8), side) == 0, np.bool_)


def _reduce_mask(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    import cv2

    whole = cv2.resize(mask, SMALL_PX, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.erode(whole, np.ones((PATCH_PX, PATCH_PX), np.uint8)), np.uint8)
