"""Cells on this machine."""

from __future__ import annotations

import queue
import shutil
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from trailmark.isolation.executor import Executor, Finished, Job
from trailmark.isolation.outcome import Outcome
from trailmark.isolation.process import IsolatedProcess
from trailmark.isolation.warm_parent import WarmParent
from trailmark_bench.executors.warm import WarmParents
from trailmark_bench.process import cell_process, run_to_end
from trailmark_bench.results import frame_folder

__all__ = ["LocalExecutor"]


class LocalExecutor(Executor):
    """A process for each cell, as many at a time as ``jobs`` says; a thread waits for each.

    Cells that are alike are forked from a process that has imported what they need. One that crashes is run again as
    a program of its own: what becomes of that counts.
    """

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self._done: queue.Queue[Finished] = queue.Queue()
        self._processes: dict[str, IsolatedProcess] = {}
        self._lock = threading.Lock()
        self._threads: ThreadPoolExecutor | None = None
        self._is_closed = False
        self._parents = WarmParents()

    @property
    def slots(self) -> int:
        """Cells at a time."""
        return int(self.config.jobs or 1)

    @property
    def shares_frames(self) -> bool:
        """Whether frames are kept below the bench's folder."""
        return bool(self.config.frames_mb)

    def start(self, workspace: Path) -> None:
        """Make ready to run cells below a folder."""
        self._workspace = workspace
        self._is_closed = False
        self._threads = ThreadPoolExecutor(self.slots, thread_name_prefix="cell")

    def submit(self, job: Job) -> None:
        """Run a cell in a process of its own."""
        assert self._threads is not None
        self._threads.submit(self._run, job)

    def wait(self, timeout_s: float) -> Sequence[Finished]:
        """Return the cells that have ended."""
        try:
            found = [self._done.get(timeout=timeout_s)]
        except queue.Empty:
            return []
        while not self._done.empty():
            found.append(self._done.get_nowait())
        return found

    def close(self) -> None:
        """End all processes, and wait for them."""
        with self._lock:
            self._is_closed = True
            for process in self._processes.values():
                process.kill()
            is_idle = not self._processes
        if is_idle:  # before the threads: Linux ends a process with the thread that started it, at once
            self._parents.close()
        if self._threads is not None:
            self._threads.shutdown(wait=True, cancel_futures=True)
        self._parents.close()

    def _frames(self) -> dict[str, Any]:
        """Return where cells find frames that were rendered before."""
        if not self.shares_frames:
            return {}
        return {"frames": {"folder": str(frame_folder(self._workspace).absolute()), "limit_mb": self.config.frames_mb}}

    def _run(self, job: Job) -> None:
        folder = self._workspace / job.id
        try:
            outcome, was_warm = self._run_in(folder, job, self._parents.of(job.request) if self.config.warm else None)
            if was_warm and outcome.state == "crashed" and not self._is_closed:
                outcome, _ = self._run_in(folder, job, None)
        except Exception as error:  # the thread must answer, or the bench would wait for ever
            outcome = Outcome("failed", f"the cell could not be started: {type(error).__name__}: {error}")
            folder.mkdir(parents=True, exist_ok=True)
        if not self._is_closed:
            self._done.put(Finished(job.id, outcome, folder))

    def _run_in(self, folder: Path, job: Job, parent: WarmParent | None) -> tuple[Outcome, bool]:
        """Run a cell in an empty folder; return what became of it, and whether it was forked from a parent."""
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        process = cell_process({**job.request, **self._frames()}, folder, parent)
        with self._lock:
            if self._is_closed:
                return Outcome("crashed", "the bench has ended"), False
            self._processes[job.id] = process
        try:
            outcome = run_to_end(process, folder)
        except OSError:
            if not process.was_warm:
                raise
            return Outcome("crashed", "the process that it was forked from is lost"), True
        finally:
            with self._lock:
                self._processes.pop(job.id, None)
        return outcome, process.was_warm
