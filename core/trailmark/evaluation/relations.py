"""Errors of relations between poses: how SLAM without a common frame is compared (Kuemmerle et al. 2009)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark.evaluation.association import INTERVALS, poses_at, usual_interval_s
from trailmark.evaluation.relative import between
from trailmark.geometry import Trajectory

__all__ = ["RelationErrors", "Relations", "read_relations", "relation_errors"]

#: A relation over a longer time closes a loop; those below follow the way [s].
LOOP_S = 30.0
#: What is left out as an outlier: errors beyond so many times the 90th percentile, which is of the honest ones.
_OUTLIERS = 3.0
_COLUMNS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Relations:
    """Poses as seen from other poses, laid by hand on what sensors saw.

    Attributes
    ----------
    from_s, to_s : (R,) float64
        Stamps of the two poses [s].
    poses : (R, 3) float64
        The second pose as seen from the first: x, y, theta [m, m, rad].
    """

    from_s: Floats
    to_s: Floats
    poses: Floats

    def __len__(self) -> int:
        return len(self.from_s)

    @property
    def closes_loop(self) -> Bools:
        """Which of them are more than 30 s apart."""
        return np.asarray(np.abs(self.to_s - self.from_s) > LOOP_S)


@dataclass(frozen=True, slots=True, eq=False)
class RelationErrors:
    """How far a trajectory contradicts relations.

    Attributes
    ----------
    n : int
        Relations there are; those without a pose at both stamps have no error.
    translation_m, rotation_rad : (M,) float64
        Absolute errors [m, rad].
    closes_loop : (M,) bool
        Of which relations.
    """

    n: int
    translation_m: Floats
    rotation_rad: Floats
    closes_loop: Bools

    def document(self) -> dict[str, object]:
        """Return counts and, of all relations, those along the way and those of loops, mean, SD, RMS and largest error.

        Outliers are relations whose translation or rotation is off by more than three times the 90th percentile.
        """
        every = np.ones(len(self.translation_m), dtype=np.bool_)
        return {
            "relations": self.n,
            "covered": len(self.translation_m),
            "all": self._of(every),
            "without_outliers": self._of(~self._is_outlier()),
            "along_the_way": self._of(~self.closes_loop),
            "loops": self._of(self.closes_loop),
        }

    def _is_outlier(self) -> Bools:
        most = [_OUTLIERS * np.percentile(errors, 90.0) for errors in (self.translation_m, self.rotation_rad)]
        return np.asarray((self.translation_m > most[0]) | (self.rotation_rad > most[1]))

    def _of(self, chosen: Bools) -> Mapping[str, float] | None:
        if not chosen.any():
            return None
        found: dict[str, float] = {"n": int(chosen.sum())}
        for name, errors in (
            ("translation_m", self.translation_m),
            ("rotation_deg", np.degrees(self.rotation_rad)),
        ):
            of = errors[chosen]
            found |= {
                f"{name}_mean": float(of.mean()),
                f"{name}_sd": float(of.std()),
                f"{name}_rms": float(np.sqrt(np.mean(of * of))),
                f"{name}_max": float(of.max()),
            }
        return found


def read_relations(path: Path) -> Relations:
    """Read lines ``t1 t2 x y z roll pitch yaw``; `#` begins a comment.

    Raises
    ------
    DataError
        If the file cannot be read, a line has other numbers, or a relation lies outside the plane.
    """
    rows: list[list[float]] = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} holds no relations: it is no text (byte {error.start})") from error
    for number, line in enumerate(lines, 1):
        fields = line.partition("#")[0].split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError as error:
            raise DataError(f"{path}:{number}: expected 8 finite numbers (t1 t2 x y z roll pitch yaw)") from error
        if len(row) != _COLUMNS or not all(math.isfinite(value) for value in row):
            raise DataError(f"{path}:{number}: expected 8 finite numbers (t1 t2 x y z roll pitch yaw)")
        if any(row[4:7]):
            raise DataError(f"{path}:{number}: z, roll and pitch are not zero: relations are of the plane here")
        rows.append(row)
    if not rows:
        raise DataError(f"{path} has no relations")
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])


def relation_errors(
    estimate: Trajectory, relations: Relations, max_difference_s: float | None = None
) -> RelationErrors:
    """Return how far a trajectory contradicts relations: ``inverse(d_ij) @ (inverse(x_i) @ x_j)`` of each.

    No alignment is needed, and an error that is made once counts once, however far the way goes on
    (Kuemmerle, Steder, Dornhege et al., Autonomous Robots 27, 2009, Eq. 3).

    Parameters
    ----------
    estimate : Trajectory
        In any frame.
    relations : Relations
        Their stamps are of the trajectory's clock.
    max_difference_s : float, optional
        How far the nearest pose may be from a relation's stamp; default: as `associate` has it [s].

    Raises
    ------
    DataError
        If the trajectory has no pose at the stamps of any relation.
    """
    tolerance_s = INTERVALS * usual_interval_s(estimate.stamps_s) if max_difference_s is None else max_difference_s
    first, last = (poses_at(estimate, stamps_s, tolerance_s) for stamps_s in (relations.from_s, relations.to_s))
    known = np.isfinite(first[:, 0]) & np.isfinite(last[:, 0])
    if not known.any():
        span = "no poses"
        if len(estimate):
            span = f"{estimate.stamps_s[0]:.3f} to {estimate.stamps_s[-1]:.3f} s"
        raise DataError(
            f"none of {len(relations)} relations ({relations.from_s.min():.3f} to {relations.to_s.max():.3f} s) has a"
            f" pose at both ends; the trajectory covers {span}: are the clocks the same?"
        )
    errors = between(relations.poses[known], between(first[known], last[known]))
    lengths = np.hypot(errors[:, 0], errors[:, 1])
    return RelationErrors(len(relations), lengths, np.abs(errors[:, 2]), relations.closes_loop[known])
