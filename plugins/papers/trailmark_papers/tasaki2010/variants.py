"""Localizers that differ in config and map, and drives that show all of them the same pictures."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray, Floats
from trailmark.errors import StoreError
from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Image, Odometry
from trailmark.geometry import Pose2, wrap_angles
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.paths import Keyframe
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_papers.kit import Watcher, observe_timed, show, started_source
from trailmark_papers.tasaki2010.plain_surf import PlainSurf

__all__ = ["Answers", "Variant", "drive"]


@dataclass(frozen=True, slots=True)
class Variant:
    """A localizer and its map.

    Attributes
    ----------
    name : str
        What it is called here.
    map_path : Path
        Arrays of its map, npz.
    config : mapping
        What differs from the default config.
    is_plain : bool
        `PlainSurf` in place of the plugin's localizer.
    """

    name: str
    map_path: Path
    config: Mapping[str, Any]
    is_plain: bool = False

    def start_localizer(self, sensors: Mapping[str, Any]) -> Localizer:
        """Return the localizer, started on its map."""
        settings = OmniSurfConfig.model_validate({"camera": "omni", **self.config})
        localizer: Localizer = PlainSurf(settings) if self.is_plain else OmniSurf(settings)
        localizer.start(Session(self.name, "replay", sensors, map=_OneMap(self.map_path)))
        return localizer


class _OneMap(LocalizerMap):
    """A localizer map that holds one map and takes nothing."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as saved:
            self._arrays = {key: np.asarray(saved[key]) for key in saved.files}

    def add(self, keyframe: Keyframe) -> None:
        raise StoreError("a map alone takes no keyframes")

    def keyframes(self) -> list[Keyframe]:
        return []

    def save(self, name: str, arrays: Mapping[str, AnyArray]) -> None:
        raise StoreError("a map alone takes no arrays")

    def load(self, name: str) -> dict[str, AnyArray] | None:
        return self._arrays if name == "landmarks" else None


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What a localizer said to the pictures of one drive.

    Attributes
    ----------
    truth, said : (N, 3) float64
        Where the robot was and was said to be; NaN where the answer was `Lost` [m, m, rad].
    nees : (N,) float64
        Squared error over the covariance that was claimed, 3 degrees of freedom.
    cpu_ms : (N,) float64
        CPU time of the answer, all threads [ms].
    tracked : (N,) float64
        1 where the main flow gave the answer, 0 where the sub flow did, NaN where none did.
    """

    truth: Floats
    said: Floats
    nees: Floats
    cpu_ms: Floats
    tracked: Floats

    @property
    def errors_m(self) -> Floats:
        """Distance from the true position, NaN where there was no answer, (N,) [m]."""
        return np.asarray(np.hypot(*(self.said - self.truth)[:, :2].T))

    @property
    def fixed_share(self) -> float:
        """Share of the pictures that were answered."""
        return float(np.isfinite(self.said[:, 0]).mean())

    @property
    def n_bad(self) -> int:
        """Answers that are more than 0.5 m off and whose covariance does not allow that: NEES > 16."""
        return int(((self.errors_m > 0.5) & (self.nees > 16.0)).sum())


class _CameraDrive(Watcher):
    """A localizer that sees the pictures, and believes the wheels where it is relative to its start."""

    def __init__(self, localizer: Localizer) -> None:
        self._localizer = localizer
        self._pose_odom_base = Pose2()
        self.rows: list[tuple[float, ...]] = []

    def see(self, frame: Frame) -> None:
        """Answer a picture; keep what the wheels say."""
        if isinstance(frame.payload, Odometry) and frame.payload.pose_start_base is not None:
            self._pose_odom_base = frame.payload.pose_start_base
        if isinstance(frame.payload, Image):
            belief = Belief(frame.stamp_s, pose_odom_base=self._pose_odom_base)
            (answer,), took_ms = observe_timed(self._localizer, frame, belief, time.process_time_ns)
            self.rows.append((took_ms, *_numbers(answer)))


def drive(variants: Sequence[Variant], source: Mapping[str, Any], seed: int) -> dict[str, Answers]:
    """Drive a route once and show every picture to all localizers; none of them knows where it starts.

    Parameters
    ----------
    variants : sequence of Variant
        The localizers.
    source : mapping
        Config of the simulator.
    seed : int
        Of noise, slip and people.
    """
    with started_source(source, seed) as robot:
        cameras = {variant.name: _CameraDrive(variant.start_localizer(robot.sensors)) for variant in variants}
        truth = show(robot, cameras.values(), Image).poses
    return {name: _answers(truth, np.array(camera.rows)) for name, camera in cameras.items()}


def _numbers(answer: Any) -> tuple[float, ...]:
    """Return an answer as numbers: tracked, pose, information."""
    if not isinstance(answer, Fix):
        return (math.nan,) * 13
    return (answer.details["tracked"], *answer.pose_map_base.array().tolist(), *answer.information.ravel().tolist())


def _answers(truth: Floats, rows: Floats) -> Answers:
    said, information = rows[:, 2:5], rows[:, 5:].reshape(-1, 3, 3)
    off = said - truth
    off[:, 2] = wrap_angles(off[:, 2])
    nees = np.einsum("ni,nij,nj->n", off, information, off)
    return Answers(truth, said, nees, rows[:, 0], rows[:, 1])
