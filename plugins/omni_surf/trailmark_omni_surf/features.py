"""Local features by name: our SURF, or SIFT, ORB, AKAZE of OpenCV, all with descriptors as unit vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.frames import Image
from trailmark_omni_surf.matching_kernels import squared_unit_distances

__all__ = [
    "FeatureExtractor",
    "FeatureName",
    "Features",
    "SurfMode",
    "create_features",
    "grey_of",
    "match",
    "squared_distances",
]

FeatureName = Literal["surf", "sift", "orb", "akaze", "cv2_surf"]
SurfMode = Literal["fast", "compact", "quality"]


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Local features of one image, the strongest first.

    Attributes
    ----------
    uv : (N, 2) float64
        Positions [px].
    descriptors : (N, D) float32
        Unit vectors. Binary descriptors become vectors of +-1 / sqrt(bits), so that the distance of two is
        ``2 sqrt(differing bits / bits)``: one threshold has one meaning for all kinds.
    sign : (N,) int8
        Sign of the Laplacian: bright blobs are never matched with dark ones; 0 where there is none.
    response : (N,) float32
        Strength, comparable within one kind.
    scale_px : (N,) float32
        Scale (sigma) [px].
    angle_rad : (N,) float32
        Orientation, from +u towards +v [rad].
    """

    uv: npt.NDArray[np.float64]
    descriptors: npt.NDArray[np.float32]
    sign: npt.NDArray[np.int8]
    response: npt.NDArray[np.float32]
    scale_px: npt.NDArray[np.float32]
    angle_rad: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.uv)

    def select(self, which: npt.NDArray[np.bool_]) -> Features:
        """Return some of them, in the same order."""
        arrays = (self.uv, self.descriptors, self.sign, self.response, self.scale_px, self.angle_rad)
        return Features(*(array[which] for array in arrays))  # type: ignore[arg-type]


class FeatureExtractor(Protocol):
    """Finds and describes features of a grey image."""

    def __call__(self, image: npt.NDArray[np.uint8]) -> Features:
        """Return the features of a (H, W) uint8 image."""


def create_features(
    name: FeatureName, n_best: int = 200, quality: SurfMode = "fast", upright: bool = False
) -> FeatureExtractor:
    """Return the extractor of a name.

    Parameters
    ----------
    name : {"surf", "sift", "orb", "akaze", "cv2_surf"}
        ``surf`` is our own; ``cv2_surf`` needs an OpenCV built with its non-free part.
    n_best : int
        How many features to keep.
    quality : {"fast", "compact", "quality"}
        Of our SURF; see `SurfOptions.of`.
    upright : bool
        SURF without orientation, for cameras that do not turn.

    Raises
    ------
    ConfigError
        If `cv2_surf` is asked for and this OpenCV has none, or the name is unknown.
    """
    if name == "surf":
        from trailmark_omni_surf.surf.detector import Surf, SurfOptions

        return Surf(SurfOptions.of(quality, n_best=n_best, upright=upright))
    makers = {"sift": _sift, "orb": _orb, "akaze": _akaze, "cv2_surf": _cv2_surf}
    if name not in makers:
        raise ConfigError(f"no features named {name!r}; available: akaze, cv2_surf, orb, sift, surf")
    return _OpenCvFeatures(makers[name](n_best, upright), n_best)


def grey_of(image: Image) -> npt.NDArray[np.uint8]:
    """Return a picture in grey, 8 bits, contiguous."""
    pixels = image.pixels
    if pixels.ndim == 3:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    if pixels.dtype == np.uint16:
        return (pixels >> 8).astype(np.uint8)
    return np.ascontiguousarray(pixels)


def match(
    query: npt.NDArray[np.float32],
    query_sign: npt.NDArray[np.int8],
    train: npt.NDArray[np.float32],
    train_sign: npt.NDArray[np.int8],
    max_distance: float,
    ratio: float | None = 0.8,
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.float64]]:
    """Return pairs that are each other's nearest, no farther than `max_distance`, Eq. (1).

    Parameters
    ----------
    query, train : (N, D) and (M, D) float32
        Descriptors, unit vectors.
    query_sign, train_sign : (N,) and (M,) int8
        Signs of the Laplacian.
    max_distance : float
        T_F, between unit vectors (0 to 2).
    ratio : float or None
        The nearest must be this much nearer than the second (Lowe); None: not asked.

    Returns
    -------
    query_idx, train_idx : (K,) intp
        The pairs.
    distances : (K,) float64
        Distance of each.
    """
    squared = squared_distances(query, query_sign, train, train_sign)
    nothing = np.empty(0, dtype=np.intp)
    if squared.size == 0:
        return nothing, nothing, np.empty(0)
    nearest = squared.argmin(axis=1)
    rows = np.arange(len(squared))
    best = squared[rows, nearest]
    is_match = (squared.argmin(axis=0)[nearest] == rows) & (best <= max_distance**2)
    if ratio is not None and squared.shape[1] > 1:
        second = np.partition(squared, 1, axis=1)[:, 1]
        is_match &= best <= ratio**2 * second
    chosen = np.flatnonzero(is_match)
    return chosen, nearest[chosen], np.sqrt(best[chosen])


def squared_distances(
    query: npt.NDArray[np.float32],
    query_sign: npt.NDArray[np.int8],
    train: npt.NDArray[np.float32],
    train_sign: npt.NDArray[np.int8],
) -> npt.NDArray[np.float64]:
    """Return squared distances between unit vectors, (N, M) float64; infinite between bright and dark blobs.

    Parameters
    ----------
    query, train : (N, d), (M, d) float32
        Descriptors of length one.
    query_sign, train_sign : (N,), (M,) int8
        Signs of the Laplacian (Bay et al. 2006, Sec. 4.3).

    Returns
    -------
    (N, M) float64
        Squared distances.
    """
    out = np.empty((len(query), len(train)))
    if out.size:
        squared_unit_distances(query, query_sign, np.ascontiguousarray(train.T), train_sign, out)
    return out


class _OpenCvFeatures:
    """A detector of OpenCV behind our interface."""

    def __init__(self, detector: Any, n_best: int) -> None:
        self._detector, self._n_best = detector, n_best

    def __call__(self, image: npt.NDArray[np.uint8]) -> Features:
        keypoints, descriptors = self._detector.detectAndCompute(image, None)
        if descriptors is None or len(keypoints) == 0:
            return _features([], np.empty((0, 1), np.float32))
        response = np.array([point.response for point in keypoints])
        order = np.argsort(-response, kind="stable")[: self._n_best]
        return _features([keypoints[k] for k in order], _unit_vectors(np.asarray(descriptors)[order]))


def _features(keypoints: list[Any], descriptors: npt.NDArray[np.float32]) -> Features:
    return Features(
        np.array([point.pt for point in keypoints], dtype=np.float64).reshape(-1, 2),
        descriptors,
        np.zeros(len(keypoints), np.int8),
        np.array([point.response for point in keypoints], dtype=np.float32),
        np.array([point.size / 2.0 for point in keypoints], dtype=np.float32),
        np.radians(np.array([point.angle for point in keypoints], dtype=np.float32)),
    )


def _unit_vectors(descriptors: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    if descriptors.dtype == np.uint8:
        bits = np.unpackbits(descriptors, axis=1)
        return np.asarray((2.0 * bits - 1.0) / np.sqrt(bits.shape[1]), dtype=np.float32)
    lengths = np.linalg.norm(descriptors, axis=1, keepdims=True)
    return np.asarray(descriptors / np.maximum(lengths, 1e-12), dtype=np.float32)


def _sift(n_best: int, upright: bool) -> Any:
    return cv2.SIFT_create(nfeatures=n_best)  # type: ignore[attr-defined]


def _orb(n_best: int, upright: bool) -> Any:
    return cv2.ORB_create(nfeatures=n_best, fastThreshold=7)  # type: ignore[attr-defined]


def _akaze(n_best: int, upright: bool) -> Any:
    home: Any = cv2 if hasattr(cv2, "AKAZE_create") else cv2.xfeatures2d  # it moved with OpenCV 5
    return home.AKAZE_create(threshold=5e-4)


def _cv2_surf(n_best: int, upright: bool) -> Any:
    try:
        return cv2.xfeatures2d.SURF_create(hessianThreshold=100, nOctaves=3, nOctaveLayers=2, upright=upright)  # type: ignore[attr-defined]
    except (cv2.error, AttributeError) as error:
        raise ConfigError(
            f"features: cv2_surf needs an OpenCV built with OPENCV_ENABLE_NONFREE, and cv2 {cv2.__version__} is not; "
            "use features: surf (our own) or sift"
        ) from error
