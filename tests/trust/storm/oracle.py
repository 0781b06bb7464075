"""What is a finding: everything that a user should never see."""

from __future__ import annotations

import json
import re
import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

__all__ = ["GOOD_STORE", "N_WAYPOINTS", "Ending", "findings_of", "n_waypoints"]

PATIENCE_S = 10.0  # of processor time; the machine may have other things to do
MEMORY_MIB = 2048.0
GOOD_STORE = "good.trail"
N_WAYPOINTS = 12

# Words of Python, numpy and the libraries about their own inside: they tell a user nothing.
_INSIDE = re.compile(
    r"object at 0x|<class '|NoneType|list index|index out of range|unhashable|not subscriptable|broadcast|"
    r"unsupported operand|has no attribute|takes \d+ positional|unexpected keyword|missing \d+ required|"
    r"KeyError|IndexError|TypeError|AttributeError|ZeroDivision|OverflowError|RecursionError|AssertionError|"
    r"UnicodeDecodeError|UnicodeEncodeError|MemoryError|codec can't|maximum recursion|math domain|errno|"
    r"cannot convert float|invalid literal|could not convert|SVD did not|Singular matrix|must be real number|"
    r"RuntimeWarning|DeprecationWarning|divide by zero|invalid value encountered|overflow encountered",
    re.IGNORECASE,
)
_SHORTEST = 12  # letters behind "trailmark: "; fewer cannot say what and where


@dataclass(frozen=True, slots=True)
class Ending:
    """How a command ended.

    Attributes
    ----------
    arguments : tuple of str
        The command.
    code : object
        Its exit code; a string for an exception that left the program.
    out, err : str
        What it said.
    cpu_s, peak_mib : float
        What it took.
    was_stopped : bool
        Whether it had to be.
    """

    arguments: tuple[str, ...]
    code: object
    out: str
    err: str
    cpu_s: float
    peak_mib: float
    was_stopped: bool = False


def findings_of(ending: Ending, folder: Path) -> list[str]:
    """Return what is wrong with how a command ended, and with what it left in its folder."""
    said = ending.out + ending.err
    found = []
    if ending.was_stopped:
        return [f"still at it after {PATIENCE_S:g} s of processor time"]
    if ending.code not in (0, 1, 2):
        found.append(f"ended with {ending.code!r}")
    if ending.peak_mib > MEMORY_MIB:
        found.append(f"took {ending.peak_mib:.0f} MiB")
    bugs = ("Traceback (most", "internal error")
    found += [f"said {words!r}" for words in bugs if words in said]
    has_answered = ending.arguments[:2] == ("store", "check") and bool(ending.out.strip())  # what is wrong, as a table
    if ending.code in (1, 2) and not has_answered:
        found += _unclear(ending.err)
    inside = _INSIDE.search(ending.err)
    if inside is not None:
        found.append(f"said {inside.group()!r}")
    if ending.code == 0 and "run" in ending.arguments[:1]:
        found += _silent(ending, folder)
    if "overwrite" not in " ".join(ending.arguments) and (folder / GOOD_STORE).exists():
        left = n_waypoints(folder / GOOD_STORE)
        if left < N_WAYPOINTS:
            found.append(f"{left} of {N_WAYPOINTS} waypoints are left")
    return found


def _unclear(err: str) -> list[str]:
    """A failure says what is wrong and where, in a line of its own."""
    lines = [line for line in err.splitlines() if line.strip() and "WARNING" not in line]
    if not lines:
        return ["failed without a word"]
    last = re.sub(r"^trailmark[a-z ]*: ", "", lines[-1])
    if len(last) < _SHORTEST or last.rstrip().endswith((": :", ": .")):
        return [f"failed with hardly a word: {lines[-1]!r}"]
    return []


def _silent(ending: Ending, folder: Path) -> list[str]:
    """A run that ended well has used something, or says that it has not."""
    if "WARNING" in ending.err:
        return []
    for path in folder.glob("**/run.json"):
        with suppress(ValueError, KeyError, TypeError, AttributeError):
            counters = json.loads(path.read_text())["counters"]
            if not counters.get("frames"):
                return ["a run without a frame ended well, without a word"]
            spoken = [key for key in counters if key.startswith("localizer.")]
            if spoken and not any(counters[key] for key in spoken if key.endswith(".accepted")):
                return ["a run in which nothing was used ended well, without a word"]
    return []


def n_waypoints(path: Path) -> int:
    """Return how many waypoints a store holds, read without the program; 0 where it cannot be read."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(path)) as store:
        return int(store.execute("SELECT count(*) FROM waypoints").fetchone()[0])
    return 0
