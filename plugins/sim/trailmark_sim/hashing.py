"""Integer hashes for numba kernels: the same number for the same place, on every machine and in every thread."""

from __future__ import annotations

import numpy as np

from trailmark.kernels import kernel

__all__ = ["hash2", "mix_bits", "normal_of", "unit_of"]

_K1 = np.uint64(0x9E3779B97F4A7C15)
_K2 = np.uint64(0xC2B2AE3D27D4EB4F)
_K3 = np.uint64(0xBF58476D1CE4E5B9)
_K4 = np.uint64(0x94D049BB133111EB)
_S11, _S16, _S27, _S30, _S31 = (np.uint64(n) for n in (11, 16, 27, 30, 31))
_LOW16 = np.uint64(0xFFFF)
_UNIT = 1.0 / (1 << 53)
_UNIT16 = 1.0 / (1 << 16)
_ROOT3 = 3.0**0.5


@kernel
def mix_bits(value: np.uint64) -> np.uint64:
    """Return the 64-bit hash of a 64-bit number (the finaliser of SplitMix64)."""
    value = (value ^ (value >> _S30)) * _K3
    value = (value ^ (value >> _S27)) * _K4
    return value ^ (value >> _S31)


@kernel
def hash2(ix: int, iy: int, seed: np.uint64) -> np.uint64:
    """Return the 64-bit hash of a lattice point; `seed` is uint64."""
    return mix_bits((np.uint64(ix) * _K1) ^ (np.uint64(iy) * _K2) ^ seed)


@kernel
def unit_of(h: np.uint64) -> float:
    """Return the number in [0, 1) of a hash."""
    return np.float64(h >> _S11) * _UNIT


@kernel
def normal_of(h: np.uint64) -> float:
    """Return a number of mean 0 and deviation 1, nearly normal (four uniform parts), of a hash."""
    total = 0.0
    for _ in range(4):
        total += np.float64(h & _LOW16) * _UNIT16
        h = h >> _S16
    return (total - 2.0) * _ROOT3
