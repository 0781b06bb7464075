"""A small camera over a synthetic floor, and runs of the localizer over it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Lost, Motion
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark.testing.ground import GroundCamera, GroundRun, MirroredFloor
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO


@dataclass
class Tracked:
    """What a localizer said on a run."""

    run: GroundRun
    estimates: list[Estimate] = field(default_factory=list)
    pose: Pose2 = field(default_factory=Pose2)

    @property
    def motions(self) -> list[Motion]:
        return [estimate for estimate in self.estimates if isinstance(estimate, Motion)]

    @property
    def lost(self) -> list[Lost]:
        return [estimate for estimate in self.estimates if isinstance(estimate, Lost)]

    def error(self) -> np.ndarray:
        """End of the integrated motions minus the true one: x, y [m], theta [rad]."""
        start, end = self.run.truth[0][1], self.run.truth[-1][1]
        return start.between(end).between(self.pose).array()


@pytest.fixture(scope="session")
def camera() -> GroundCamera:
    return GroundCamera((320, 288), noise_sigma=3.0)


@pytest.fixture(scope="session")
def ground() -> MirroredFloor:
    return MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5)


@pytest.fixture(scope="session")
def track():
    """Run the localizer over the frames of a run, perhaps changed on the way."""

    def track(run: GroundRun, change=None, **keys) -> Tracked:
        settings = {"camera": "floor", "n_pixels": 384} | keys
        localizer = GroundVO(GroundVOConfig(**settings))
        localizer.start(Session(name="vo", sensors={"floor": run.sensor}))
        tracked = Tracked(run)
        for index, frame in enumerate(run.frames):
            seen = frame if change is None else change(index, frame)
            if seen is None:
                continue
            for estimate in localizer.observe(seen, Belief(seen.stamp_s)):
                tracked.estimates.append(estimate)
                if isinstance(estimate, Motion):
                    tracked.pose = tracked.pose @ estimate.pose_since_now
        return tracked

    return track


@pytest.fixture(scope="session")
def floors(data_folder: Path) -> Path:
    """Photographs of real floors."""
    folder = data_folder / "ground"
    if not folder.is_dir():
        pytest.skip(f"no photographs of floors at {folder}")
    return folder


@pytest.fixture
def localizer_map() -> MemoryMap:
    return MemoryMap()
