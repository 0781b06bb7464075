"""Signals at random instants of starting, driving and ending a run: is it gone in two seconds, and the robot stopped?

::

    python -m tests.signals.trial --signals 220

On a busy machine the wall says what the machine did. So it says too how long the main thread was ready to run and had
no processor (the kernel's ``schedstat``): without that is what the program itself took.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.signals.conftest import CONFIG, Child

from trailmark.evaluation import read_run

_NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
_LATEST_S = 5.0  # after the start; on a machine that is free, a run of three seconds has ended by then
_LOOK_S = 0.01


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a run that got a signal.

    Attributes
    ----------
    code : int
        Its exit code, or minus the signal that ended it as the system does.
    took_s : float
        From the signal until the process was gone [s].
    waited_s : float
        Of which the main thread was ready, and others had the processor [s].
    problem : str
        What is wrong with the robot's last command or the run's folder; empty: nothing.
    """

    code: int
    took_s: float
    waited_s: float
    problem: str


def outcome_of(rng: np.random.Generator, folder: Path) -> Outcome:
    """Start a run, send a signal at a random instant, a third of them twice, and look at what is left."""
    command = "run" if rng.random() < 0.7 else "teach"
    (folder / "c.yaml").write_text(CONFIG)
    store = ("--store", "a.trail") if command == "teach" else ()
    n_frames = int(rng.choice([60, 1_000_000]))
    child = Child(folder, command, "c.yaml", "--out", "out", *store, "--set", f"sources.robot.n={n_frames}")
    time.sleep(rng.uniform(0.0, _LATEST_S))
    number = int(rng.choice(_NUMBERS))
    waited_s = _waited_s(child.process.pid)
    child.send(number)
    began_s, is_repeated = time.monotonic(), rng.random() < 1 / 3
    ended = os.pidfd_open(child.process.pid)
    last_s = waited_s
    while not select.select([ended], [], [], _LOOK_S)[0]:
        last_s = max(last_s, _waited_s(child.process.pid))
        if is_repeated and time.monotonic() - began_s > 0.4:
            is_repeated = False
            child.process.send_signal(number)
    took_s = time.monotonic() - began_s
    os.close(ended)
    child.process.communicate(timeout=10.0)
    return Outcome(child.process.returncode, took_s, last_s - waited_s, _problem(child))


def _waited_s(pid: int) -> float:
    """Return how long the main thread of a process was ready to run, and did not [s]."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[1]) / 1e9
    return 0.0


def _problem(child: Child) -> str:
    told = child.told()
    moved = [line for line in told if line.startswith("drive")]
    if moved and not moved[-1].startswith("drive Stop"):
        return f"the robot was last told {moved[-1]!r}"
    if (child.folder / "out/run.json").exists() and child.run_document()["status"] == "running":
        return "run.json says that it is running"
    if (child.folder / "out/run.json").exists() and (problems := read_run(child.folder / "out").problems):
        return "; ".join(problems)
    return ""


def main() -> int:
    """Send the signals and print what became of them; return 1 if a robot was not stopped or a file was cut."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--signals", type=int, default=220)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="send no signal after this")
    chosen = parser.parse_args()
    rng, until_s, outcomes = np.random.default_rng(chosen.seed), time.time() + 60 * chosen.minutes, []
    while len(outcomes) < chosen.signals and time.time() < until_s:
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(outcome_of(rng, Path(folder)))
        if (last := outcomes[-1]).problem or last.took_s - last.waited_s > 2.0:
            print(f"signal {len(outcomes)}: {last}", flush=True)
    took = np.array([one.took_s for one in outcomes])
    own = took - np.array([one.waited_s for one in outcomes])
    codes = ", ".join(f"{n} x {code}" for code, n in sorted(Counter(one.code for one in outcomes).items()))
    print(f"{len(outcomes)} signals; exit codes {codes}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
    for name, times in (("wall", took), ("without waiting for a processor", own)):
        quantiles = " / ".join(f"{value:.2f}" for value in np.percentile(times, [50, 95, 100]))
        print(f"{name}: median / 95 % / longest {quantiles} s; {int((times > 2.0).sum())} took more than 2 s")
    return int(any(one.problem for one in outcomes))


if __name__ == "__main__":
    sys.exit(main())
