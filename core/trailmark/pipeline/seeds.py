"""Random numbers of the parts of a run."""

from __future__ import annotations

import hashlib

import numpy as np

__all__ = ["part_rng"]


def part_rng(seed: int, kind: str, name: str) -> np.random.Generator:
    """Return the generator of one part: from (seed, kind, name) alone, the same on every machine.

    Adding or renaming one part changes no other part's numbers.
    """
    digest = hashlib.sha256(f"{kind}:{name}".encode()).digest()
    words = np.frombuffer(digest, dtype="<u4").tolist()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))
