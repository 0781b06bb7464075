"""Misbehaving parts at random: which part, which method, what it does, at which call, sync or async, step or real time.

::

    python -m tests.trust.fuzz_parts --cases 500
    python -m tests.trust.fuzz_parts --record parts.jsonl --minutes 10     # goes on where it was

A case is made from its number alone: ``--first NUMBER --cases 1`` repeats it. A finding is an error without the part's
name, one called a bug of ours, an exit code other than 1, a folder that does not say ``failed``, a part that is not
closed exactly once, or a case that takes longer than a minute.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import logging
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from tests.trust.records import CaseRecord, Records, Tally, commit

from trailmark.cli.errors import exit_code_of
from trailmark.pipeline import Pipeline
from trailmark.plugins import Plugins, load_plugins

_FILE = Path(__file__).parents[1] / "pipeline" / "wicked.py"
_LIMIT_S = 60

_METHODS = {
    "source": ("__init__", "start", "close", "sensors", "frames", "next", "counters", "accepts", "drive"),
    "fault": ("__init__", "start", "close", "believed", "apply", "counters"),
    "localizer": ("__init__", "start", "close", "observe", "latency_s", "counters", "finish"),
    "estimator": ("__init__", "start", "close", "apply", "belief", "counters"),
    "controller": ("__init__", "start", "close", "gives", "step"),
    "path_store": (
        *("__init__", "start", "close", "path", "localizer_map", "append", "commit", "mark_finished"),
        *("set_sensors", "set_meta", "add", "save"),
    ),
    "sink": ("__init__", "start", "close", "on_frame", "on_estimate_record", "on_belief", "on_command", "on_end"),
}
#: Where waiting for ever can be ended; starting, finishing and closing take their time.
_TIMED = {
    ("source", "next"),
    ("fault", "apply"),
    ("localizer", "observe"),
    ("sink", "on_frame"),
    ("controller", "step"),
}


class _TooLongError(BaseException):
    """A case has taken longer than it may."""


def case_of(number: int, wicked: ModuleType) -> tuple[dict[str, Any], str]:
    """Return the config of a case, and its story."""
    rng = np.random.default_rng([17, number])
    kind = str(rng.choice(list(_METHODS)))
    method = str(rng.choice(_METHODS[kind]))
    deeds = [*wicked.RAISES, *wicked.ANSWERS, *(wicked.HANGS if (kind, method) in _TIMED else ())]
    deed, at = str(rng.choice(deeds)), int(rng.integers(1, 4))
    keys: dict[str, dict[str, Any]] = {name: {"plugin": "wicked"} for name in _METHODS}
    keys["fault"] = {}
    keys["localizer"] |= {"async": bool(rng.random() < 0.4), "on_error": str(rng.choice(["fail", "disable"]))}
    keys[kind] |= {"method": method, "deed": deed, "at": at}
    pace = "realtime" if rng.random() < 0.2 else "step"
    config = {
        "mode": "teach",
        "pace": pace,
        "patience_s": 2.0,
        "sources": {"robot": keys["source"] | {"perturb": {"wicked": keys["fault"]}}},
        "localizers": {"floor": keys["localizer"], "other": {"plugin": "wicked"}},
        "estimator": keys["estimator"] | {"use": ["floor", "other"]},
        "path_store": keys["path_store"],
        "controller": keys["controller"],
        "sinks": [keys["sink"]],
    }
    options = f"async {keys['localizer']['async']}, {keys['localizer']['on_error']}, {pace}"
    return config, f"{kind}.{method} {deed} at call {at} ({options})"


def findings_of(config: dict[str, Any], out: Path, plugins: Plugins, wicked: ModuleType) -> tuple[str, list[str]]:
    """Run a case; return what became of it, and what is wrong with that."""
    wicked.LOG.clear()
    told = io.StringIO()
    error: BaseException | None = None
    with contextlib.redirect_stderr(told), contextlib.redirect_stdout(told):
        try:
            with Pipeline(config, out=out, plugins=plugins) as pipeline:
                for _ in pipeline:
                    pass
        except BaseException as raised:
            error = raised
            code = exit_code_of(raised)
    n = Counter(wicked.LOG)
    found = [
        f"{kind} started {n[f'{kind} start']} times and closed {n[f'{kind} close']} times"
        for kind in _METHODS
        if n[f"{kind} close"] != n[f"{kind} start"]
    ]
    status = json.loads((out / "run.json").read_text())["status"] if (out / "run.json").is_file() else "not begun"
    if error is None:
        return status, found if status == "done" else [*found, f"no error, but the run is {status}"]
    words = told.getvalue()
    if code != 1:
        found.append(f"exit code {code}: {words}")
    if (
        "This is a bug" in words
        or "Traceback" in words
        or not any(name in words for name in ("failed in", "construct"))
    ):
        found.append(words)
    if status not in ("failed", "not begun"):
        found.append(f"the run failed and its folder says {status}")
    return status, found


def try_case(number: int, plugins: Plugins, wicked: ModuleType, code: str) -> CaseRecord:
    """Run a case and return what became of it."""
    config, story = case_of(number, wicked)
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        signal.alarm(_LIMIT_S)
        try:
            status, found = findings_of(config, Path(folder) / "out", plugins, wicked)
        except BaseException as error:
            status, found = "escaped", [f"{type(error).__name__}: {error}"]
        signal.alarm(0)
    took_s = time.monotonic() - began_s
    if took_s > _LIMIT_S / 2 and not found:  # the alarm may have ended as a part's failure
        found = [f"took {took_s:.0f} s"]
    findings = tuple(f"case {number}: {story}: {line}".rstrip() for line in found)
    for finding in findings:
        print(finding, flush=True)
    return CaseRecord("parts", number, status, round(time.process_time() - began_cpu_s, 3), 0.0, findings, code)


def page(records: Records, command: str) -> str:
    """Return the results as a part of a page."""
    tally = records.tallies().get("parts", Tally())
    ended = ", ".join(f"{n} {status}" for status, n in sorted(tally.ended.items()))
    lines = [
        f"`{command}`: {tally.n} runs, of code {records.commits()}: {len(tally.findings)} findings; {ended}.",
        "In each run one method of one part raises, exits, answers what is no answer, or does not come back, from its",
        "first, second or third call on. A finding is an error without the part's name or called a bug of ours,",
        "an exit code other than 1, a folder that does not say `failed`, a part that is not closed exactly once, or a",
        f"run of more than {_LIMIT_S // 2} s.",
    ]
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run the cases, print what was found; return 1 if anything was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="begin no case after this")
    parser.add_argument("--record", type=Path, help="file to keep each case in; what it has passed is not run again")
    chosen = parser.parse_args(arguments)
    plugins = load_plugins(files=[_FILE])
    wicked = sys.modules[plugins.registry.find("sink", "wicked").load().__module__]
    logging.disable(logging.CRITICAL)

    def ring(*_: object) -> None:
        raise _TooLongError(f"longer than {_LIMIT_S} s")

    signal.signal(signal.SIGALRM, ring)
    records, code, until_s = Records(chosen.record), commit(), time.time() + 60 * chosen.minutes
    for number in range(chosen.first, chosen.first + chosen.cases):
        if time.time() > until_s:
            break
        if not records.has_passed("parts", number):
            records.add(try_case(number, plugins, wicked, code))
    print(page(records, f"python -m tests.trust.fuzz_parts --cases {chosen.cases}"))
    return int(any(record.findings for record in records))


if __name__ == "__main__":
    sys.exit(main())
