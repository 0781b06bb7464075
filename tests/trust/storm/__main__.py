"""Runs cases by the thousand in workers that are started again when they die, and writes the page."""

from __future__ import annotations

import argparse
import json
import os
import platform
import queue
import select
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.trust.storm.box import Box
from tests.trust.storm.cases import TARGETS
from tests.trust.storm.oracle import MEMORY_MIB, PATIENCE_S

import trailmark

__all__ = ["main"]

_WALL_S = 150.0  # for what waits without working; the machine may have other things to do
_CASES_PER_WORKER = 400
_COMPILING_S = 100.0


@dataclass
class Tally:
    """What became of the cases of a target."""

    n: int = 0
    codes: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    peak_mib: float = 0.0
    findings: list[str] = field(default_factory=list)


class Worker:
    """A process that runs cases; started again when it dies, hangs, or has run many."""

    def __init__(self, box: Path) -> None:
        self._box = box
        self._process: subprocess.Popen[str] | None = None
        self._n = 0

    def run(self, target: str, number: int, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Return the answer to a case; a worker that dies or does not answer is a finding."""
        if self._process is None or self._process.poll() is not None or self._n >= _CASES_PER_WORKER:
            self.close()
            command = (sys.executable, "-m", "tests.trust.storm.worker", str(self._box))
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
            )
            self._n = 0
        self._n += 1
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{target} {number} {patience_s}\n")
        self._process.stdin.flush()
        ready, _, _ = select.select([self._process.stdout], [], [], _WALL_S)
        if not ready:
            self.close()
            return {"findings": [f"no answer after {_WALL_S:g} s"], "code": "none", "cpu_s": 0.0, "peak_mib": 0.0}
        line = self._process.stdout.readline()
        if not line:
            code = self._process.wait()
            self.close()
            return {"findings": [f"the process died with {code}"], "code": "died", "cpu_s": 0.0, "peak_mib": 0.0}
        answer: dict[str, Any] = json.loads(line)
        if "broken" in answer:
            return {"findings": ["the case itself is broken"], "code": answer["broken"], "cpu_s": 0.0, "peak_mib": 0.0}
        return answer

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


def run_all(cases: list[tuple[str, int]], box: Path, n_workers: int, until_s: float) -> dict[str, Tally]:
    """Run cases in workers until they are done, or it is late."""
    tallies = {target: Tally() for target in TARGETS}
    waiting: queue.SimpleQueue[tuple[str, int]] = queue.SimpleQueue()
    for case in cases:
        waiting.put(case)
    lock = threading.Lock()

    def serve() -> None:
        worker = Worker(box)
        try:
            while time.time() < until_s:
                try:
                    target, number = waiting.get_nowait()
                except queue.Empty:
                    return
                answer = worker.run(target, number)
                if any("still at it" in one for one in answer["findings"]):
                    worker.run(target, number, _COMPILING_S)  # what is compiled on first use is not the input's fault
                    answer = worker.run(target, number)
                with lock:
                    _count(tallies[target], target, number, answer)
        finally:
            worker.close()

    threads = [threading.Thread(target=serve) for _ in range(n_workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return tallies


def _count(tally: Tally, target: str, number: int, answer: dict[str, Any]) -> None:
    tally.n += 1
    tally.codes[answer["code"] if answer["code"] in ("0", "1", "2") else "other"] += 1
    tally.slowest_s = max(tally.slowest_s, answer["cpu_s"])
    tally.peak_mib = max(tally.peak_mib, answer["peak_mib"])
    for finding in answer["findings"]:
        words = f"{target} {number}: {finding}: {answer.get('call', '')}\n    {answer.get('said', '').strip()[-700:]}"
        if "Traceback" in answer["code"]:
            words += f"\n    {answer['code']}"
        tally.findings.append(words)
        print(words, flush=True)


def page(tallies: dict[str, Tally], took_s: float, command: str) -> str:
    """Return the results as a page."""
    tried = {name: tally for name, tally in tallies.items() if tally.n}
    n, n_findings = sum(t.n for t in tried.values()), sum(len(t.findings) for t in tried.values())
    about = f"{time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, Python {platform.python_version()}"
    lines = [
        "## Whole commands",
        "",
        f"`{command}`, {about}.",
        f"{n} whole commands in {took_s / 60:.0f} min: {n_findings} findings.",
        "A finding is a traceback, an internal error, words of Python about its own inside, a failure without words,",
        f"an exit code other than 0, 1 and 2, more than {PATIENCE_S:g} s of processor time or {_WALL_S:g} s in all,",
        f"more than {MEMORY_MIB:.0f} MiB, a waypoint of a good store that is gone, a file outside of the folder, or",
        "a run that used nothing and ended well without a warning.",
        "",
        "| commands with | cases | exit 0 | exit 1 | exit 2 | slowest [s] | most memory [MiB] | findings |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name, tally in tried.items():
        codes = " | ".join(str(tally.codes[code]) for code in ("0", "1", "2"))
        input_ = (TARGETS[name].__doc__ or name).strip().rstrip(".")
        figures = f"{tally.slowest_s:.1f} | {tally.peak_mib:.0f} | {len(tally.findings)}"
        lines.append(f"| {input_[:1].lower()}{input_[1:]} | {tally.n} | {codes} | {figures} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run the cases and write the page; return 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000, help="of all targets together")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each target")
    parser.add_argument("--only", choices=sorted(TARGETS), action="append", help="only this target")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="begin no case after this")
    parser.add_argument("--keep", type=Path, help="with one case: a folder to keep its files in, and all that it said")
    parser.add_argument("--append", type=Path, help="page to write the results behind")
    options = parser.parse_args()
    names = options.only or list(TARGETS)
    each = -(-options.cases // len(names))
    with tempfile.TemporaryDirectory(prefix="storm-box-") as folder:
        box = Path(folder) / "box"
        Box(box)
        if options.keep is not None:
            return _show(names[0], options.first, box, options.keep)
        cases = [(name, number) for number in range(options.first, options.first + each) for name in names]
        began_s = time.time()
        tallies = run_all(cases, box, options.workers, began_s + 60 * options.minutes)
    text = page(tallies, time.time() - began_s, f"python -m tests.trust.storm --cases {options.cases}")
    print(text)
    if options.append:
        before = options.append.read_text(encoding="utf-8") if options.append.exists() else ""
        options.append.write_text(f"{before}\n{text}" if before else text, encoding="utf-8")
    return int(any(tally.findings for tally in tallies.values()))


def _show(target: str, number: int, box: Path, keep: Path) -> int:
    from tests.trust.storm.worker import run_case

    ending, found = run_case(target, number, Box(box), keep=keep)
    print("trailmark", *ending.arguments)
    print(ending.out, ending.err, f"exit {ending.code}", *found, sep="\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
