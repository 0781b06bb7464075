"""Finding remembered landmarks again: by optical flow, near where they should be, or anywhere."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Float32s, Floats, Indices
from trailmark_kinect_landmarks.colour import similarity

__all__ = [
    "consistent",
    "follow",
    "is_near",
    "match_anywhere",
    "match_near",
    "resemblance",
    "resemblance_where",
]


_FLOW_WINDOW = (17, 17)
_FLOW_LEVELS = 3
_MAX_RETURN_PX = 1.0  # forth and back must end where it began
_SIZE_RATIO = 2.5


def follow(
    before: npt.NDArray[np.uint8], now: npt.NDArray[np.uint8], uv: Floats, guess_uv: Floats | None = None
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return where pixels went between two pictures by optical flow (Lucas & Kanade, pyramids), and which did not.

    Parameters
    ----------
    uv : (N, 2) float
        Pixels in the earlier picture [px].
    guess_uv : (N, 2) float, optional
        Where they should be now [px].

    Returns
    -------
    (N, 2) float64, (N,) bool
        Pixels in the later picture, and whether flow forth and back agrees.
    """
    if len(uv) == 0:
        return np.empty((0, 2)), np.empty(0, np.bool_)
    start = uv.astype(np.float32).reshape(-1, 1, 2)
    aim = start.copy() if guess_uv is None else guess_uv.astype(np.float32).reshape(-1, 1, 2)
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, start, aim, winSize=_FLOW_WINDOW, maxLevel=_FLOW_LEVELS, flags=flags
    )
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(
        now, before, there, start.copy(), winSize=_FLOW_WINDOW, maxLevel=_FLOW_LEVELS, flags=flags
    )
    there_uv = np.asarray(there, dtype=np.float64).reshape(-1, 2)
    returned = np.abs(np.asarray(back).reshape(-1, 2) - uv).max(axis=1) <= _MAX_RETURN_PX
    height, width = now.shape
    inside = np.all((there_uv >= 2.0) & (there_uv <= (width - 3.0, height - 3.0)), axis=1)
    good = np.asarray(found).ravel().astype(bool) & np.asarray(found_back).ravel().astype(bool) & returned & inside
    return there_uv, np.asarray(good)


def resemblance(
    histogram: Float32s, vicinity: Float32s, other_histogram: Float32s, other_vicinity: Float32s, by_colour: bool = True
) -> Float32s:
    """Return how alike landmarks are, (N, M): the mean of the likeness of colours and of vicinities, at most 1.

    Parameters
    ----------
    histogram, vicinity : (N, B) float64
        Colours of N landmarks, and of what is around them.
    other_histogram, other_vicinity : (M, B) float64
        The same of M others.
    by_colour : bool
        False: colours do not count.

    Returns
    -------
    (N, M) float64
        Likeness, at most 1.
    """
    pattern = vicinity @ other_vicinity.T
    if not by_colour:
        return np.asarray(pattern, dtype=np.float32)
    return np.asarray((pattern + similarity(histogram, other_histogram)) / 2.0, dtype=np.float32)


def resemblance_where(
    possible: npt.NDArray[np.bool_],
    histogram: Float32s,
    vicinity: Float32s,
    other_histogram: Float32s,
    other_vicinity: Float32s,
    by_colour: bool = True,
) -> Float32s:
    """Return the same of the possible pairs alone, (N, M), and -1 for all others: most stand elsewhere.

    Parameters
    ----------
    possible : (N, M) bool
        Pairs to compare.
    histogram, vicinity : (N, B) float64
        Colours of N landmarks, and of what is around them.
    other_histogram, other_vicinity : (M, B) float64
        The same of M others.
    by_colour : bool
        False: colours do not count.

    Returns
    -------
    (N, M) float64
        Likeness, at most 1; -1 where a pair is not possible.
    """
    row, column = np.nonzero(possible)
    alike = np.einsum("kc,kc->k", vicinity[row], other_vicinity[column])
    if by_colour:
        root, other_root = np.sqrt(histogram), np.sqrt(other_histogram)
        alike = (alike + np.einsum("kb,kb->k", root[row], other_root[column])) / 2.0
    scores = np.full(possible.shape, -1.0, np.float32)
    scores[row, column] = alike
    return scores


def is_near(uv: Floats, expected_uv: Floats, radius_px: float) -> npt.NDArray[np.bool_]:
    """Return which pixels are within a square around others, (N, M)."""
    miss_px = np.abs(uv[:, None, :] - expected_uv[None]).max(axis=2)
    return np.asarray(miss_px <= radius_px)


def match_near(
    alike: Float32s, uv: Floats, expected_uv: Floats, radius_px: float, size: Floats, other_size: Floats, least: float
) -> Indices:
    """Return pairs (seen, remembered) that look alike, are of like size and near where they should be.

    Each is the other's best; (K, 2).

    Parameters
    ----------
    alike : (N, M) float64
        As `resemblance` returns it.
    uv : (N, 2) float64
        Pixels of those that are seen [px].
    expected_uv : (M, 2) float64
        Pixels where the remembered ones are expected [px].
    radius_px : float
        Greatest distance of the two [px].
    size, other_size : (N,), (M,) float64
        Sizes of the seen and the remembered ones [m].
    least : float
        Least likeness of a pair.

    Returns
    -------
    (K, 2) int
        Rows of the seen and of the remembered ones.
    """
    if alike.size == 0:
        return np.empty((0, 2), np.intp)
    possible = is_near(uv, expected_uv, radius_px) & _like_size(size, other_size)
    return _mutual(np.where(possible, alike, -1.0).astype(np.float32), least)


def match_anywhere(alike: Float32s, size: Floats, other_size: Floats, least: float, n_each: int = 3) -> Indices:
    """Return candidate pairs (seen, remembered), up to `n_each` for each that is seen; (K, 2).

    Parameters
    ----------
    alike : (N, M) float64
        As `resemblance` returns it.
    size, other_size : (N,), (M,) float64
        Sizes of the seen and the remembered ones [m].
    least : float
        Least likeness of a pair.
    n_each : int
        Pairs for each that is seen, at the most.

    Returns
    -------
    (K, 2) int
        Rows of the seen and of the remembered ones.
    """
    if alike.size == 0:
        return np.empty((0, 2), np.intp)
    scores = np.where(_like_size(size, other_size), alike, -1.0)
    best = np.argsort(-scores, axis=1)[:, :n_each]
    seen = np.repeat(np.arange(len(scores)), best.shape[1])
    pairs = np.stack([seen, best.ravel()], axis=1)
    good: npt.NDArray[np.bool_] = scores[pairs[:, 0], pairs[:, 1]] >= least
    return np.asarray(pairs[np.flatnonzero(good)], dtype=np.intp)


def consistent(pairs: Indices, points_base: Floats, points_map: Floats, tolerance: float = 0.04) -> Indices:
    """Return the largest group of pairs whose landmarks stand as far from one another now as they did.

    The neighbourhood is identity: distances between landmarks do not depend on where the robot is. Grown greedily
    from the pair that most others agree with.

    Parameters
    ----------
    tolerance : float
        Allowed difference of two distances, as a share of the farther landmark's distance from the robot.
    """
    if len(pairs) < 2:
        return pairs
    now, then = points_base[pairs[:, 0]], points_map[pairs[:, 1]]
    apart_now = np.linalg.norm(now[:, None] - now[None], axis=2)
    apart_then = np.linalg.norm(then[:, None] - then[None], axis=2)
    away = np.linalg.norm(now, axis=1)
    agree = np.abs(apart_now - apart_then) <= tolerance * np.maximum(away[:, None], away[None])
    agree &= (pairs[:, None, 0] != pairs[None, :, 0]) & (pairs[:, None, 1] != pairs[None, :, 1])
    kept = [int(agree.sum(axis=1).argmax())]
    open_to = agree[kept[0]].copy()
    while open_to.any():
        support = np.where(open_to, (agree & open_to).sum(axis=1), -1)
        kept.append(int(support.argmax()))
        open_to &= agree[kept[-1]]
    return np.asarray(pairs[np.sort(kept)], dtype=np.intp)


def _like_size(size: Floats, other_size: Floats) -> npt.NDArray[np.bool_]:
    ratio = size[:, None] / np.maximum(other_size[None], 1e-6)
    return np.asarray((ratio < _SIZE_RATIO) & (ratio > 1.0 / _SIZE_RATIO))


def _mutual(scores: Float32s, least: float) -> Indices:
    best = scores.argmax(axis=1)
    rows = np.arange(len(scores))
    mutual = (scores.argmax(axis=0)[best] == rows) & (scores[rows, best] >= least)
    return np.stack([rows[mutual], best[mutual]], axis=1).astype(np.intp)
