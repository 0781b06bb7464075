"""The two flows of localization: tracked landmarks (main) and detected ones (sub); Tasaki et al. 2010, Sec. III-B."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Grey8
from trailmark.geometry import Pose2
from trailmark_omni_surf.bearings import BearingFix, BearingNoise, locate
from trailmark_omni_surf.features import FeatureExtractor
from trailmark_omni_surf.landmark_map import LandmarkMap
from trailmark_omni_surf.pixel_bearings import PixelBearings
from trailmark_omni_surf.tracking import track_points

__all__ = ["NOTHING", "FlowOptions", "FlowResult", "by_detection", "by_tracking", "chance_agreements"]


_MAX_CHANCE = 1e-2
_MIN_EXPECTED = 5  # landmarks that must agree on a pose near where it was expected


@dataclass(frozen=True, slots=True)
class FlowOptions:
    """What both flows ask.

    Attributes
    ----------
    noise : BearingNoise
        Noise of bearings, T_p, and how certain a pose must be.
    descriptor_gate, ratio : float
        T_F, and how much nearer than the second a match must be.
    min_agreeing : int
        Landmarks that must agree on a pose found without a start, each counted the less the larger its error.
    max_rival_share : float
        A pose elsewhere with more than this share of the support makes such a pose ambiguous.
    min_agreeing_share : float
        Share of the recognised landmarks that must agree on such a pose.
    max_gap_rad : float
        Widest angle without an agreeing landmark, seen from such a pose [rad].
    """

    noise: BearingNoise
    descriptor_gate: float
    ratio: float
    min_agreeing: int
    max_rival_share: float
    min_agreeing_share: float
    max_gap_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class FlowResult:
    """What a flow says of one picture.

    Attributes
    ----------
    fix : BearingFix or None
        Pose of the camera in the map.
    landmark_idx : (N,) intp
        Landmarks that are left after step 4: their tracking error is below T_p.
    uv : (N, 2) float64
        Where they are in the picture [px].
    n_seen : int
        Landmarks matched or tracked before that.
    reason : str
        Why there is no pose.
    """

    fix: BearingFix | None
    landmark_idx: npt.NDArray[np.intp]
    uv: npt.NDArray[np.float64]
    n_seen: int
    reason: str = ""


def by_detection(
    image: Grey8,
    extract: FeatureExtractor,
    landmarks: LandmarkMap,
    camera: PixelBearings,
    options: FlowOptions,
    start: Pose2 | None = None,
) -> FlowResult:
    """Detect features, match them with the landmarks and locate the camera; the sub flow.

    Parameters
    ----------
    image : (H, W) uint8
        Grey picture.
    extract, landmarks, camera : FeatureExtractor, LandmarkMap, PixelBearings
        What finds features, the map, and what turns pixels into bearings.
    options : FlowOptions
        Gates.
    start : Pose2, optional
        Where the camera may be. A pose found without it is preferred when it is beyond doubt and has more support.
    """
    features = extract(image)
    feature_idx, landmark_idx = landmarks.match(features, options.descriptor_gate, options.ratio)
    uv = features.uv[feature_idx]
    inside = camera.is_inside(uv, 0.0)
    uv, landmark_idx = uv[inside], landmark_idx[inside]
    positions, covariances = landmarks.positions[landmark_idx], landmarks.covariances[landmark_idx]
    bearings = camera.bearings(uv)
    anywhere = locate(positions, bearings, options.noise, covariances=covariances)
    doubt = _doubt(anywhere, bearings, options)
    found = None if doubt else anywhere
    if start is not None:
        near = locate(positions, bearings, options.noise, start, covariances)
        if near is not None and _is_expected(near, anywhere, found, options):
            found = near
    if found is None:
        return _nothing(len(uv), doubt)
    return FlowResult(found, landmark_idx[found.is_inlier], uv[found.is_inlier], len(uv))


def _doubt(fix: BearingFix | None, bearings: npt.NDArray[np.float64], options: FlowOptions) -> str:
    """Return why a pose that was found without a start is not believed, or nothing."""
    n, needed = len(bearings), options.min_agreeing
    if n < needed:
        return f"{n} landmarks recognised, {needed} are needed"
    if fix is None:
        return f"the bearings of {n} recognised landmarks do not tell one place"
    n_agreeing = int(fix.is_inlier.sum())
    if fix.support < needed:
        return f"{n_agreeing} of {n} recognised landmarks agree, by their errors worth {fix.support:.1f} of {needed}"
    is_chance = chance_agreements(n, n_agreeing, options.noise.gate_rad) > _MAX_CHANCE
    if is_chance or n_agreeing < options.min_agreeing_share * n:
        return f"{n_agreeing} of {n} recognised landmarks agree: that may be chance"
    if fix.rival_support > options.max_rival_share * fix.support:
        return f"{n_agreeing} of {n} recognised landmarks agree, and nearly as many on another place"
    gap_rad = fix.widest_gap_rad(bearings)
    if gap_rad > options.max_gap_rad:
        return f"{n_agreeing} of {n} recognised landmarks agree, all on one side ({math.degrees(gap_rad):.0f} deg free)"
    return ""


def _is_expected(near: BearingFix, anywhere: BearingFix | None, found: BearingFix | None, options: FlowOptions) -> bool:
    """Return whether the pose near the start is the better answer: where it was expected, less is asked."""
    n, n_agreeing = len(near.is_inlier), int(near.is_inlier.sum())
    if n_agreeing < _MIN_EXPECTED or chance_agreements(n, n_agreeing, options.noise.gate_rad) > _MAX_CHANCE:
        return False
    if found is not None:
        return near.support >= found.support
    return anywhere is None or near.support >= options.max_rival_share * anywhere.support


def by_tracking(
    previous: Grey8,
    image: Grey8,
    last: FlowResult,
    landmarks: LandmarkMap,
    camera: PixelBearings,
    options: FlowOptions,
    start: Pose2,
) -> FlowResult:
    """Track the landmarks of the last picture into this one and locate the camera; the main flow.

    Landmarks whose tracking error, Eq. (4), exceeds T_p are removed: something else is tracked by now.

    Parameters
    ----------
    previous, image : (H, W) uint8
        Grey pictures.
    last : FlowResult
        Of the previous picture.
    landmarks, camera, options : LandmarkMap, PixelBearings, FlowOptions
        As in `by_detection`.
    start : Pose2
        Where the camera is, from the last pose and the motion since.
    """
    uv, is_tracked = track_points(previous, image, last.uv)
    if 2 * int(is_tracked.sum()) < len(last.uv):  # carried away, or something large stands in the way
        return _nothing(int(is_tracked.sum()), f"{int(is_tracked.sum())} of {len(last.uv)} landmarks tracked")
    kept = is_tracked & camera.is_inside(uv, 0.0)
    uv, landmark_idx = uv[kept], last.landmark_idx[kept]
    n = len(uv)
    if n < 3:
        return _nothing(n, f"{n} landmarks tracked, 3 are needed")
    positions, covariances = landmarks.positions[landmark_idx], landmarks.covariances[landmark_idx]
    fix = locate(positions, camera.bearings(uv), options.noise, start, covariances)
    if fix is None:
        return _nothing(n, f"the bearings of {n} tracked landmarks do not tell the place")
    if 2 * int(fix.is_inlier.sum()) <= n:
        return _nothing(n, f"{int(fix.is_inlier.sum())} of {n} tracked landmarks agree")
    return FlowResult(fix, landmark_idx[fix.is_inlier], uv[fix.is_inlier], n)


def chance_agreements(n: int, n_agreeing: int, gate_rad: float) -> float:
    """Return how many poses so well supported are expected among wrong matches (an a-contrario bound).

    Every triple of `n` bearings proposes a pose; each further wrong bearing agrees with it by chance once in
    ``pi / gate`` times.
    """
    p = min(gate_rad / math.pi, 1.0)
    spare, needed = n - 3, n_agreeing - 3
    tail = math.fsum(math.comb(spare, k) * p**k * (1.0 - p) ** (spare - k) for k in range(needed, spare + 1))
    return math.comb(n, 3) * tail


def _nothing(n: int, reason: str) -> FlowResult:
    return FlowResult(None, np.empty(0, dtype=np.intp), np.empty((0, 2)), n, reason)


#: What a flow says that was not gone.
NOTHING = _nothing(0, "")
