"""A set of weighted poses: moved, weighed, drawn anew, and told as clusters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from trailmark.arrays import Floats, Indices, Int64s
from trailmark.geometry import Pose2, wrap_angles

__all__ = ["Cluster", "MotionNoise", "Particles", "kld_count"]

_BIN_M, _BIN_RAD = 0.25, math.radians(10.0)
#: Bins whose middles are no farther apart than this belong to one cluster; a turn of 1 rad counts as 1.4 m.
_JOINED_M, _M_PER_RAD = 0.6, 1.4


@dataclass(frozen=True, slots=True)
class MotionNoise:
    """How wrong odometry may be, as shares of what it tells (Thrun et al. 2005, Sec. 5.4) and per second.

    Attributes
    ----------
    along, across : float
        Standard deviation of a step along and across its direction, for each metre [1].
    turn_per_m, turn_per_rad : float
        Standard deviation of the heading [rad/m, 1].
    rest_m, rest_rad : float
        What every step adds [m, rad].
    """

    along: float = 0.1
    across: float = 0.03
    turn_per_m: float = math.radians(3.0)
    turn_per_rad: float = 0.1
    rest_m: float = 0.003
    rest_rad: float = math.radians(0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Particles near each other.

    Attributes
    ----------
    share : float
        Of the weight.
    mean : (3,) float64
        Pose [m, m, rad].
    covariance : (3, 3) float64
        Of (x, y, theta).
    """

    share: float
    mean: Floats
    covariance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Particles:
    """Poses (N, 3) in grid axes and their weights (N,), which sum to one."""

    poses: Floats
    weights: Floats

    @classmethod
    def even(cls, poses: Floats) -> Particles:
        """Return poses of equal weight."""
        return cls(poses, np.full(len(poses), 1.0 / len(poses)))

    @classmethod
    def around(cls, pose: Floats, covariance: Floats, count: int, rng: np.random.Generator) -> Particles:
        """Return particles drawn about a pose."""
        return cls.even(pose + rng.standard_normal((count, 3)) @ np.linalg.cholesky(covariance).T)

    def __len__(self) -> int:
        return len(self.poses)

    def moved(self, step: Pose2, noise: MotionNoise, rng: np.random.Generator) -> Particles:
        """Return them after a step of base in its own axes, each with an error of its own."""
        way_m, turn_rad = math.hypot(step.x, step.y), abs(step.theta)
        towards = math.atan2(step.y, step.x)
        drawn = rng.standard_normal((len(self), 3))
        along = way_m + math.hypot(noise.along * way_m, noise.rest_m) * drawn[:, 0]
        across = math.hypot(noise.across * way_m, noise.rest_m) * drawn[:, 1]
        sigma_rad = math.hypot(noise.turn_per_m * way_m, noise.turn_per_rad * turn_rad, noise.rest_rad)
        direction = self.poses[:, 2] + towards
        cos, sin = np.cos(direction), np.sin(direction)
        poses = np.stack(
            [
                self.poses[:, 0] + cos * along - sin * across,
                self.poses[:, 1] + sin * along + cos * across,
                self.poses[:, 2] + step.theta + sigma_rad * drawn[:, 2],
            ],
            axis=1,
        )
        return Particles(poses, self.weights)

    def weighed(self, log_likelihoods: Floats) -> Particles:
        """Return them with their weights multiplied by likelihoods, given as logarithms (N,)."""
        with np.errstate(divide="ignore"):
            logs = np.log(self.weights) + log_likelihoods
        weights = np.exp(logs - logs.max())
        return Particles(self.poses, weights / weights.sum())

    @property
    def effective_count(self) -> float:
        """How many of equal weight they are worth."""
        return float(1.0 / np.square(self.weights).sum())

    def resampled(self, fewest: int, most: int, rng: np.random.Generator) -> Particles:
        """Return as many as their spread asks for (Fox 2003, KLD sampling), drawn systematically, of equal weight."""
        first = self.poses[self._draw(min(len(self), most), rng)]
        count = min(max(kld_count(len(np.unique(_bins(first)))), fewest), most)
        return Particles.even(self.poses[self._draw(count, rng)])

    def _draw(self, count: int, rng: np.random.Generator) -> Indices:
        places = (np.arange(count) + rng.random()) / count
        return np.minimum(np.searchsorted(np.cumsum(self.weights), places), len(self) - 1)

    def clusters(self) -> list[Cluster]:
        """Return groups of particles that hang together, the heaviest first."""
        keys, first, bin_of = np.unique(_bins(self.poses), return_index=True, return_inverse=True)
        x, y, theta = (self.poses[first, axis] for axis in range(3))
        places = np.stack([x, y, _M_PER_RAD * np.cos(theta), _M_PER_RAD * np.sin(theta)], axis=1)
        pairs = cKDTree(places).query_pairs(_JOINED_M, output_type="ndarray")
        joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(keys), len(keys)))
        _, group_of_bin = connected_components(joined, directed=False)
        group = group_of_bin[bin_of]
        shares = np.bincount(group, weights=self.weights)
        return [self._cluster(group == number) for number in np.argsort(-shares, kind="stable")[:20]]

    def _cluster(self, chosen: np.ndarray) -> Cluster:
        weights, poses = self.weights[chosen], self.poses[chosen]
        share = float(weights.sum())
        weights = weights / max(share, 1e-300)
        heading = math.atan2(float(weights @ np.sin(poses[:, 2])), float(weights @ np.cos(poses[:, 2])))
        mean = np.array([weights @ poses[:, 0], weights @ poses[:, 1], heading])
        errors = poses - mean
        errors[:, 2] = wrap_angles(errors[:, 2])
        return Cluster(share, mean, (errors * weights[:, np.newaxis]).T @ errors)


def kld_count(n_bins: int, error: float = 0.05, quantile: float = 2.326) -> int:
    """Return how many samples keep a histogram of `n_bins` within `error` of the truth (Fox 2003, Eq. 7).

    Parameters
    ----------
    n_bins : int
        Bins that hold a sample.
    error : float
        Kullback-Leibler divergence.
    quantile : float
        Of the standard normal distribution; 2.326 is that of 99 %.
    """
    if n_bins <= 1:
        return 1
    freedom = n_bins - 1
    spread = 2.0 / (9.0 * freedom)
    return math.ceil(freedom / (2.0 * error) * (1.0 - spread + math.sqrt(spread) * quantile) ** 3)


def _bins(poses: Floats) -> Int64s:
    """Return a number for the bin of each pose, (N,)."""
    columns = np.floor(poses[:, 0] / _BIN_M).astype(np.int64)
    rows = np.floor(poses[:, 1] / _BIN_M).astype(np.int64)
    turns = np.floor((poses[:, 2] % (2.0 * math.pi)) / _BIN_RAD).astype(np.int64)
    return np.asarray((columns * (1 << 20) + rows) * 64 + turns, np.int64)
