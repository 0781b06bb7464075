"""Trajectories: poses over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry.notebook import pandas_module, plane_axes, way_svg
from trailmark.geometry.se2 import Pose2, wrap_angles

__all__ = ["FARTHEST_M", "Trajectory"]

#: No robot is farther from the origin of its map; of squares and sums of what is no digits are left, or they overflow.
FARTHEST_M = 1e12


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory:
    """Poses of one body over time, at strictly increasing stamps.

    Attributes
    ----------
    stamps_s : (N,) float64
        Stamps, strictly increasing [s].
    poses : (N, 3) float64
        x, y, theta of each pose; theta in [-pi, pi) [m, m, rad].

    Raises
    ------
    ShapeError
        If lengths or shapes do not fit.
    ValueError
        If a number is not finite or the stamps do not increase; the message names the index.
    """

    stamps_s: Floats
    poses: Floats

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps_s, dtype=np.float64)
        poses = (
            np.array(self.poses, dtype=np.float64).reshape(-1, 3) if len(stamps) == 0 else np.array(self.poses, float)
        )
        if stamps.ndim != 1 or poses.shape != (len(stamps), 3):
            raise ShapeError(f"stamps {stamps.shape} and poses {poses.shape} must be (N,) and (N, 3)")
        _check_finite_and_increasing(stamps, poses)
        poses[:, 2] = wrap_angles(poses[:, 2])
        stamps.flags.writeable = False
        poses.flags.writeable = False
        object.__setattr__(self, "stamps_s", stamps)
        object.__setattr__(self, "poses", poses)

    @classmethod
    def from_poses(cls, stamped: Iterable[tuple[float, Pose2]]) -> Trajectory:
        """Return the trajectory of (stamp_s, pose) pairs."""
        rows = [(stamp_s, pose.x, pose.y, pose.theta) for stamp_s, pose in stamped]
        array = np.array(rows, dtype=np.float64).reshape(-1, 4)
        return cls(array[:, 0], array[:, 1:])

    def __repr__(self) -> str:
        if not len(self):
            return "Trajectory(no poses)"
        first_s, last_s = self.stamps_s[[0, -1]]
        return f"Trajectory({len(self)} poses, {first_s:.6g} to {last_s:.6g} s, {self.length_m():.4g} m)"

    def __len__(self) -> int:
        return len(self.stamps_s)

    def __getitem__(self, index: int) -> tuple[float, Pose2]:
        return float(self.stamps_s[index]), Pose2.from_array(self.poses[index])

    def __iter__(self) -> Iterator[tuple[float, Pose2]]:
        return (self[index] for index in range(len(self)))

    @property
    def positions(self) -> Floats:
        """Positions, (N, 2) [m]."""
        return self.poses[:, :2]

    @property
    def headings(self) -> Floats:
        """Headings, (N,) in [-pi, pi) [rad]."""
        return self.poses[:, 2]

    def length_m(self) -> float:
        """Return the length of the way [m]."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())

    def travelled_m(self) -> Floats:
        """Return the way from the start to each pose, (N,) [m]."""
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        return np.concatenate([np.zeros(min(1, len(self))), np.cumsum(steps)])

    def at(self, stamps_s: npt.ArrayLike) -> Trajectory:
        """Return the trajectory interpolated at other stamps (straight lines, shortest turns).

        Parameters
        ----------
        stamps_s : (M,) float
            Strictly increasing stamps inside ``[stamps_s[0], stamps_s[-1]]`` [s].

        Raises
        ------
        ValueError
            If a stamp lies outside: a trajectory is never extrapolated.
        """
        wanted = np.asarray(stamps_s, dtype=np.float64)
        if len(wanted) == 0:
            return Trajectory(wanted, np.empty((0, 3)))
        if len(self) == 0 or wanted[0] < self.stamps_s[0] or wanted[-1] > self.stamps_s[-1]:
            span = "is empty" if len(self) == 0 else f"covers {self.stamps_s[0]:.6f} to {self.stamps_s[-1]:.6f} s"
            raise ValueError(f"trajectory {span}; asked for {wanted[0]:.6f} to {wanted[-1]:.6f} s")
        unwrapped = np.unwrap(self.headings)
        columns = [np.interp(wanted, self.stamps_s, column) for column in (*self.positions.T, unwrapped)]
        return Trajectory(wanted, np.stack(columns, axis=1))

    def between(self, start_s: float, stop_s: float) -> Trajectory:
        """Return the part with stamps in ``[start_s, stop_s]`` [s]."""
        inside = (self.stamps_s >= start_s) & (self.stamps_s <= stop_s)
        return Trajectory(self.stamps_s[inside], self.poses[inside])

    def transformed(self, pose_new_old: Pose2) -> Trajectory:
        """Return the same way in another frame: every pose becomes ``pose_new_old @ pose``."""
        positions = pose_new_old @ np.ascontiguousarray(self.positions)
        headings = self.headings + pose_new_old.theta
        return Trajectory(self.stamps_s, np.column_stack([positions, headings]))

    def to_frame(self) -> Any:
        """Return a pandas.DataFrame: columns ``x``, ``y``, ``theta`` [m, m, rad], index ``stamp_s``.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        columns = {"x": self.poses[:, 0], "y": self.poses[:, 1], "theta": self.poses[:, 2]}
        pandas = pandas_module()
        return pandas.DataFrame(columns, index=pandas.Index(self.stamps_s, name="stamp_s"))

    def plot(self, axes: Any = None, **style: Any) -> Any:
        """Draw the way in the plane and return the axes.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Where; default: the current ones of pyplot, as in a notebook.
        **style
            As of ``Axes.plot``: ``color``, ``label``.
        """
        axes = plane_axes(axes)
        axes.plot(*self.positions.T, **style)
        return axes

    def _repr_html_(self) -> str:
        """Return a small table of the first and the last pose and a sketch of the way, for notebooks."""
        ends = {"first": 0, "last": -1} if len(self) else {}
        rows = "".join(_row_html(end, float(self.stamps_s[k]), self.poses[k]) for end, k in ends.items())
        head = "".join(f"<th>{name}</th>" for name in ("", "stamp [s]", "x [m]", "y [m]", "theta [rad]"))
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if rows else ""
        return f"<p>{self!r}</p>{table}{way_svg(self.positions)}"


def _row_html(end: str, stamp_s: float, pose: Floats) -> str:
    cells = (end, *(f"{value:.3f}" for value in (stamp_s, *pose)))
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _check_finite_and_increasing(stamps: Floats, poses: Floats) -> None:
    bad = np.flatnonzero(~(np.isfinite(stamps) & np.isfinite(poses).all(axis=1)))
    if len(bad):
        raise ValueError(f"trajectory pose {bad[0]} is not finite: t={stamps[bad[0]]}, {poses[bad[0]]}")
    back = np.flatnonzero(np.diff(stamps) <= 0.0)
    if len(back):
        first = int(back[0])
        raise ValueError(
            f"trajectory stamps must increase, but pose {first + 1} has {stamps[first + 1]:.9f} s"
            f" after {stamps[first]:.9f} s"
        )
