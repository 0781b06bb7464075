"""Counter-based random numbers, keyed by (seed, stream, frame): the same whatever was drawn before.

Every sensor has a stream of its own and every frame a counter of its own, so that adding a sensor,
skipping a frame or rendering frames out of order changes no other frame's numbers.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache

import numpy as np

__all__ = ["frame_rng", "stream_key"]

_MASK = (1 << 64) - 1


@lru_cache(maxsize=1024)
def stream_key(seed: int, stream: str) -> int:
    """Return the 64-bit key of a named stream of a seed; the same on every machine and in every process."""
    text = f"{seed}/{stream}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little")


def frame_rng(seed: int, stream: str, frame: int = 0) -> np.random.Generator:
    """Return the generator of one frame of one stream.

    Parameters
    ----------
    seed : int
        Seed of the run, or of the world.
    stream : str
        What the numbers are for, for example ``"floor/noise"``.
    frame : int
        Number of the frame, not negative.
    """
    # The frame stands in the highest word of the counter: 2^192 draws lie between two frames.
    counter = np.array([0, 0, 0, frame & _MASK], dtype=np.uint64)
    key = np.array([stream_key(seed, stream), seed & _MASK], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(counter=counter, key=key))
