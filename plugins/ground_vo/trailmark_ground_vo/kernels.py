"""Which build of the kernels runs: with vectors, or plain where the compiler refuses them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from trailmark.arrays import Grey8, Grey16
from trailmark_ground_vo.absolute import PatchSearch, patch_search, patch_search_plain
from trailmark_ground_vo.filters import smooth, smooth_plain, transpose, transpose_plain
from trailmark_ground_vo.search import SadSearch, sad_search, sad_search_plain

__all__ = ["Kernels", "load_kernels"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Kernels:
    """The kernels that exist twice; both give the same bits.

    Attributes
    ----------
    transpose, smooth : callable
        Of `filters`.
    sad_search : callable
        Gives the search of a range, of `search`.
    patch_search : callable
        Gives the search for a patch, of `absolute`.
    """

    transpose: Callable[[Grey8], Grey8]
    smooth: Callable[[Grey8], Grey16]
    sad_search: Callable[[int], SadSearch]
    patch_search: Callable[[int], PatchSearch]


_PLAIN = Kernels(transpose_plain, smooth_plain, sad_search_plain, patch_search_plain)
_VECTOR = Kernels(transpose, smooth, sad_search, patch_search)


@lru_cache
def load_kernels(use_vectors: bool = True) -> Kernels:
    """Return the kernels that work on this machine, compiled.

    Parameters
    ----------
    use_vectors : bool
        False takes the plain ones.
    """
    if use_vectors:
        try:
            _try_out(_VECTOR)
        except Exception as error:  # whatever numba or LLVM raise here, the plain kernels do the work
            logger.warning("vector kernels do not compile (%s); the plain ones are about ten times slower", error)
        else:
            return _VECTOR
    _try_out(_PLAIN)
    return _PLAIN


def _try_out(kernels: Kernels) -> None:
    image = np.arange(64 * 64, dtype=np.uint32).reshape(64, 64).astype(np.uint8)
    spots = np.full((2, 1, 1), 32, np.int64)
    kernels.smooth(image)
    kernels.sad_search(8)(image, kernels.transpose(image), spots, image[0, :1])
