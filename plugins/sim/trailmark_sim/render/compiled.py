"""How the kernels of the renderer are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

__all__ = ["inlined_kernel", "kernel"]

_Function = TypeVar("_Function", bound=Callable[..., object])
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


def kernel(function: _Function) -> _Function:
    """Compile a function, without the interpreter's lock, and keep it on disk between runs."""
    compiled: _Function = njit(cache=True, **_OPTIONS)(function)
    return compiled


def inlined_kernel(function: _Function) -> _Function:
    """Compile a function into each kernel that calls it, so that its loops see arrays that nothing else points to.

    Numba keeps a kernel on disk until the kernel's own file changes: after a change here save the caller's file too.
    """
    compiled: _Function = njit(inline="always", **_OPTIONS)(function)
    return compiled
