"""Configs of the executors that come with core."""

from __future__ import annotations

from pydantic import Field

from trailmark.isolation.executor import ExecutorConfig

__all__ = ["DaskConfig", "LocalConfig"]


class LocalConfig(ExecutorConfig):
    """Processes on this machine."""

    jobs: int | None = Field(default=None, ge=1)
    """Cells at a time; left out: 1, so that times are fair."""
    frames_mb: float = Field(default=4000.0, ge=0)
    """Frames of simulated sources are rendered once and played to every cell of the same source, seed and place, faults
    are applied once, and a place is taught once; what all may take below the bench's folder. 0: every cell does it
    itself [MB]."""
    warm: bool = True
    """Cells of the same packages are forked from a process that has imported them, on Linux; each is isolated as a
    program of its own is, and one that crashes is run again as such. False: each begins anew."""


class DaskConfig(ExecutorConfig):
    """Workers of a Dask cluster, each with this Trailmark installed."""

    scheduler: str = Field(min_length=1)
    """Address of the scheduler: `tcp://host:8786`."""
    jobs: int | None = Field(default=None, ge=1)
    """Cells at a time; left out: one for each thread of each worker."""
    carry_mb: float = Field(default=64.0, ge=0)
    """Recordings and calibrations up to this size travel with the cell; larger ones must lie at the same path on the
    workers [MB]."""
