"""Errors of SQLite, translated to errors of path stores."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trailmark.errors import StoreError

__all__ = [
    "SQLITE_ERRORS",
    "Damage",
    "DamagedStoreError",
    "is_in_use",
    "primary_code",
    "store_error",
    "store_errors",
]


#: What SQLite's calls raise. Its messages quote the file, and Python then fails to decode what damage left there.
SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError)


class DamagedStoreError(StoreError):
    """A path store holds something that was not written so: flipped bits, a cut end, another program's edits."""


class Damage(Exception):
    """A row that is not as it was written; the text says which and why."""


def primary_code(error: Exception) -> int | None:
    """Return SQLite's primary result code, or None where the error is Python's own."""
    code: int | None = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def is_in_use(error: Exception) -> bool:
    """Return whether another connection stands in the way."""
    return primary_code(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


@contextmanager
def store_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite and the readers of rows raise into a `StoreError` that names the file."""
    try:
        yield
    except SQLITE_ERRORS as error:
        raise store_error(error, path) from error
    except Damage as error:
        raise _damage_error(path, str(error)) from error
    except OSError as error:
        raise StoreError(f"{path}: {error.strerror or error}") from error


def store_error(error: Exception, path: Path) -> StoreError:
    """Return the `StoreError` for an error of SQLite: what happened, and what to do."""
    code = primary_code(error)
    if isinstance(error, sqlite3.ProgrammingError):
        return StoreError(f"{path} was closed while it was in use")
    if code is None or code == sqlite3.SQLITE_CORRUPT:  # without a code: text that is no UTF-8
        return _damage_error(path, str(error))
    kept = "what was committed before is kept"
    messages = {
        sqlite3.SQLITE_NOTADB: f"{path} is not a path store, or its beginning is destroyed; check the file's name",
        sqlite3.SQLITE_BUSY: f"{path} is in use by another process; wait for it, or end it",
        sqlite3.SQLITE_LOCKED: f"{path} is in use by another process; wait for it, or end it",
        sqlite3.SQLITE_READONLY: f"{path} cannot be written: the file or its folder is read-only",
        sqlite3.SQLITE_CANTOPEN: f"cannot open {path}: check that its folder exists and may be read and written",
        sqlite3.SQLITE_FULL: f"the disk is full, {path} cannot grow; {kept}: free some space and go on with --append",
        sqlite3.SQLITE_IOERR: f"the disk fails under {path} ({error}); {kept}: check the disk and its free space",
        sqlite3.SQLITE_PERM: f"{path} may not be opened: check the permissions of the file",
    }
    return StoreError(messages.get(code, f"{path}: {error}"))


def _damage_error(path: Path, what: str) -> DamagedStoreError:
    return DamagedStoreError(f"{path} is damaged: {what}. 'trailmark store check {path}' says what can still be read")
