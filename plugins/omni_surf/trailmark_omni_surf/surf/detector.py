"""SURF as a whole: image in, features out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark_omni_surf.features import Features, SurfMode
from trailmark_omni_surf.surf.descriptor import describe, orient, region_weights
from trailmark_omni_surf.surf.extrema import find_maxima
from trailmark_omni_surf.surf.hessian import halve_layer, hessian_layer, integral_image
from trailmark_omni_surf.surf.signs import laplacian_signs

__all__ = ["Surf", "SurfOptions"]

_MAX_POINTS = 16384  # of one octave, before the best are chosen
_N_LAYERS = 4
_MIN_SIDE_PX = 32


@dataclass(frozen=True, slots=True)
class SurfOptions:
    """How SURF looks at an image.

    Attributes
    ----------
    threshold : float
        Smallest Hessian determinant over the filter's area squared [grey levels^2].
    n_octaves : int
        Octaves of four filters each: 9, 15, 21, 27 px; 15 to 51 px; 27 to 99 px; 51 to 195 px.
    n_best : int or None
        Keep the strongest; None: all.
    upright : bool
        Skip the orientation, for cameras that do not turn (U-SURF).
    up_sample : bool
        Double the image first: finds smaller features and places all of them better, for twice the time.
    blur_px : float
        Gaussian sigma before all else, on the doubled image if doubled; 0: none [px].
    spacing : float
        Between the samples of the described square, which is 24 of them wide [scales].
    """

    threshold: float = 2.0
    n_octaves: int = 3
    n_best: int | None = 200
    upright: bool = False
    up_sample: bool = False
    blur_px: float = 0.8
    spacing: float = 1.0

    @classmethod
    def of(cls, mode: SurfMode, **changes: Any) -> SurfOptions:
        """Return the options of a mode.

        ``fast`` looks at the image as it is, ``quality`` at one of twice the size. ``compact`` leaves out the third
        octave, whose grid of 4 px places features badly, and describes a smaller square, of which less is bent or
        hidden in another view; the stronger blur makes small features come back.
        """
        return dataclasses.replace(_MODES[mode], **changes)


_MODES: Mapping[SurfMode, SurfOptions] = {
    "fast": SurfOptions(),
    "compact": SurfOptions(threshold=1.0, n_octaves=2, blur_px=1.5, spacing=0.7),
    "quality": SurfOptions(up_sample=True, blur_px=1.0, n_octaves=4),
}


class Surf:
    """Detects and describes. Keeps its work arrays between images: one instance, one thread.

    Parameters
    ----------
    options : SurfOptions, optional
        Default: mode ``fast``.
    """

    def __init__(self, options: SurfOptions | None = None) -> None:
        self.options = options or SurfOptions()
        self._weights = region_weights()
        self._found = np.empty((_MAX_POINTS, 6), np.float32)
        self._shape = (0, 0)
        self._integral = np.empty((1, 1), np.int32)
        self._octaves: list[npt.NDArray[np.float32]] = []

    def __call__(self, image: npt.NDArray[np.uint8]) -> Features:
        """Return the features of a grey image, the strongest first.

        Parameters
        ----------
        image : (H, W) uint8
            Grey image, at least 32 px on each side.

        Raises
        ------
        ShapeError
            If it is of another shape or dtype, or smaller.
        """
        if image.ndim != 2 or image.dtype != np.uint8 or min(image.shape) < _MIN_SIDE_PX:
            raise ShapeError(f"SURF takes a grey uint8 image of at least 32 x 32, not {image.shape} {image.dtype}")
        options = self.options
        prepared = self._prepare_image(image)
        self._fit_to(prepared.shape)
        integral_image(prepared, self._integral)
        points = _strongest(self._detect(), options.n_best)
        angles = np.zeros(len(points), np.float32)
        if not options.upright:
            orient(self._integral, points, angles)
        descriptors = np.empty((len(points), 64), np.float32)
        describe(self._integral, points, angles, self._weights, np.float32(options.spacing), descriptors)
        signs = laplacian_signs(self._integral, points)
        uv, scale = points[:, :2].astype(np.float64), points[:, 2]
        if options.up_sample:
            uv, scale = (uv - 0.5) / 2.0, scale / 2.0  # pixel centres: u_doubled = 2 u + 0.5
        return Features(uv, descriptors, signs, points[:, 3].copy(), scale.copy(), angles)

    def _prepare_image(self, image: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        options = self.options
        if options.up_sample:
            image = np.asarray(cv2.resize(image, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
        if options.blur_px > 0.0:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), options.blur_px), dtype=np.uint8)
        return np.ascontiguousarray(image)

    def _fit_to(self, shape: tuple[int, ...]) -> None:
        """Make the work arrays anew when the image has another size."""
        if shape == self._shape:
            return
        height, width = shape
        self._shape = (height, width)
        self._integral = np.empty((height + 1, width + 1), np.int32)
        self._octaves = [
            np.empty((_N_LAYERS, -(-height // step), -(-width // step)), np.float32)
            for step in (2**octave for octave in range(self.options.n_octaves))
        ]

    def _detect(self) -> npt.NDArray[np.float32]:
        """Return the maxima of all octaves, (N, 6) float32; see `find_maxima`."""
        found = []
        for octave, layers in enumerate(self._octaves):
            step, size_step = 2**octave, 6 * 2**octave
            first_size = 3 + size_step
            self._fill(octave, layers, first_size, size_step)
            n = find_maxima(layers, first_size, size_step, step, self.options.threshold, self._found)
            found.append(self._found[:n].copy())
        return np.concatenate(found)

    def _fill(self, octave: int, layers: npt.NDArray[np.float32], first_size: int, size_step: int) -> None:
        """Compute the layers of an octave; two of them are in the octave before it already."""
        known = {}
        if octave > 0:
            known = {0: 1, 1: 3}
        for layer in range(_N_LAYERS):
            if layer in known:
                halve_layer(self._octaves[octave - 1][known[layer]], layers[layer])
            else:
                hessian_layer(self._integral, first_size + layer * size_step, 2**octave, layers[layer])


def _strongest(points: npt.NDArray[np.float32], n_best: int | None) -> npt.NDArray[np.float32]:
    if n_best is not None and len(points) > n_best:
        points = points[np.argpartition(-points[:, 3], n_best - 1)[:n_best]]
    return np.ascontiguousarray(points[np.argsort(-points[:, 3], kind="stable")])
