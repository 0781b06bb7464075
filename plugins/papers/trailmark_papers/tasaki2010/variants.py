"""Localizers that differ in config and map, and drives that show all of them the same pictures."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import StoreError
from trailmark.estimates import Belief, Fix
from trailmark.frames import Image, Odometry
from trailmark.geometry import Pose2, wrap_angles
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.paths import Keyframe
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_papers.tasaki2010.plain_surf import PlainSurf

__all__ = ["Answers", "Variant", "drive", "largest_of", "mean_of", "sd_of"]

Array = npt.NDArray[np.float64]


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

    def started(self, sensors: Mapping[str, Any]) -> Localizer:
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

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        raise StoreError("a map alone takes no arrays")

    def load(self, name: str) -> dict[str, npt.NDArray[Any]] | None:
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

    truth: Array
    said: Array
    nees: Array
    cpu_ms: Array
    tracked: Array

    @property
    def errors_m(self) -> Array:
        """Distance from the true position, NaN where there was no answer, (N,) [m]."""
        return np.asarray(np.hypot(*(self.said - self.truth)[:, :2].T))

    @property
    def fixed_share(self) -> float:
        """Share of the pictures that were answered."""
        return float(np.isfinite(self.said[:, 0]).mean())


def mean_of(values: Array) -> float | None:
    """Return the mean of what is a number; None where nothing is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.mean()) if len(numbers) else None


def sd_of(values: Array) -> float | None:
    """Return the standard deviation of what is a number; None where nothing is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.std()) if len(numbers) else None


def largest_of(values: Array) -> float | None:
    """Return the largest number; None where there is none."""
    numbers = values[np.isfinite(values)]
    return float(numbers.max()) if len(numbers) else None


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
    from trailmark.api import create

    config = dict(source)
    robot = create("source", config.pop("plugin"), **config)
    robot.start(Session("robot", "track", rng=np.random.default_rng(seed)))
    localizers = {variant.name: variant.started(robot.sensors) for variant in variants}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in localizers}
    stamps: list[float] = []
    pose_odom_base = Pose2()
    for frame in robot.frames():
        if isinstance(frame.payload, Odometry) and frame.payload.pose_start_base is not None:
            pose_odom_base = frame.payload.pose_start_base
        if isinstance(frame.payload, Image):
            stamps.append(frame.stamp_s)
            belief = Belief(frame.stamp_s, pose_odom_base=pose_odom_base)
            for name, localizer in localizers.items():
                began = time.process_time()
                (answer,) = localizer.observe(frame, belief)
                rows[name].append((1e3 * (time.process_time() - began), *_numbers(answer)))
    truth = np.array([pose.array() for _, pose in robot.ground_truth().at(stamps)])
    robot.close()
    return {name: _answers(truth, np.array(found)) for name, found in rows.items()}


def _numbers(answer: Any) -> tuple[float, ...]:
    """Return an answer as numbers: tracked, pose, information."""
    if not isinstance(answer, Fix):
        return (math.nan,) * 13
    return (answer.details["tracked"], *answer.pose_map_base.array().tolist(), *answer.information.ravel().tolist())


def _answers(truth: Array, rows: Array) -> Answers:
    said, information = rows[:, 2:5], rows[:, 5:].reshape(-1, 3, 3)
    off = said - truth
    off[:, 2] = wrap_angles(off[:, 2])
    nees = np.einsum("ni,nij,nj->n", off, information, off)
    return Answers(truth, said, nees, rows[:, 0], rows[:, 1])
