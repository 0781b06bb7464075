"""Cells on the workers of a Dask cluster."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError
from trailmark.isolation.executor import Executor, ExecutorLostError, Finished, Job
from trailmark.isolation.outcome import Outcome
from trailmark_bench.remote import pack_request, run_packed, unpack_result

__all__ = ["DaskExecutor"]

_PATIENCE_S = 10.0
_LOOK_AGAIN_S = 2.0


class DaskExecutor(Executor):
    """A task for each cell; each runs in a process of its own beside its worker.

    A cell whose worker dies is given to another worker by the scheduler; one during which too many workers died
    (``distributed.scheduler.allowed-failures``), or whose answer does not arrive, is lost, which says nothing about it.
    When the scheduler is lost, everything is. A result that comes twice is taken once.
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
            with self._talking() as client:
                self._places = max(1, sum(client.nthreads().values()))
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
        package = pack_request(job.request, self.config.carry_mb)
        with self._talking() as client:
            future = client.submit(run_packed, package, key=f"trailmark-{job.id}-{time.monotonic_ns()}", pure=False)
        self._futures[job.id] = future
        done = self._done  # what ends after `close` is of no interest
        future.add_done_callback(lambda ended: done.put((job, ended)))

    def wait(self, timeout_s: float) -> Sequence[Finished]:
        """Return the cells that have ended."""
        ended = []
        with suppress(queue.Empty):
            ended.append(self._done.get(timeout=timeout_s))
        while not self._done.empty():
            ended.append(self._done.get_nowait())
        with self._talking():
            return [self._finish(job, future) for job, future in ended]

    def close(self) -> None:
        """Take back what has not run, and leave the cluster."""
        client, self._client = self._client, None
        futures, self._futures = list(self._futures.values()), {}
        self._done = queue.Queue()
        if client is None:
            return
        with suppress(Exception):  # a scheduler that is gone takes nothing back
            if futures and client.status == "running":
                client.cancel(futures, force=True)
        with suppress(Exception):
            client.close(timeout=_PATIENCE_S)

    @contextmanager
    def _talking(self) -> Iterator[Any]:
        """Give the client; what goes wrong while the scheduler is away is its loss.

        Raises
        ------
        ExecutorLostError
            If the scheduler is away, before or afterwards.
        """
        try:
            if self._client.status == "running":
                yield self._client
        except Exception:
            if self._client.status == "running":
                raise
        if self._client.status != "running":
            raise ExecutorLostError(f"the Dask scheduler at {self.config.scheduler!r} is lost")

    def _finish(self, job: Job, future: Any) -> Finished:
        self._futures.pop(job.id, None)
        try:
            return unpack_result(job, future.result(timeout=_PATIENCE_S))
        except Exception as error:  # its workers died, or the answer did not arrive
            said = str(error).splitlines()[0] if str(error) else type(error).__name__
            reason = f"lost on the cluster: {type(error).__name__}: {said}"
            return Finished(job.id, Outcome("crashed", reason), is_lost=True)
