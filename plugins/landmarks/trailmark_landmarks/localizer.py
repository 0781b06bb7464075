"""Landmarks at known places, seen at ranges, bearings or both."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Estimate, Fix, Lost, range_fix
from trailmark.frames import Arrays, Frame, Record, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_landmarks.candidates import candidate_poses
from trailmark_landmarks.config import KnownLandmarksConfig
from trailmark_landmarks.consensus import Consensus, find_consensus
from trailmark_landmarks.lasting import LastingErrors
from trailmark_landmarks.noise import SightingNoise
from trailmark_landmarks.sightings import Seen, Sightings, lever_of, pose_of_base
from trailmark_landmarks.single import single_fix

__all__ = ["KnownLandmarks"]

_GATE_SIGMAS = 4.0
#: For how long errors last that do not average out, as a fix tells it [s].
_LASTING_S = 100.0
#: No two numbers stay the same on such a way.
_HANGING_M = 0.1


class KnownLandmarks(Localizer):
    """Gives the pose on which the sightings of an instant agree, or each sighting by itself where they are too few.

    With four numbers or more (a bearing is one, a range is one) the pose needs no belief, and an outlier is found by
    the others. With fewer, every sighting is a `Fix` that knows as much as the sighting says: along the line to the
    landmark, across it, or both; the belief says where about to take it, and the estimator's gate finds an outlier.
    """

    config: KnownLandmarksConfig

    def start(self, session: Session) -> None:
        """Read the places of the landmarks.

        Raises
        ------
        ConfigError
            If neither the config nor the sensor's calibration says.
        """
        info = session.sensors[self.config.sightings]
        self._positions = self.config.landmarks or _places_from_calibration(info)
        self._mounting = info.pose_base_sensor.planar()
        self._mounting_variance = math.radians(self.config.mounting_sigma_deg) ** 2
        config = self.config
        bearing_sigma_rad = math.radians(config.bearing_sigma_deg)
        self._noise = SightingNoise(config.range_sigma_m, bearing_sigma_rad, learns=config.learn_noise)
        self._lasting = LastingErrors()
        self._all_landmarks = np.array(list(self._positions.values()), dtype=np.float64).reshape(-1, 2)
        self._health = ""
        self._gates = np.array([config.gate_range_m, math.radians(config.gate_bearing_deg)])
        self._n_unknown, self._has_seen_one = 0, False
        self._newest, self._newest_at_m = b"", 0.0

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return one fix of all sightings, or one for each; nothing where only strangers are seen."""
        if not isinstance(frame.payload, Record):
            return ()
        seen = self._known_landmarks(frame.payload)
        if not len(seen):
            return () if self._has_seen_one else (Lost(frame.stamp_s, self._why_nothing(frame.payload)),)
        self._has_seen_one = True
        if self._is_hanging(seen, belief.travelled_m):
            return (Lost(frame.stamp_s, "the readings repeat to the last bit while the robot drives"),)
        sightings = self._sightings(seen)
        candidates = candidate_poses(seen.landmarks, seen.ranges_m, seen.bearings_rad)
        found = find_consensus(sightings, candidates, self.config.max_position_sigma_m)
        if isinstance(found, Consensus):
            self._noise.learn_from_fit(found, sightings, frame.stamp_s)
            fix = self._fix(frame.stamp_s, found, sightings)
            if self.config.learn_noise:
                self._lasting.add_fit(found, sightings, frame.stamp_s)
                self._tell()
            return (fix,)
        if belief.pose_map_base is None or belief.covariance is None:
            return (Lost(frame.stamp_s, f"{found}, and nothing is believed yet"),)
        believed, covariance = belief.pose_map_base, belief.covariance
        estimates = []
        for one in seen.one_by_one():
            sighting = self._sightings(one, alone=True)
            estimates.append(self._single(belief, believed, covariance, frame.stamp_s, sighting))
            self._noise.learn_from_belief(
                believed, covariance, sighting, mounting=self._mounting, stamp_s=frame.stamp_s
            )
            if self.config.learn_noise:
                sensor = believed @ self._mounting
                rows = sighting.derivatives(sensor.array()) @ lever_of(believed, sensor)
                expected = np.einsum("mi,ij,mj->m", rows, covariance, rows)
                self._lasting.add_alone(sighting, sighting.errors(sensor.array()), expected, frame.stamp_s)
        self._tell()
        return estimates

    def health(self) -> str:
        """Return which landmarks, or whether all ranges, are lastingly off."""
        return self._health

    def _tell(self) -> None:
        range_sigma_m, bearing_sigma_rad = self._noise.sigmas.tolist()
        self._health = self._lasting.in_words(range_sigma_m, bearing_sigma_rad)

    def counters(self) -> Mapping[str, int]:
        """Return how many sightings were of no known landmark."""
        return {"unknown_landmarks": self._n_unknown}

    def _known_landmarks(self, record: Record) -> Seen:
        """Return what is seen of landmarks whose place is known."""
        ids = np.asarray(record.arrays["ids"], dtype=np.int64)
        is_known = np.array([number in self._positions for number in ids.tolist()], dtype=bool)
        self._n_unknown += int((~is_known).sum())
        untold = np.full(len(ids), np.nan)
        ranges_m = np.asarray(record.arrays.get("ranges_m", untold), dtype=np.float64)
        bearings_rad = np.asarray(record.arrays.get("bearings_rad", untold), dtype=np.float64)
        chosen = is_known & (np.isfinite(ranges_m) | np.isfinite(bearings_rad)) & _is_first(ids, ranges_m, bearings_rad)
        landmarks = np.array([self._positions[number] for number in ids[chosen].tolist()]).reshape(-1, 2)
        return Seen(ids[chosen], landmarks, ranges_m[chosen], bearings_rad[chosen])

    def _is_hanging(self, seen: Seen, travelled_m: float) -> bool:
        """Return whether two numbers or more have stayed what they are to the last bit on the way driven since."""
        readings = b"".join(array.tobytes() for array in (seen.ids, seen.ranges_m, seen.bearings_rad))
        if readings != self._newest:
            self._newest, self._newest_at_m = readings, travelled_m
        n_numbers = int(np.isfinite(seen.ranges_m).sum() + np.isfinite(seen.bearings_rad).sum())
        return n_numbers > 1 and travelled_m - self._newest_at_m > _HANGING_M

    def _why_nothing(self, record: Record) -> str:
        strangers = ", ".join(str(number) for number in np.unique(record.arrays["ids"])[:5])
        return f"no known landmark is seen: {strangers or 'none'}, and known are {', '.join(map(str, self._positions))}"

    def _sightings(self, seen: Seen, *, alone: bool = False) -> Sightings:
        sigmas = self._noise.sigmas
        told = Sightings.of(seen, sigmas=sigmas, gates=np.maximum(self._gates, _GATE_SIGMAS * sigmas))
        return replace(told, sigmas=np.sqrt(told.sigmas**2 + self._lasting.variances(told, alone=alone)))

    def _fix(self, stamp_s: float, found: Consensus, sightings: Sightings) -> Fix:
        covariance = np.linalg.inv(found.information)
        share = float((self._lasting.variances(sightings) / sightings.sigmas**2)[found.agrees].max())
        scale_m2 = self._lasting.of_scale(self._all_landmarks)
        covariance[:2, :2] += scale_m2 * np.eye(2)
        correlation_s = _LASTING_S if scale_m2 or share > 0.5 else None
        covariance[2, 2] += self._mounting_variance
        pose, information = pose_of_base(found.pose, np.linalg.inv(covariance), self._mounting)
        details = self._details(int(found.agrees.sum()), len(found.agrees))
        return Fix(stamp_s, pose, information, details, correlation_s)

    def _single(
        self, belief: Belief, believed: Pose2, covariance: Floats, stamp_s: float, sighting: Sightings
    ) -> Estimate:
        """Return what one landmark says, at the place that it and the belief make most likely."""
        if len(sighting) == 1 and not sighting.is_bearing[0]:
            x, y = sighting.landmarks[0].tolist()
            range_m, sigma_m = float(sighting.measured[0]), float(sighting.sigmas[0])
            told = range_fix(belief, (x, y), range_m, sigma_m, antenna_base=(self._mounting.x, self._mounting.y))
        else:
            shared = np.where(sighting.is_bearing, self._mounting_variance, 0.0)
            wider = replace(sighting, sigmas=np.sqrt(sighting.sigmas**2 + shared))
            told = single_fix(believed, covariance, wider, self._mounting, stamp_s)
        return told if isinstance(told, Lost) else replace(told, details=self._details(len(sighting), len(sighting)))

    def _details(self, n_agree: int, n_seen: int) -> Mapping[str, float]:
        range_sigma_m, bearing_sigma_rad = self._noise.sigmas.tolist()
        return {
            "agree": float(n_agree),
            "seen": float(n_seen),
            "range_sigma_m": range_sigma_m,
            "bearing_sigma_deg": math.degrees(bearing_sigma_rad),
        }


def _is_first(ids: np.ndarray, ranges_m: Floats, bearings_rad: Floats) -> Bools:
    """Return which sightings repeat no earlier one to the last bit: a repeated error does not average out."""
    told = np.nan_to_num(np.stack([ids, ranges_m, bearings_rad], axis=1), nan=np.inf)
    is_first = np.zeros(len(ids), dtype=bool)
    is_first[np.unique(told, axis=0, return_index=True)[1]] = True
    return is_first


def _places_from_calibration(info: SensorInfo) -> dict[int, tuple[float, float]]:
    """Return the places that a sensor's calibration gives."""
    calibration = info.calibration
    if not isinstance(calibration, Arrays) or not {"ids", "positions_map"} <= set(calibration.arrays):
        raise ConfigError(
            f"sensor {info.name!r} does not say where its landmarks stand; write landmarks: {{1: [x, y], ...}}"
            " under the localizer, or give the source a table of them"
        )
    ids, positions = calibration.arrays["ids"].tolist(), calibration.arrays["positions_map"].tolist()
    return {number: (x, y) for number, (x, y) in zip(ids, positions, strict=True)}
