"""Compile, or load from the cache, every kernel of the camera's localizer before the clock starts."""

from __future__ import annotations

import numpy as np

from trailmark.geometry import Pose2
from trailmark_omni_surf.bearings import locate
from trailmark_omni_surf.circle import find_circle
from trailmark_omni_surf.features import FeatureExtractor
from trailmark_omni_surf.matching_kernels import nearest_groups

__all__ = ["warm_up"]


def warm_up(extract: FeatureExtractor) -> None:
    """Run the kernels once on nothing in particular."""
    noise = np.random.default_rng(0).integers(0, 255, (96, 96), dtype=np.uint8)
    blocks = np.ascontiguousarray(np.kron(noise[:12, :12], np.ones((8, 8), np.uint8)))
    features = extract(blocks)
    find_circle(blocks)
    if len(features):
        first = np.zeros(1, dtype=np.intp)
        columns = np.ascontiguousarray(features.descriptors.T)
        nearest_groups(features.descriptors, features.sign, columns, features.sign, first)
    corners = np.array([[2.0, 0.0], [0.0, 3.0], [-2.0, 1.0], [1.0, -2.0]])
    bearings = np.arctan2(corners[:, 1], corners[:, 0])
    locate(corners, bearings)
    locate(corners, bearings, start=Pose2(0.1, 0.0, 0.0))
