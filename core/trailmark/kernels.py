"""How kernels are compiled: numba's options in one place, for every plugin.

Import this only from modules that hold kernels. It imports numba, which takes longer than the rest of a command.
"""

from __future__ import annotations

import gc
import logging
import re
import uuid
from collections.abc import Callable
from functools import partial
from numbers import Number
from typing import Any, Literal, TypeVar, overload

import numba
from numba.core import event as numba_event

__all__ = ["float_kernel", "inlined_kernel", "inner_kernel", "is_kept", "kernel"]

logger = logging.getLogger(__name__)

_Function = TypeVar("_Function", bound=Callable[..., object])
_ErrorModel = Literal["python", "numpy"]
_njit: Any = numba.njit  # numba's newer versions have types, which know only a part of its options
_register: Any = numba_event.register  # and this has none

#: What lets float sums and products run in vectors. Infinities and NaN keep their meaning.
_REORDER = frozenset({"reassoc", "contract", "nsz", "arcp"})


class _QuietCollector(numba_event.Listener):
    """Lets Python's search for garbage rest while numba compiles, which makes millions of small objects at a time.

    Nothing of a kernel is garbage before it is done, and to look for it again and again took an eighth of the time.
    Numba compiles one kernel at a time, with its inner ones, whatever thread asks for it.
    """

    def __init__(self) -> None:
        self._depth, self._was_on = 0, False

    def on_start(self, event: numba_event.Event) -> None:
        """Rest from the outermost kernel on."""
        if self._depth == 0:
            self._was_on = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: numba_event.Event) -> None:
        """Go on after the outermost kernel."""
        self._depth -= 1
        if self._depth == 0 and self._was_on:
            gc.enable()


_register("numba:compile", _QuietCollector())


@overload
def kernel(function: _Function, /) -> _Function: ...
@overload
def kernel(*, error_model: _ErrorModel) -> Callable[[_Function], _Function]: ...
def kernel(
    function: _Function | None = None, /, *, error_model: _ErrorModel = "python"
) -> _Function | Callable[[_Function], _Function]:
    """Compile a function with numba: without the interpreter's lock, and kept on disk between runs.

    The same numbers come out on all processors of one kind, bit by bit. Numba compiles at the first call, once for each
    combination of argument types. What it kept is used until the file of the kernel changes: after a change in another
    file whose kernels it calls, save its own file too, or delete ``*.nbi`` in ``__pycache__``.

    Parameters
    ----------
    function : callable
        A pure function of arrays and numbers.
    error_model : {"python", "numpy"}
        What a division by zero does. ``python`` raises `ZeroDivisionError`; ``numpy`` gives infinity or NaN. The test
        for zero keeps loops that divide from running in vectors.

    Returns
    -------
    callable
        The compiled function. Where no folder can be written (a read-only installation without a home), it is
        compiled in every run.

    Examples
    --------
    >>> import numpy as np
    >>> @kernel
    ... def largest_step(values):
    ...     largest = 0.0
    ...     for i in range(1, len(values)):
    ...         largest = max(largest, abs(values[i] - values[i - 1]))
    ...     return largest
    >>> largest_step(np.array([0.0, 1.0, 3.0]))
    2.0
    """
    decorate = _compiler(nogil=True, error_model=error_model)
    return decorate if function is None else decorate(function)


def float_kernel(function: _Function) -> _Function:
    """Compile like `kernel`, and let the order of float sums change: last digits may differ between processors.

    Sums over floats then run in vectors. Infinities, NaN and their comparisons stay what they are, unlike under
    numba's ``fastmath=True``.

    A kernel that calls it gets a copy of its own, compiled with the options of the caller: a kernel that calls float
    kernels should be one. Two libraries must not share such a function: its last digits depend on what it is compiled
    together with, and the loader takes the copy that comes first, which another one is in a run that compiles than in
    one that finds all kernels on disk.
    """
    return _compiler(nogil=True, fastmath=set(_REORDER), inline="always")(function)


def inner_kernel(function: _Function, error_model: _ErrorModel = "python") -> _Function:
    """Compile like `kernel` a function that kernels alone call: without an entry for Python, which costs time.

    Called from Python it raises `TypeError`.
    """
    compiled: Any = _compiler(nogil=True, no_cpython_wrapper=True, error_model=error_model)(function)
    if hasattr(compiled, "py_func"):  # and numba is not switched off
        compiled._insert = _without_entry  # numba's table of entries: it would call an address that is zero
        compiled._compile_for_args = partial(_refuse_python, function.__name__)  # asked for what is not in the table
    inner: _Function = compiled
    return inner


def _without_entry(*_: object) -> None:
    """Take no note of an entry that does not exist."""


def _refuse_python(name: str, *_: object, **__: object) -> None:
    raise TypeError(f"the kernel {name} has no entry for Python: make it a 'kernel', or call its py_func")


def inlined_kernel(function: _Function) -> _Function:
    """Compile a function into each kernel that calls it, so that its loops see arrays that nothing else points to.

    It is compiled with the options of the kernel that calls it, and kept with it.
    """
    compiled: _Function = _njit(inline="always", nogil=True)(function)
    return compiled


def is_kept(function: object) -> bool:
    """Whether a kernel need not be compiled: it is kept on disk, for some types of arguments, or is plain Python."""
    cache_file = _cache_file_of(function)
    return cache_file is None or bool(cache_file._load_index())


def _cache_file_of(compiled: object) -> Any:
    """Return where numba keeps a kernel; None: numba is switched off, or nothing is kept."""
    return getattr(getattr(compiled, "_cache", None), "_cache_file", None)


def _compiler(**options: Any) -> Callable[[_Function], _Function]:
    def compile_function(function: _Function) -> _Function:
        # no_cfunc_wrapper: the entry for callers in C would be compiled too, and there are none
        compiled: _Function
        try:
            compiled = _njit(cache=_name_variant(function), no_cfunc_wrapper=True, **options)(function)
            _survive_renamed_records(compiled)
            _name_files_apart(compiled)
        except RuntimeError as error:  # numba found no folder that it can write
            logger.info("kernel %s cannot be cached: %s", function.__name__, error)
            compiled = _njit(no_cfunc_wrapper=True, **options)(function)
        return compiled

    return compile_function


def _name_variant(function: Any) -> bool:
    """Name a kernel that is made anew for other numbers after these numbers; return whether it may be kept on disk.

    Numba tells such variants apart by a count, which begins at one in each process: a variant that is compiled now and
    another one that was kept by an earlier process would be one to the loader. One that holds what has no short name (a
    table, another kernel) is compiled in every run.
    """
    held = [cell.cell_contents for cell in function.__closure__ or ()]
    if not all(value is None or isinstance(value, (str, Number)) for value in held):
        logger.info("kernel %s holds more than numbers and words: it is not kept on disk", function.__qualname__)
        return False
    if held:
        numbers = "_".join(f"{name}_{value}" for name, value in zip(function.__code__.co_freevars, held))
        function.__qualname__ = f"{function.__qualname__}_{re.sub(r'[^0-9A-Za-z.+-]', '_', numbers)}"
    return True


def _survive_renamed_records(compiled: Any) -> None:
    """Make a kernel compile anew when its cache names a class that is gone.

    Numba reads the records (named tuples) of a signature before it asks whether the kernel's file has changed since, so
    that a cache of an older version would end the program.
    """
    cache_file = _cache_file_of(compiled)
    if cache_file is None:
        return
    load_index = cache_file._load_index

    def load_index_or_nothing() -> Any:
        try:
            return load_index()
        except (AttributeError, ImportError) as error:
            logger.info("kernel %s is compiled anew: %s", compiled.__name__, error)
            return {}

    cache_file._load_index = load_index_or_nothing


def _name_files_apart(compiled: Any) -> None:
    """Give each code of a kernel that is kept a file name that no other process gives.

    Numba names files by a count, and its index, which says what types of arguments a file is for, has no lock: of two
    processes that keep a code each at once, both would write the first file, and the index may name the types of the
    other. Now the index may lack one of them, which is then compiled again.
    """
    cache_file = _cache_file_of(compiled)
    if cache_file is not None:
        base = cache_file._index_name.removesuffix(".nbi")
        cache_file._data_name = lambda _: f"{base}.{uuid.uuid4().hex[:16]}.nbc"
