"""Sign of the Laplacian: bright blobs on dark ground against dark ones on bright (Bay et al. 2006, Sec. 4.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark_omni_surf.surf.hessian import box_derivatives

__all__ = ["laplacian_signs"]


@kernel
def laplacian_signs(integral: npt.NDArray[Any], points: npt.NDArray[Any]) -> npt.NDArray[np.int8]:
    """Return the sign of Dxx + Dyy at every point, (N,) int8.

    Parameters
    ----------
    integral : (H + 1, W + 1) int32
        Integral image.
    points : (N, 6) float32
        As `find_maxima` gives them: u, v, and the filter size in column 5 [px].
    """
    signs = np.empty(points.shape[0], np.int8)
    for n in range(points.shape[0]):
        size = int(points[n, 5])
        border = size // 2
        u = min(max(int(points[n, 0] + 0.5), border), integral.shape[1] - 2 - border)
        v = min(max(int(points[n, 1] + 0.5), border), integral.shape[0] - 2 - border)
        dxx, dyy, _ = box_derivatives(integral, v, u, size)
        signs[n] = 1 if dxx + dyy >= 0.0 else -1
    return signs
