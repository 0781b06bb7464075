"""Does `odometry` by itself say the truth about its errors, on recordings of real robots?

Its motions are compared with the truth of each recording as a bench does it: squared errors in units of the stated
covariance a degree of freedom (1 is right), and the share that is silently wrong (more than five sigmas and more than
0.5 mm or 0.05 deg), of single motions and of those chained over a second and over a metre.

- MRCLAM: five iRobot Create, truth of motion capture;
- Intel, Freiburg: CARMEN logs, poses corrected by SLAM at each scan;
- ACES: relations between scans that were laid by hand, as one motion each;
- Plaza 1, 2: a lawn mower, differential GPS, whose way is told in steps.

Defaults were chosen on those marked `choose`; the others are to report on.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/wheels_honest.py [choose report] [--set KEY=VALUE ...]
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from mrclam import wheels
from scipy.io import loadmat

import trailmark
from trailmark.arrays import Floats
from trailmark.estimates import Belief, Motion
from trailmark.evaluation.chaining import chain_windows, covariances_of, windows
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.evaluation.relative import between
from trailmark.evaluation.silent import FLOORS, are_silently_wrong
from trailmark.frames import Frame, Odometry
from trailmark.geometry import Pose2, Trajectory, wrap_angles
from trailmark.interfaces import Session

DATA = Path(os.environ.get("TRAILMARK_DATA", "../shared/data"))


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Readings of wheels, and what is known of the motion between two stamps, NaN where it is not, (N, 3).

    Where the truth is sparser than the readings, motions are joined between its stamps `known_s`: what lies between two
    of them is no truth.
    """

    readings: list[tuple[float, Odometry]]
    true_motion: Callable[[Floats, Floats], Floats]
    known_s: Floats | None = None


@dataclass(frozen=True, slots=True)
class Honesty:
    """How motions of one length agree with what they claim."""

    n: int
    nees: float
    silent: float


def of_source(config: dict[str, object], *, is_sparse: bool = False) -> Recording:
    """Return a recording that a source reads, with its truth."""
    name = str(config.pop("plugin"))
    source = trailmark.create("source", name, **config)
    source.start(Session())
    readings = [(f.stamp_s, f.payload) for f in source.frames() if isinstance(f.payload, Odometry)]
    truth = source.ground_truth()
    source.close()
    assert truth is not None
    return Recording(readings, partial(_between_true, truth), truth.stamps_s if is_sparse else None)


def _between_true(truth: Trajectory, since_s: Floats, stamp_s: Floats) -> Floats:
    return np.asarray(between(true_poses(truth, since_s), true_poses(truth, stamp_s)))


def carmen(name: str) -> Recording:
    """Return a log whose scans have corrected poses."""
    path = DATA / "omni" / "laser2d_carmen" / f"{name}-corrected.log.gz"
    return of_source({"plugin": "carmen_log", "path": path, "on_bad_frame": "skip"}, is_sparse=name == "intel")


def aces() -> Recording:
    """Return the odometry of ACES and its relations: only of neighbouring scans there is a motion to compare."""
    source = trailmark.create("source", "carmen_log", path=DATA / "laser" / "aces.clf.bz2", scan_poses="odometry")
    source.start(Session())
    readings = [(f.stamp_s, f.payload) for f in source.frames() if isinstance(f.payload, Odometry)]
    source.close()
    table = np.loadtxt(DATA / "laser" / "aces.relations")
    known = {(round(row[0], 6), round(row[1], 6)): row[[2, 3, 7]] for row in table}
    nothing = np.full(3, np.nan)

    def true_motion(since_s: Floats, stamp_s: Floats) -> Floats:
        pairs = zip(np.round(since_s, 6), np.round(stamp_s, 6))
        return np.array([known.get(pair, nothing) for pair in pairs])

    stamps = np.unique([stamp for pair in known for stamp in pair])
    way = Trajectory.from_poses([(at, pose) for at, one in readings if (pose := one.pose_start_base) is not None])
    inside = np.setdiff1d(stamps[(stamps > way.stamps_s[0]) & (stamps < way.stamps_s[-1])], way.stamps_s)
    at_scans = [(at, Odometry(pose)) for at, pose in way.at(inside)]  # scans are taken between two readings
    return Recording(sorted(readings + at_scans, key=lambda one: one[0]), true_motion, stamps)


def plaza(number: int) -> Recording:
    """Return a mower's steps (distance, turn) joined to poses, and its course over ground."""
    steps = np.loadtxt(DATA / "uwb" / f"Plaza{number}_DR.txt.gz")
    truth = loadmat(DATA / "uwb" / f"Plaza{number}_.mat")["GT"][:, :4]
    pose, readings = Pose2(), [(float(truth[0, 0]), Odometry(Pose2()))]
    for stamp_s, distance_m, turn_rad in steps:
        pose = pose @ Pose2.exp(float(distance_m), 0.0, float(turn_rad))
        if stamp_s > readings[-1][0]:
            readings.append((float(stamp_s), Odometry(pose)))
    headings = truth[:, 3] + (math.pi if number == 2 else 0.0)  # told backwards
    trajectory = Trajectory(truth[:, 0], np.column_stack([truth[:, 1:3], wrap_angles(headings)]))
    return Recording(readings, partial(_between_true, trajectory))


RECORDINGS: dict[str, dict[str, Callable[[], Recording]]] = {
    "choose": {
        **{f"mrclam {n}": partial(lambda n: of_source(wheels(DATA / "fusion/mrclam_D6", n)), n) for n in (1, 2)},
        "intel": partial(carmen, "intel"),
        "plaza 1": partial(plaza, 1),
    },
    "report": {
        **{f"mrclam {n}": partial(lambda n: of_source(wheels(DATA / "fusion/mrclam_D6", n)), n) for n in (3, 4, 5)},
        "freiburg 079": partial(carmen, "freiburg-079"),
        "aces": aces,
        "plaza 2": partial(plaza, 2),
    },
}


def motions_of(recording: Recording, keys: dict[str, object]) -> list[Motion]:
    """Return what the localizer tells of the readings."""
    localizer = trailmark.create("localizer", "odometry", wheels="wheels", **keys)
    localizer.start(Session())
    said = []
    for stamp_s, reading in recording.readings:
        estimates = localizer.observe(Frame("wheels", stamp_s, reading), Belief(stamp_s))
        said += [estimate for estimate in estimates if isinstance(estimate, Motion)]
    return said


def judge(motions: Sequence[Motion], recording: Recording) -> Iterator[tuple[str, Honesty]]:
    """Yield how single motions and those chained over a second and over metres agree with what they claim."""
    since, stamp = (np.array([getattr(one, name) for one in motions]) for name in ("since_s", "stamp_s"))
    steps = np.array([one.pose_since_now.array() for one in motions])
    own = covariances_of(np.array([one.information for one in motions]))
    if recording.known_s is not None:
        pieces = list(_between_known(since, stamp, recording.known_s))
        steps, own, first, last = chain_windows(steps, own, pieces)
        since, stamp = since[first], stamp[last]
    yield "single", _honesty(steps.copy(), own, recording.true_motion(since, stamp))
    ways = np.hypot(steps[:, 0], steps[:, 1])
    for name, lengths, length in (("1 s", stamp - since, 1.0), *((f"{m} m", ways, float(m)) for m in (1, 10, 100))):
        pieces = list(windows(since, stamp, lengths, length))
        chained, spreads, first, last = chain_windows(steps, own, pieces)
        found = _honesty(chained, spreads, recording.true_motion(since[first], stamp[last])) if len(chained) else None
        if found is not None and found.n:
            yield name, found


def _between_known(since_s: Floats, stamp_s: Floats, known_s: Floats) -> Iterator[tuple[int, int]]:
    """Yield ``(first, behind)`` of the motions that lead from one known stamp to the next."""
    ends = np.concatenate([since_s[:1], stamp_s])
    at = np.searchsorted(known_s, ends - 1e-6)
    is_known = np.abs(known_s[np.minimum(at, len(known_s) - 1)] - ends) < 1e-6
    for first, behind in pairwise(np.flatnonzero(is_known)):
        if np.allclose(since_s[first + 1 : behind], stamp_s[first : behind - 1], atol=1e-6):
            yield int(first), int(behind)


def _honesty(steps: Floats, covariances: Floats, true: Floats) -> Honesty:
    errors = steps - true
    errors[:, 2] = wrap_angles(errors[:, 2])
    known = np.isfinite(errors).all(axis=1)
    errors, covariances = errors[known], covariances[known]
    if not len(errors):
        return Honesty(0, math.nan, math.nan)
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors) / 3.0
    return Honesty(
        len(errors), float(nees.mean()), float(are_silently_wrong(errors, covariances, FLOORS["motion"]).mean())
    )


def main() -> None:
    """Print a row for each recording and length."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("which", nargs="*", default=list(RECORDINGS), metavar="choose|report")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", dest="keys")
    options = parser.parse_args()
    keys: dict[str, object] = {key: float(value) for key, _, value in (one.partition("=") for one in options.keys)}
    print("| recording | length | n | NEES / dof | silent |\n| --- | --- | ---: | ---: | ---: |")
    for which in options.which:
        for name, read in RECORDINGS[which].items():
            recording = read()
            for length, found in judge(motions_of(recording, keys), recording):
                print(
                    f"| {name} ({which}) | {length} | {found.n} | {found.nees:.3g} | {found.silent:.2%} |", flush=True
                )


if __name__ == "__main__":
    main()
