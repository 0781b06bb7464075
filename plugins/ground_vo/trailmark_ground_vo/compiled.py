"""How kernels are compiled."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba

__all__ = ["float_kernel", "kernel"]

logger = logging.getLogger(__name__)

_Function = TypeVar("_Function", bound=Callable[..., object])

#: What lets float sums and products run in vectors. Infinities and NaN keep their meaning.
_REORDER = {"reassoc", "contract", "nsz", "arcp"}


def kernel(function: _Function) -> _Function:
    """Compile a function with numba: without the interpreter's lock, and kept on disk between runs.

    Where no folder can be written (a read-only installation without a home), it is compiled in every run.
    """
    return _compiled(function, False)


def float_kernel(function: _Function) -> _Function:
    """Compile like `kernel`, and let the order of float sums change: last digits may differ between processors."""
    return _compiled(function, _REORDER)


def _compiled(function: _Function, fastmath: Any) -> _Function:
    # the entry for C callers would be compiled too, and nobody calls it
    options: dict[str, Any] = {"nogil": True, "fastmath": fastmath, "no_cfunc_wrapper": True}
    try:
        compiled: _Function = numba.njit(cache=True, **options)(function)
    except RuntimeError as error:
        logger.info("kernel %s cannot be cached: %s", function.__name__, error)
        compiled = numba.njit(**options)(function)
    return compiled
