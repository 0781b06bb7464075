"""Learning the flat field while driving.

A point of the ground that moves through the picture gets darker towards the corners: it tells how bright the picture
is there relative to where it was before, whatever it looks like. The remembered pixels of the refinement say so in
every picture; a smooth surface is fitted to what they say. Uncorrected, a vignette of 30 % costs a heading error of
0.1 to 0.5 deg/m.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark.kernels import kernel
from trailmark_ground_vo.texture import SEEN_X, SEEN_Y, VALUE, Texture, X, Y

__all__ = ["FlatFieldLearner"]

#: Terms of the surface, the logarithm of brightness: r^2 and r^4 of a vignette, x, y, x^2 - y^2 and x y of what is not
#: symmetric, in units of half the width; and the standard deviation expected of each. Directions that the robot has
#: not moved in yet are filled in by symmetry.
_N_TERMS = 6
_EXPECTED_SIGMAS = np.array([1.0, 1.0, 0.05, 0.05, 0.05, 0.05])

#: Standard deviation of one relative difference, and how many say the same: they share texture and motion [1].
_NOISE_SIGMA, _SHARED = 0.01, 50.0

#: One remembered pixel in so many is asked: they are many.
_EVERY = 4

#: Relative differences beyond this are no shading [1].
_CLIP = 0.15

#: Pictures between two looks at the surface, and what is kept then of what was said before: with a wrong surface the
#: motion takes on a little of the shading.
_INTERVAL_FRAMES, _KEPT = 5, 0.95

#: The surface is taken over when it changes somewhere by more than this [1], and by more than noise would: the squared
#: change in standard deviations of its six terms.
_LEAST_CHANGE, _SIGNIFICANT = 0.01, 30.0


@kernel
def _terms(x: float, y: float, out: Floats) -> None:
    squared = x * x + y * y
    out[0], out[1], out[2], out[3], out[4], out[5] = squared, squared * squared, x, y, x * x - y * y, x * y


@kernel
def _add_equations(
    texture: Texture,
    differences: Float32s,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    surface: Floats,
    a: Floats,
    b: Floats,
) -> None:
    """Add the equations of one picture: difference over value = surface here - surface where it was seen before.

    The picture was corrected with `surface`, which is therefore added to what is left.
    """
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    here, before = np.empty(_N_TERMS, np.float64), np.empty(_N_TERMS, np.float64)
    unit = 1.0 / (centre[0] + 0.5)
    for n in range(0, texture.shape[1], _EVERY):
        dx, dy = texture[X, n] - centre[0], texture[Y, n] - centre[1]
        x, y = cos * dx + sin * aspect * dy + motion[0], cos * dy - sin / aspect * dx + motion[1]
        _terms(x * unit, y * unit, here)
        _terms((texture[SEEN_X, n] - centre[0]) * unit, (texture[SEEN_Y, n] - centre[1]) * unit, before)
        relative = differences[n] / max(texture[VALUE, n], np.float32(1.0))
        relative = min(max(relative, -_CLIP), _CLIP)
        for i in range(_N_TERMS):
            here[i] -= before[i]
            relative += here[i] * surface[i]
        for i in range(_N_TERMS):
            b[i] += here[i] * relative
            for j in range(_N_TERMS):
                a[i, j] += here[i] * here[j]


class FlatFieldLearner:
    """Fits the flat field to what the remembered pixels say.

    Parameters
    ----------
    size : (int, int)
        Width and height of the picture [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._size = size
        self._aspect = aspect
        self._centre = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._surface = np.zeros(_N_TERMS)
        self._a, self._b = np.zeros((_N_TERMS, _N_TERMS)), np.zeros(_N_TERMS)
        self._n_frames = 0

    def add(self, texture: Texture, differences: Float32s, motion: tuple[float, float, float]) -> None:
        """Take what the remembered pixels say of one picture, which was corrected with the surface so far."""
        _add_equations(texture, differences, self._centre, motion, self._aspect, self._surface, self._a, self._b)
        self._n_frames += 1

    def news(self) -> Float32s | None:
        """Return the flat field, (H, W) relative to its mean, when it has changed since it was last returned."""
        if self._n_frames < _INTERVAL_FRAMES:
            return None
        variance = _SHARED * _NOISE_SIGMA**2
        system = self._a + np.diag(variance / _EXPECTED_SIGMAS**2)
        surface = np.asarray(np.linalg.solve(system, self._b), np.float64)
        self._n_frames, self._a, self._b = 0, _KEPT * self._a, _KEPT * self._b
        change = surface - self._surface
        is_noise = float(change @ system @ change) < _SIGNIFICANT * variance
        if is_noise or np.ptp(self._evaluate_surface(change, 16)) < _LEAST_CHANGE:
            return None
        self._surface = surface
        field = np.exp(self._evaluate_surface(surface, 1))
        return np.asarray(field / field.mean(), np.float32)

    def _evaluate_surface(self, surface: Floats, every: int) -> Floats:
        unit = 1.0 / (self._centre[0] + 0.5)
        x = (np.arange(0, self._size[0], every) - self._centre[0])[None, :] * unit
        y = (np.arange(0, self._size[1], every) - self._centre[1])[:, None] * unit
        squared = x * x + y * y
        terms = np.array([squared, squared * squared, x + 0.0 * y, y + 0.0 * x, x * x - y * y, x * y])
        return np.asarray(np.tensordot(surface, terms, axes=1))
