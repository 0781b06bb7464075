"""Runs cases by the thousand in workers that are started again when they die, and prints a part of the page."""

from __future__ import annotations

import argparse
import os
import platform
import queue
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from tests.trust.records import CaseRecord, Records, commit
from tests.trust.storm.box import Box
from tests.trust.storm.cases import TARGETS
from tests.trust.storm.oracle import MEMORY_MIB, PATIENCE_S
from tests.trust.storm.workers import WAITING_S, Worker

import trailmark

__all__ = ["main"]

_COMPILING_S = 100.0


def run_all(cases: list[tuple[str, int]], box: Path, n_workers: int, until_s: float, records: Records) -> None:
    """Run cases in workers, and record what becomes of them, until they are done, or it is late."""
    waiting: queue.SimpleQueue[tuple[str, int]] = queue.SimpleQueue()
    for case in cases:
        waiting.put(case)
    lock, code = threading.Lock(), commit()

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
                    records.add(_record_of(target, number, answer, code))
        finally:
            worker.close()

    threads = [threading.Thread(target=serve) for _ in range(n_workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _record_of(target: str, number: int, answer: dict[str, Any], code: str) -> CaseRecord:
    findings = []
    for finding in answer["findings"]:
        words = f"{target} {number}: {finding}: {answer.get('call', '')}\n    {answer.get('said', '').strip()[-700:]}"
        if "Traceback" in answer["code"]:
            words += f"\n    {answer['code']}"
        findings.append(words)
        print(words, flush=True)
    ended = answer["code"] if answer["code"] in ("0", "1", "2") else "other"
    peak_mib = round(answer["peak_mib"], 1)
    return CaseRecord(target, number, ended, round(answer["cpu_s"], 3), peak_mib, tuple(findings), code)


def page(records: Records, command: str) -> str:
    """Return the results as a part of a page."""
    tried = records.tallies()
    n_findings, cpu_s = sum(len(t.findings) for t in tried.values()), sum(record.cpu_s for record in records)
    about = f"{time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, Python {platform.python_version()}"
    lines = [
        f"`{command}`, {about}.",
        f"{len(records)} whole commands in {cpu_s / 60:.0f} min of processor time, of code {records.commits()}: "
        f"{n_findings} findings.",
        "A finding is a traceback, an internal error, words of Python about its own inside, a failure without words,",
        f"an exit code other than 0, 1 and 2, more than {PATIENCE_S:g} s of processor time, or {WAITING_S:g} s of",
        f"doing nothing, more than {MEMORY_MIB:.0f} MiB, a waypoint of a good store that is gone, a file outside of",
        "the folder, or a run that used nothing and ended well without a warning.",
        "",
        "| commands with | cases | exit 0 | exit 1 | exit 2 | slowest [s] | most memory [MiB] | findings |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name, tally in tried.items():
        codes = " | ".join(str(tally.ended[code]) for code in ("0", "1", "2"))
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
    parser.add_argument("--record", type=Path, help="file to keep each case in; what it has passed is not run again")
    options = parser.parse_args()
    names = options.only or list(TARGETS)
    each = -(-options.cases // len(names))
    with tempfile.TemporaryDirectory(prefix="storm-box-") as folder:
        box = Path(folder) / "box"
        Box(box)
        if options.keep is not None:
            return _show(names[0], options.first, box, options.keep)
        records = Records(options.record)
        numbers = range(options.first, options.first + each)
        cases = [(name, n) for n in numbers for name in names if not records.has_passed(name, n)]
        run_all(cases, box, options.workers, time.time() + 60 * options.minutes, records)
    print(page(records, f"python -m tests.trust.storm --first {options.first} --cases {options.cases}"))
    return int(any(record.findings for record in records))


def _show(target: str, number: int, box: Path, keep: Path) -> int:
    from tests.trust.storm.worker import run_case

    ending, found = run_case(target, number, Box(box), keep=keep)
    print("trailmark", *ending.arguments)
    print(ending.out, ending.err, f"exit {ending.code}", *found, sep="\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
