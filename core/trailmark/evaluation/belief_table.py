"""Reading ``beliefs.csv`` of a run: what was believed, with its covariance."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.number_rows import read_number_rows
from trailmark.frames.outlines import Outlines

__all__ = ["BELIEFS_FILE", "OUTLINES_FILE", "BeliefTable", "read_beliefs", "read_outlines"]

BELIEFS_FILE = "beliefs.csv"
OUTLINES_FILE = "outlines.json"

_NUMBERS = ("stamp_s", "x", "y", "theta", "cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt")


@dataclass(frozen=True, slots=True, eq=False)
class BeliefTable:
    """Beliefs of a run, evenly taken over it.

    Attributes
    ----------
    stamps_s : (N,) float64
        In the order in which they came [s].
    poses : (N, 3) float64
        In the map [m, m, rad].
    covariances : (N, 3, 3) float64
        Of the poses, along the axes of the map.
    """

    stamps_s: Floats
    poses: Floats
    covariances: Floats

    def __len__(self) -> int:
        return len(self.stamps_s)

    def as_fixes(self, source: str) -> EstimateTable:
        """Return the beliefs as a localizer would have told them, to be judged alike; those without certainty not."""
        is_whole = np.linalg.eigvalsh(self.covariances)[:, 0] > 0.0
        stamps_s, poses = self.stamps_s[is_whole], self.poses[is_whole]
        unknown = np.full(len(stamps_s), np.nan)
        kind, outcome, reason = (np.full(len(stamps_s), word) for word in ("fix", "accepted", ""))
        information = np.asarray(np.linalg.inv(self.covariances[is_whole]), dtype=np.float64)
        name = np.full(len(stamps_s), source)
        return EstimateTable(
            arrived_s=stamps_s,
            since_s=unknown,
            stamp_s=stamps_s,
            source=name,
            kind=kind,
            outcome=outcome,
            reason=reason,
            numbers=poses,
            information=information,
            nis=unknown,
            dof=unknown,
        )


def read_beliefs(file: Path) -> BeliefTable:
    """Read ``beliefs.csv``; rows that are no numbers, as of a disk that was full, are an error.

    Raises
    ------
    DataError
        If it cannot be read or is no such table.
    """
    rows = read_number_rows(file, _NUMBERS, "a table of beliefs")
    table = np.array(rows, dtype=np.float64).reshape(-1, len(_NUMBERS))
    table = table[np.isfinite(table).all(axis=1)]
    return BeliefTable(table[:, 0], table[:, 1:4], table[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3))


def read_outlines(file: Path) -> Outlines:
    """Read ``outlines.json``: what stood around the robot, and its own outline.

    Raises
    ------
    DataError
        If it cannot be read or is no such document.
    """
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        around = tuple(np.array(line, dtype=np.float64).reshape(-1, 2) for line in document["around"])
        robot = document.get("robot")
        return Outlines(around, None if robot is None else np.array(robot, dtype=np.float64).reshape(-1, 2))
    except OSError as error:
        raise DataError(f"cannot read {file}: {error.strerror or error}") from error
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise DataError(f"{file} holds no outlines: around is to be a list of lines, each of points [x, y]") from error
