"""The environment of an isolated process: as many threads as it may have, and paths that hold in another folder."""

from __future__ import annotations

import os

__all__ = ["pinned_environment"]

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
# Paths that a process with another working folder has to find too.
_PATH_VARIABLES = ("PYTHONPATH", "NUMBA_CACHE_DIR", "MPLCONFIGDIR", "TRAILMARK_DATA")


def pinned_environment(threads: int | None) -> dict[str, str]:
    """Return this process' environment for one that runs in another folder, alike each time.

    Parameters
    ----------
    threads : int or None
        Of the numeric libraries; None: as they like.
    """
    pinned = {} if threads is None else dict.fromkeys(_THREAD_VARIABLES, str(threads))
    return os.environ | _absolute_paths() | pinned | {"PYTHONHASHSEED": "0"}


def _absolute_paths() -> dict[str, str]:
    """Return the variables that hold paths, with these made absolute."""
    written = {name: os.environ[name] for name in _PATH_VARIABLES if os.environ.get(name)}
    return {
        name: os.pathsep.join(os.path.abspath(path) for path in value.split(os.pathsep) if path)
        for name, value in written.items()
    }
