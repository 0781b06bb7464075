"""What another day does to a floor: dirt, leaves, wet patches."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import AnyArray, Float32s, Floats
from trailmark.kernels import kernel
from trailmark_sim.ground import layers
from trailmark_sim.hashing import hash2, mix_bits, normal_of, unit_of
from trailmark_sim.rng import stream_key

__all__ = ["Weather"]

#: Leaves lie scattered on cells of this size, at most one in each [m].
_LEAF_CELL_M = 0.10


@dataclass(frozen=True, slots=True)
class Weather:
    """Changes of the ground between one day and another.

    Attributes
    ----------
    day : int
        Which day: seeds where dirt, leaves and water lie.
    dirt : float
        Weight of the layer of dirt, 0 to 1: at 1 its greys deviate by 12.
    leaves_per_m2 : float
        Leaves on a square metre, at most 100.
    wet : float
        Share of the ground that is wet, and then darker and glossier, 0 to 1.
    """

    day: int = 1
    dirt: float = 0.0
    leaves_per_m2: float = 0.0
    wet: float = 0.0

    def change(self, grey: Float32s, x: Floats, y: Floats) -> None:
        """Change the greys at places (N, N) in the map [m], in place."""
        if self.dirt > 0.0:
            for cell_m, gain in ((0.06, 6.0), (0.012, 6.0), (0.003, 8.0)):
                key = self._key(f"dirt {cell_m}")
                layers.add_clouds(grey, x, y, cell_m, cell_m, gain * self.dirt, key)
        if self.wet > 0.0:
            self._wet(grey, x, y)
        if self.leaves_per_m2 > 0.0:
            share = min(1.0, self.leaves_per_m2 * _LEAF_CELL_M**2)
            _lay_leaves(grey, x, y, share, self._key("leaves"))

    def _wet(self, grey: Float32s, x: Floats, y: Floats) -> None:
        level = np.zeros_like(grey)
        layers.add_clouds(level, x, y, 0.5, 0.5, 1.0, self._key("puddles"))
        layers.add_clouds(level, x, y, 0.06, 0.06, 0.25, self._key("rims"))
        # The clouds deviate by about 0.76; from the share that is wet follows the level of the water.
        water = np.clip((level / 0.76 - _normal_quantile(1.0 - self.wet)) * 4.0, 0.0, 1.0)
        grey *= 1.0 - 0.35 * water

    def _key(self, what: str) -> np.uint64:
        return np.uint64(stream_key(self.day, f"weather {what}"))


def _normal_quantile(share: float) -> float:
    """Return the normal value that `share` lies below (logistic approximation, good to 0.02 in the middle)."""
    share = min(max(share, 1e-4), 1.0 - 1e-4)
    return math.log(share / (1.0 - share)) / 1.702


@kernel
def _lay_leaves(out: AnyArray, x: AnyArray, y: AnyArray, share: float, seed: np.uint64) -> None:
    """Cover the floor with leaves: 30 to 70 mm long, pointed, with a rib and veins; they hide what is below."""
    leaf = np.zeros((9, 6))  # centre x, y [m], cos, sin of its direction, half length [m], grey; length 0: none
    last_i, last_j = -(1 << 62), 0
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            i, j = math.floor(x[row, col] / _LEAF_CELL_M), math.floor(y[row, col] / _LEAF_CELL_M)
            if i != last_i or j != last_j:
                for n in range(9):
                    _fill_leaf(leaf[n], i - 1 + n % 3, j - 1 + n // 3, share, seed)
                last_i, last_j = i, j
            for n in range(9):
                half = leaf[n, 4]
                if half > 0.0:
                    dx, dy = x[row, col] - leaf[n, 0], y[row, col] - leaf[n, 1]
                    along = (dx * leaf[n, 2] + dy * leaf[n, 3]) / half
                    across = (dy * leaf[n, 2] - dx * leaf[n, 3]) / half
                    if abs(along) < 1.0 and abs(across) < 0.4 * (1.0 - along * along):
                        # The rib, the veins that leave it, and spots of a millimetre.
                        detail = 25.0 if abs(across) < 0.02 else 6.0 * math.sin(24.0 * (along - 0.8 * abs(across)))
                        spot = hash2(math.floor(x[row, col] * 1000.0), math.floor(y[row, col] * 1000.0), seed)
                        out[row, col] = leaf[n, 5] + detail + 5.0 * normal_of(spot)


@kernel
def _fill_leaf(leaf: AnyArray, i: int, j: int, share: float, seed: np.uint64) -> None:
    h = hash2(i, j, seed)
    leaf[4] = 0.0
    if unit_of(h) >= share:
        return
    h = mix_bits(h)
    leaf[0] = (i + unit_of(h)) * _LEAF_CELL_M
    h = mix_bits(h)
    leaf[1] = (j + unit_of(h)) * _LEAF_CELL_M
    h = mix_bits(h)
    turn = 2.0 * math.pi * unit_of(h)
    leaf[2], leaf[3] = math.cos(turn), math.sin(turn)
    h = mix_bits(h)
    leaf[4] = 0.015 + 0.02 * unit_of(h)
    leaf[5] = 95.0 + 25.0 * normal_of(mix_bits(h))
