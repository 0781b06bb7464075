"""Calls as cells: functions in processes of their own, whose answers outlive an interrupted program.

``trailmark reproduce`` runs the independent runs of an experiment this way. A call is addressed by its function and its
arguments; an answer that is there is taken where the code that its process had loaded is as it was. Where it is not,
all answers of the folder are forgotten: calls may read what others of them wrote. Answers are JSON
(`trailmark.isolation.plain`), in the folder of the experiment.
"""

from __future__ import annotations

import builtins
import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from trailmark import errors
from trailmark.errors import RunError
from trailmark.isolation.fingerprint import digest_of
from trailmark.isolation.loaded_code import is_as_loaded, loaded_code
from trailmark.isolation.plain import from_plain_bytes, to_plain_bytes
from trailmark.isolation.process import IsolatedProcess

__all__ = [
    "ANSWER_FILE",
    "ARGUMENTS_FILE",
    "call_in_cells",
    "forget_calls",
    "keep_answer",
    "read_plain",
    "write_plain",
]

T = TypeVar("T")

ARGUMENTS_FILE = "arguments.json"
ANSWER_FILE = "answer.json"
CODE_FILE = "code.json"

_DAY_S = 86400.0


def call_in_cells(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    folder: Path,
    jobs: int = 1,
    report: Callable[[str], None] = lambda line: None,
) -> list[T]:
    """Call a function with each tuple of arguments, and return the answers in order.

    Parameters
    ----------
    function : callable
        At the top of a module.
    arguments : sequence of tuple
        Plain data, as the answers are: numbers, text, containers, arrays, and dataclasses of Trailmark or of the
        function's own package.
    folder : Path
        Keeps answers; those that are there are taken.
    jobs : int
        1: here, one after the other; more: each call in a process, so many at a time.
    report : callable
        Takes one line of progress.

    Raises
    ------
    Exception
        What the first failing call raised; calls that have not begun are dropped then, those in work are ended. The
        answers of the others are kept.
    """
    package = function.__module__.partition(".")[0]
    name = f"{function.__module__}:{function.__qualname__}"
    places = [folder / digest_of([name, json.loads(to_plain_bytes(call))])[:20] for call in arguments]
    if any(_has_changed(place) for place in folder.glob("*")):
        forget_calls(folder)
    known = sum(_is_known(place) for place in places)
    if known:
        report(f"{known} of {len(places)} answers of an interrupted run are taken")
    if jobs == 1:
        return [_here(function, call, place, package) for call, place in zip(arguments, places, strict=True)]
    once = dict(zip(places, arguments, strict=True))  # equal calls have one folder, and one answer
    answers = dict(zip(once, _Round(name, package, jobs).run(list(once.values()), list(once)), strict=True))
    return [answers[place] for place in places]


def forget_calls(folder: Path) -> None:
    """Forget answers: what comes next begins anew."""
    shutil.rmtree(folder, ignore_errors=True)


def _here(function: Callable[..., T], call: tuple[Any, ...], place: Path, package: str) -> T:
    with suppress(RunError):  # what cannot be read is done again
        if _is_known(place):
            known: T = read_plain(place / ANSWER_FILE, package)
            return known
    answer = function(*call)
    place.mkdir(parents=True, exist_ok=True)
    with suppress(TypeError):  # what cannot be kept is not
        keep_answer(place, answer, package)
    return answer


def _is_known(place: Path) -> bool:
    """Return whether there is an answer, and the code is known that it rests on: it has not changed."""
    return (place / ANSWER_FILE).is_file() and (place / CODE_FILE).is_file()


def _has_changed(place: Path) -> bool:
    """Return whether code has changed that an answer rests on, or nobody can read which that was."""
    try:
        return not is_as_loaded(json.loads((place / CODE_FILE).read_text(encoding="utf-8")))
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError, AttributeError, TypeError):
        return True


def keep_answer(place: Path, answer: Any, package: str) -> None:
    """Write an answer, and the code that was loaded to find it, if that is known; `TypeError` if it is no plain data.

    Parameters
    ----------
    place : Path
        Folder of the call.
    answer : plain data
        What the function returned.
    package : str
        The function's.
    """
    from trailmark.plugins import load_plugins

    plugins = {spec.target.partition(":")[0].partition(".")[0] for spec in load_plugins().registry.specs()}
    code = loaded_code(package, {"trailmark", *plugins})
    for name in (CODE_FILE, ANSWER_FILE):
        (place / name).unlink(missing_ok=True)
    write_plain(place / ANSWER_FILE, answer)
    if code is not None:
        _write_whole(place / CODE_FILE, json.dumps(code).encode())


def write_plain(path: Path, value: Any) -> None:
    """Write a value so that it is there as a whole or not at all; `TypeError` if it is no plain data."""
    _write_whole(path, to_plain_bytes(value))


def _write_whole(path: Path, content: bytes) -> None:
    draft = path.with_name(f"{path.name}.part")
    draft.write_bytes(content)
    draft.replace(path)


class _Round:
    """Calls in processes, some at a time."""

    def __init__(self, name: str, package: str, jobs: int) -> None:
        self._name = name
        self._package = package
        self._jobs = jobs
        self._processes: set[IsolatedProcess] = set()

    def run(self, arguments: Sequence[tuple[Any, ...]], places: Sequence[Path]) -> list[Any]:
        with ThreadPoolExecutor(self._jobs, thread_name_prefix="call") as threads:
            futures = [threads.submit(self._one, call, place) for call, place in zip(arguments, places, strict=True)]
            try:
                done, _ = wait(futures, return_when=FIRST_EXCEPTION)
                for future in futures:
                    if future in done:
                        future.result()  # raises what the first failing call raised
                return [future.result() for future in futures]
            except BaseException:
                threads.shutdown(wait=False, cancel_futures=True)
                for process in tuple(self._processes):
                    process.kill()
                raise

    def _one(self, call: tuple[Any, ...], place: Path) -> Any:
        with suppress(RunError):
            if _is_known(place):
                return read_plain(place / ANSWER_FILE, self._package)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        write_plain(place / ARGUMENTS_FILE, call)
        request = {"function": self._name, "limits": {"timeout_s": _DAY_S, "threads": None}}
        process = IsolatedProcess(request, place, module="trailmark.isolation.call")
        self._processes.add(process)
        outcome = process.run()
        self._processes.discard(process)
        if outcome.state != "ok":
            raise _error_of(place, f"{self._name}{_call_as_text(call)} {outcome.state}: {outcome.reason}")
        return read_plain(place / ANSWER_FILE, self._package)


def _error_of(place: Path, story: str) -> Exception:
    """Return what a call raised, as far as it is an error of Python's own or of Trailmark."""
    try:
        told = json.loads((place / "error.json").read_text(encoding="utf-8"))
        found = getattr(builtins if told["module"] == "builtins" else errors, told["name"])
        if isinstance(found, type) and issubclass(found, Exception):
            made: Exception = found(told["message"])
            return made
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        pass
    return RunError(story)


def _call_as_text(call: tuple[Any, ...]) -> str:
    text = repr(call)
    return text if len(text) <= 120 else f"{text[:117]}..."


def read_plain(path: Path, package: str) -> Any:
    """Return what a file of `write_plain` holds; its classes are of Trailmark or of one other package.

    Raises
    ------
    RunError
        If there is anything else in it, or it cannot be read.
    """
    try:
        return from_plain_bytes(path.read_bytes(), package)
    except (OSError, ValueError) as error:
        raise RunError(f"{path} holds no answer that can be read: {error}") from error
