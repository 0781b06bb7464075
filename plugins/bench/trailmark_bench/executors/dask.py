"""Cells on the workers of a Dask cluster."""

from __future__ import annotations

import queue
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError
from trailmark.isolation.executor import Executor, Finished, Job
from trailmark.isolation.outcome import Outcome
from trailmark_bench.remote import packed, received, run_packed

__all__ = ["DaskExecutor"]

_PATIENCE_S = 10.0
_LOOK_AGAIN_S = 2.0


class DaskExecutor(Executor):
    """A task for each cell; each runs in a process of its own beside its worker.

    A cell whose worker dies is given to another worker by the scheduler; one during which too many workers died
    (``distributed.scheduler.allowed-failures``) is told as crashed. A result that comes twice is taken once.
    """

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self._client: Any = None
        self._done: queue.Queue[tuple[Job, Any]] = queue.Queue()
        self._futures: dict[str, Any] = {}
        self._places = 1
        self._looked_s = 0.0

    @property
    def slots(self) -> int:
        """Cells at a time: as many as asked for, or as the workers that are there have threads."""
        if self.config.jobs is not None:
            return int(self.config.jobs)
        now_s = time.monotonic()
        if self._client is not None and now_s - self._looked_s > _LOOK_AGAIN_S:  # workers come and go
            self._looked_s = now_s
            self._places = max(1, sum(self._client.nthreads().values()))
        return self._places

    def start(self, workspace: Path) -> None:
        """Connect to the scheduler."""
        try:
            import distributed
        except ImportError as error:
            raise ConfigError(
                f"the executor 'dask' needs distributed: pip install 'trailmark[dask]' ({error})"
            ) from error
        try:
            connect: Any = distributed.Client
            self._client = connect(self.config.scheduler, timeout=_PATIENCE_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ConfigError(f"no Dask scheduler answers at {self.config.scheduler!r}: {error}") from error

    def submit(self, job: Job) -> None:
        """Give a cell to the cluster."""
        package = packed(job.request, self.config.carry_mb)
        future = self._client.submit(run_packed, package, key=f"trailmark-{job.id}-{time.monotonic_ns()}", pure=False)
        self._futures[job.id] = future
        future.add_done_callback(lambda done: self._done.put((job, done)))

    def wait(self, timeout_s: float) -> Sequence[Finished]:
        """Return the cells that have ended."""
        try:
            ended = [self._done.get(timeout=timeout_s)]
        except queue.Empty:
            return []
        while not self._done.empty():
            ended.append(self._done.get_nowait())
        return [self._finished(job, future) for job, future in ended]

    def close(self) -> None:
        """Take back what has not run, and leave the cluster."""
        client, self._client = self._client, None
        if client is not None:
            if self._futures:
                client.cancel(list(self._futures.values()), force=True)
            client.close(timeout=_PATIENCE_S)

    def _finished(self, job: Job, future: Any) -> Finished:
        self._futures.pop(job.id, None)
        try:
            return received(job, future.result(timeout=_PATIENCE_S))
        except Exception as error:  # its workers died, or the answer did not arrive
            story = str(error).splitlines()[0] if str(error) else type(error).__name__
            return Finished(job.id, Outcome("crashed", f"on the cluster: {type(error).__name__}: {story}"))
