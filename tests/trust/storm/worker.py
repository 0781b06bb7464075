"""A worker: runs cases in its own process, one after the other, and says how each ended.

::

    python -m tests.trust.storm.worker BOX          # "TARGET NUMBER PATIENCE" a line in, a JSON document a line out
"""

from __future__ import annotations

import gc
import json
import logging
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from io import BytesIO, TextIOWrapper
from pathlib import Path

import numpy as np
from tests.trust.storm.box import Box
from tests.trust.storm.cases import TARGETS
from tests.trust.storm.oracle import PATIENCE_S, Ending, findings_of

__all__ = ["run_case"]

_COLLECT_EVERY = 25  # cases
_MOST_BYTES = 8 * 2**30  # of addresses: numba and OpenCV reserve much and use little


class _Stopped(BaseException):
    """A case took too long."""


def run_case(
    target: str, number: int, box: Box, *, keep: Path | None = None, patience_s: float | None = None
) -> tuple[Ending, list[str]]:
    """Run a case; what it said, and what is wrong with that."""
    rng = np.random.default_rng([zlib.crc32(target.encode()), number])
    base = "/dev/shm" if os.path.isdir("/dev/shm") else None
    parent = Path(tempfile.mkdtemp(prefix="storm-", dir=base))
    folder = parent / "work"
    folder.mkdir()
    try:
        arguments, odd = TARGETS[target](rng, folder, box)
        if keep is not None:
            shutil.copytree(folder, keep, symlinks=True, ignore=_no_pipes)
        ending = _called(arguments, odd, folder, PATIENCE_S if patience_s is None else patience_s)
        found = findings_of(ending, folder)
        if sorted(entry.name for entry in parent.iterdir()) != ["work"]:
            found.append(f"wrote outside of its folder: {sorted(entry.name for entry in parent.iterdir())}")
        return ending, found
    finally:
        shutil.rmtree(parent, ignore_errors=True)


def _no_pipes(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if Path(folder, name).is_fifo()]


def _called(arguments: list[str], odd: dict[str, str | None], folder: Path, patience_s: float) -> Ending:
    from trailmark.cli import main

    out, err = _Text(), _Text()
    logging.getLogger().handlers.clear()
    logging.getLogger().setLevel(logging.WARNING)
    _forget_peak()
    began_s, was_stopped, code = time.process_time(), False, "no exit"
    with _surroundings(odd, folder), redirect_stdout(out), redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("default")
        try:
            with _limited_time(patience_s) as rung:
                try:
                    main(arguments)
                except SystemExit as end:
                    code = 0 if end.code is None else end.code
                except _Stopped:
                    pass
                except BaseException:
                    code = traceback.format_exc(limit=-4)
        except _Stopped:
            pass
        was_stopped = bool(rung)
    return Ending(
        tuple(arguments), code, out.text(), err.text(), time.process_time() - began_s, _peak_mib(), was_stopped
    )


class _Text(TextIOWrapper):
    """A terminal's other end: text with a buffer below, as programs find it, that can be closed and read."""

    def __init__(self) -> None:
        self._bytes = BytesIO()
        super().__init__(self._bytes, encoding="utf-8", errors="backslashreplace", write_through=True)

    def close(self) -> None:
        """Stay readable."""

    def text(self) -> str:
        """Return what was written."""
        return self._bytes.getvalue().decode("utf-8", "replace")


@contextmanager
def _surroundings(odd: dict[str, str | None], folder: Path) -> Iterator[None]:
    before, where = dict(os.environ), Path.cwd()
    os.environ["COLUMNS"] = "100"
    for name, value in odd.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    tempfile.tempdir = None
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(where)
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)
        tempfile.tempdir = None


@contextmanager
def _limited_time(patience_s: float) -> Iterator[list[bool]]:
    rung: list[bool] = []

    def ring(*_: object) -> None:
        rung.append(True)
        signal.setitimer(signal.ITIMER_PROF, 1.0)  # again, if what is caught inside goes on
        raise _Stopped

    before = {number: signal.getsignal(number) for number in (signal.SIGPROF, signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, patience_s)
    try:
        yield rung
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _forget_peak() -> None:
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mib() -> float:
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Serve cases until there are no more."""
    import cv2

    cv2.setNumThreads(1)
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_BYTES, _MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    lines, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    null = os.open("/dev/null", os.O_RDWR)
    for number in (0, 1, 2):  # what C libraries say
        os.dup2(null, number)
    sys.stdin = open("/dev/null")  # noqa: SIM115
    box = Box(Path(sys.argv[1]))
    for n_cases, line in enumerate(lines):
        if n_cases % _COLLECT_EVERY == _COLLECT_EVERY - 1:
            gc.collect()
        if n_cases == 1:
            gc.freeze()  # what is imported stays: to look through it costs more than a case
        target, number, patience_s = line.split()
        try:
            ending, found = run_case(target, int(number), box, patience_s=float(patience_s))
        except Exception:
            print(json.dumps({"broken": traceback.format_exc()}), file=answers, flush=True)
            continue
        answer = {
            "code": str(ending.code)[-2000:],
            "cpu_s": ending.cpu_s,
            "peak_mib": ending.peak_mib,
            "findings": found,
        }
        answer["call"] = " ".join(ending.arguments)[:500]
        if found:
            answer["said"] = ending.err[-1500:]
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
