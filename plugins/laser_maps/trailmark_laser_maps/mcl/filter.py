"""Monte Carlo localization on a grid: find a place, follow it, and know when it is neither."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median

import numpy as np

from trailmark.arrays import Floats
from trailmark_laser_maps.mcl.field import GridField
from trailmark_laser_maps.mcl.hypotheses import (
    RankedPlaces,
    ScanLook,
    Search,
    best_of_each_neighbourhood,
    is_elsewhere,
    moved_by,
)
from trailmark_laser_maps.mcl.kernels import count_agreeing, score_poses
from trailmark_laser_maps.mcl.map_error import MapError
from trailmark_laser_maps.mcl.particles import Cluster, MotionNoise, Particles

__all__ = ["FilterSettings", "GridFilter", "Placed", "Unplaced"]

#: Rays next to each other err together: so many count, however many there are.
_RAYS_THAT_COUNT = 20.0
_N_TRACKED, _N_RAYS_TRACKED = 2000, 60
#: A ray that so few of the particles agree with is of something that is not in the map.
_AGREE_M, _AGREE_SHARE, _LEAST_USED = 0.3, 0.05, 0.3
_MOVED_M, _MOVED_RAD = 0.05, math.radians(2.0)
_LOOK_M, _LOOK_RAD = 0.3, math.radians(25.0)
_FEWEST_LOOKS = 3
#: What a place leaves unexplained, every other place must leave so many times: people and moved furniture are new
#: everywhere, but on another building's map, or a mirrored one, the best place is hardly better than the next.
_LEFT_BY_RIVALS = 2.5
_N_CANDIDATES = 300
_FRESH_SHARE = 0.3
_SECOND_CLUSTER = 0.05
#: A followed place that explains so much less of a scan than it did lately may be one that looks alike, to which the
#: robot was carried: it is compared with the rest at once, by what is seen now, and not told while patience lasts.
_LEAST_FALL, _FALL_SIGMAS, _USUAL_LOOKS = 0.08, 5.0, 20
#: Who is carried away sees something else from one look to the next: a fall without a step of this share of it is told,
#: it is people or furniture that come into sight.
_AT_ONCE = 0.5
_SIGMA_OVER_MEDIAN = 1.4826
#: Another place that explains so much more of the last metres takes the followed one's seat.
_UNSEATS = 0.05
#: Added to the spread of particles, which may be none in a direction.
_LEAST_SPREAD = 1e-6 * np.eye(3)
_DRAWN_M, _DRAWN_RAD = 0.1, math.radians(2.0)


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """How the filter works; see `GridMclConfig`.

    Attributes
    ----------
    noise : MotionNoise
        Of odometry.
    n_start, n_search, n_fewest, n_most : int
        Poses drawn over the map at the start, and at each scan until a place is found; particles kept, at least and
        at most.
    min_quality : float
        Share of a scan that a followed place must explain; for one that nobody named see `quality_of_found`.
    margin : float
        By how much a place must be better than all others to be believed after one look.
    patience : int
        After so many scans in a row that the place does not explain it is given up.
    recheck_m : float
        Way after which a followed place is compared with the rest of the map again [m].
    """

    noise: MotionNoise = MotionNoise()
    n_start: int = 200_000
    n_search: int = 20_000
    n_fewest: int = 500
    n_most: int = 20_000
    min_quality: float = 0.6
    margin: float = 0.25
    patience: int = 5
    recheck_m: float = 2.0

    @property
    def quality_of_found(self) -> float:
        """Share of the last looks that a place must explain which nobody named: half of what `min_quality` leaves."""
        return (1.0 + self.min_quality) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A place that is believed: pose (3,) and covariance (3, 3) in grid axes, and the share of the scan it explains."""

    pose: Floats
    covariance: Floats
    quality: float


@dataclass(frozen=True, slots=True)
class Unplaced:
    """No place is believed: why, how much of the scan the best explains, and how many places fit as well."""

    reason: str
    quality: float
    n_places: int


class GridFilter:
    """Particles on a map.

    Parameters
    ----------
    field : GridField
        The map.
    settings : FilterSettings
        How it works.
    rng : numpy.random.Generator
        What it draws from.
    """

    def __init__(self, field: GridField, settings: FilterSettings, rng: np.random.Generator) -> None:
        self._field, self._settings, self._rng = field, settings, rng
        self._search = Search(field)
        self._particles: Particles | None = None
        self._hypotheses: Floats = np.empty((0, 3))
        self._favourite: Floats = np.empty((0, 3))
        self._is_believed = False
        self._n_unexplained = 0
        self._last: ScanLook | None = None
        self._unchecked_m = 0.0
        self._usual: deque[float] = deque(maxlen=_USUAL_LOOKS)  # what the followed place explained lately
        self._fallen: list[float] = []  # and what it explained where that was much less
        self._before: float | None = None  # what it explained of the last look
        self._fell_at_once = False
        self._map_error = MapError(field.cell_m)

    def believe(self, pose: Floats, covariance: Floats) -> None:
        """Begin at a known pose, in grid axes."""
        self._particles = Particles.around(pose, covariance, _N_TRACKED, self._rng)
        self._is_believed, self._n_unexplained, self._unchecked_m = True, 0, 0.0
        self._favourite = np.empty((0, 3))
        self._usual.clear()
        self._fallen.clear()
        self._before, self._fell_at_once = None, False

    def update(self, look: ScanLook, hint: Floats | None = None) -> Placed | Unplaced | None:
        """Take a look into account; None where the robot has not moved enough for it to tell anything new.

        Parameters
        ----------
        look : ScanLook
            What the laser sees.
        hint : (3,) float64, optional
            Where others believe that the robot is, in grid axes: one place more to be looked at.
        """
        last = self._last
        if last is not None:
            step = last.pose_odom_base.between(look.pose_odom_base)
            way_m = math.hypot(step.x, step.y)
            if way_m < _MOVED_M and abs(step.theta) < _MOVED_RAD and self._fits(look):
                return None
            self._unchecked_m += way_m
            if self._particles is not None:
                self._particles = self._particles.moved(step, self._settings.noise, self._rng)
            self._hypotheses = moved_by(self._hypotheses, step)
            self._favourite = moved_by(self._favourite, step)
        self._last = look
        return self._follow(look) if self._is_believed else self._find(look, hint)

    def _fits(self, look: ScanLook) -> bool:
        """Whether a robot at rest may leave a look out: nothing is followed, or it shows what was there before."""
        if not self._is_believed or self._particles is None:
            return True
        mean = self._particles.clusters()[0].mean
        return float(self._search.explained(look, mean[np.newaxis])[0]) >= self._settings.min_quality

    def _follow(self, look: ScanLook) -> Placed | Unplaced:
        assert self._particles is not None
        settings = self._settings
        particles = self._particles.weighed(self._log_likelihoods(look, self._particles.poses))
        if particles.effective_count < len(particles) / 2:
            particles = particles.resampled(settings.n_fewest, settings.n_most, self._rng)
        self._particles = particles
        clusters = particles.clusters()
        pose = self._drawn_onto_walls(look, clusters[0].mean)
        quality = float(self._search.explained(look, pose[np.newaxis])[0])
        if quality < settings.min_quality:
            return self._doubt(quality)
        self._n_unexplained = 0
        has_fallen = self._has_fallen(quality)
        if has_fallen:
            self._search.forget()
        n_places = sum(cluster.share > _SECOND_CLUSTER for cluster in clusters)
        if n_places > 1:
            return Unplaced(f"{n_places} places fit", quality, n_places)
        self._search.remember(look, _LOOK_M, _LOOK_RAD)
        is_due = has_fallen or self._unchecked_m > settings.recheck_m
        if is_due and (rival := self._better_place(look, pose)) is not None:
            return rival
        if has_fallen and self._fell_at_once:
            return Unplaced(f"the place explains only {quality:.0%} of the scan, much less than lately", quality, 1)
        return Placed(pose, self._covariance_of(look, pose, clusters[0]), quality)

    def _has_fallen(self, quality: float) -> bool:
        """Whether a place explains much less than it used to; what outnumbers patience is usual from then on."""
        usual = median(self._usual) if self._usual else 0.0
        scatter = median(abs(one - usual) for one in self._usual) if self._usual else 0.0
        fall = max(_LEAST_FALL, _FALL_SIGMAS * _SIGMA_OVER_MEDIAN * scatter)
        before, self._before = self._before, quality
        if quality >= usual - fall:
            self._usual.append(quality)
            del self._fallen[:1]  # one look as before does not undo all others
            self._fell_at_once = self._fell_at_once and bool(self._fallen)
            return False
        self._fell_at_once = self._fell_at_once or (before is not None and quality < before - _AT_ONCE * fall)
        self._fallen.append(quality)
        if len(self._fallen) > self._settings.patience:
            self._usual.clear()
            self._usual.extend(self._fallen)
            self._fallen.clear()
        return True

    def _doubt(self, quality: float) -> Unplaced:
        self._n_unexplained += 1
        if self._n_unexplained >= self._settings.patience:
            self._give_up()
        return Unplaced(f"the place explains only {quality:.0%} of the scan", quality, 0)

    def _give_up(self) -> None:
        self._is_believed, self._particles, self._hypotheses = False, None, np.empty((0, 3))
        self._search.forget()

    def _better_place(self, look: ScanLook, pose: Floats) -> Unplaced | None:
        """Compare a followed place with the rest of the map, and begin anew if it does not win."""
        self._unchecked_m = 0.0
        drawn = self._field.draw_poses(self._settings.n_search, self._rng)
        fitting = best_of_each_neighbourhood(drawn, self._search.scores(look, drawn), _N_CANDIDATES)
        places = self._search.compare(look, np.vstack([pose, fitting]))
        is_here = ~is_elsewhere(places.poses, pose)
        if is_here.any() and places.shares[0] - places.shares[is_here].max() < _UNSEATS:
            return None
        # the looks until now belong to the place that was followed, and hang together with what is seen elsewhere by a
        # motion that nobody measured: a place that fits to both a little would win
        self._search.forget()
        self._is_believed, self._particles, self._hypotheses = False, None, places.poses
        return Unplaced("another place fits better", float(places.shares[0]), len(places.poses))

    def _find(self, look: ScanLook, hint: Floats | None) -> Placed | Unplaced:
        settings, before = self._settings, self._particles
        drawn = self._field.draw_poses(settings.n_start if before is None else settings.n_search, self._rng)
        poses = drawn if before is None else np.vstack([before.poses, drawn])
        weights = np.full(len(poses), 1.0 / len(drawn))
        if before is not None:
            weights[: len(before)] = (1.0 - _FRESH_SHARE) * before.weights
            weights[len(before) :] *= _FRESH_SHARE
        scores = self._search.scores(look, poses)
        weighed = Particles(poses, weights).weighed(0.2 * scores)
        self._particles = weighed.resampled(settings.n_fewest, settings.n_most, self._rng)
        candidates = [best_of_each_neighbourhood(poses, scores, _N_CANDIDATES), self._hypotheses]
        if hint is not None:
            candidates.append(hint[np.newaxis])
        self._search.remember(look, _LOOK_M, _LOOK_RAD)
        places = self._search.compare(look, np.vstack(candidates))
        self._hypotheses = places.poses
        return self._decide(places)

    def _decide(self, places: RankedPlaces) -> Placed | Unplaced:
        """Believe the best place if it explains enough, leaves clearly less than others, and at two looks in a row."""
        settings, best = self._settings, float(places.shares[0])
        favourite, self._favourite = self._favourite, np.empty((0, 3))
        if best < settings.quality_of_found:
            return Unplaced(f"no place explains more than {best:.0%} of the scan", best, 0)
        margin = settings.margin / math.sqrt(places.n_looks)
        fits_as_well = (places.shares > best - margin) | (_LEFT_BY_RIVALS * (1.0 - best) > 1.0 - places.shares)
        n_places = int(fits_as_well.sum())
        if n_places > 1:
            return Unplaced(f"{n_places} places fit", best, n_places)
        if places.n_looks < _FEWEST_LOOKS:
            return Unplaced("one place fits, but it was looked at from one side only: drive on", best, 1)
        self._favourite = places.poses[:1]
        if not len(favourite) or is_elsewhere(favourite, places.poses[0])[0]:
            return Unplaced("one place fits, and the next look must confirm it", best, 1)
        covariance = np.diag([_DRAWN_M**2, _DRAWN_M**2, _DRAWN_RAD**2])
        self.believe(places.poses[0], covariance)
        return Placed(places.poses[0], covariance, best)

    def _log_likelihoods(self, look: ScanLook, poses: Floats) -> Floats:
        """Return how well particles fit, without the rays that hardly any of them agrees with (beam skipping)."""
        field = self._field
        rays = np.ascontiguousarray(look.rays[:: max(1, len(look.rays) // _N_RAYS_TRACKED)])
        agreeing = count_agreeing(poses, rays, field.distance_m, field.cell_m, _AGREE_M)
        is_used = agreeing >= _AGREE_SHARE * len(poses)
        if is_used.mean() >= _LEAST_USED:
            rays = rays[is_used]
        logs = score_poses(poses, rays, field.narrow, field.is_free, field.cell_m, float(field.narrow.min()))
        return logs * min(1.0, _RAYS_THAT_COUNT / len(rays))

    def _drawn_onto_walls(self, look: ScanLook, mean: Floats) -> Floats:
        """Return the mean of particles, drawn onto the walls where that is a small step."""
        refined = self._search.followed(look, mean[np.newaxis])[0]
        return np.asarray(refined)

    def _covariance_of(self, look: ScanLook, pose: Floats, cluster: Cluster) -> Floats:
        """Return the covariance of a mean that was drawn onto the walls.

        Particles spread as far as odometry may err between two scans; the drawn pose is better where walls tell.
        """
        self._map_error.add(self._search.distances_to_walls(look, pose), look.rays)
        if np.array_equal(pose, cluster.mean):
            return cluster.covariance
        information = np.linalg.inv(cluster.covariance + _LEAST_SPREAD) + self._search.told_by_walls(look, pose)
        sigmas = self._map_error.sigmas()
        return np.asarray(np.linalg.inv(information) + np.diag(np.square(sigmas)))
