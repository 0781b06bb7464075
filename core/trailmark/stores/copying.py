"""Copying a path store, also one that a writer is at."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from trailmark.errors import StoreError
from trailmark.stores import tables
from trailmark.stores.database import check_replaceable, sync_folder
from trailmark.stores.faults import store_errors
from trailmark.stores.files import open_for_reading
from trailmark.stores.writer import WriterMark, connect, side_files

__all__ = ["copy_store"]


def copy_store(path: Path, target: Path, *, replaces: bool = False) -> int:
    """Copy everything that is committed into one file; the writer, if there is one, goes on.

    A copy made by other means while a path is taught lacks what stands in the writer's log beside the file.

    Parameters
    ----------
    path, target : Path
        The store, and the new file; it appears when it is whole.
    replaces : bool
        Whether a path store may stand at `target`.

    Returns
    -------
    int
        How many waypoints the copy holds.

    Raises
    ------
    StoreError
        If there is no store, or something stands at `target` that may not be replaced.
    """
    if path == target:
        raise StoreError(f"{path} cannot be copied onto itself")
    if not target.parent.is_dir():
        raise StoreError(f"no folder {target.parent} for the copy {target.name}; make it first")
    connection, _, clean_up = open_for_reading(path)
    draft = target.with_name(target.name + ".new")
    mark = WriterMark(target)
    try:
        mark.take()
        with store_errors(target):
            if target.exists():
                check_replaceable(target, replaces, "take another name, or replace it by --overwrite")
            draft.unlink(missing_ok=True)
            with contextlib.closing(connect(draft, "rwc")) as copy:
                connection.backup(copy)
                copy.execute("PRAGMA journal_mode = DELETE")
                n_waypoints = tables.read_totals(copy).waypoints
            for file in side_files(target):
                file.unlink()
            os.replace(draft, target)
            sync_folder(target.parent)
    finally:
        mark.give_back()
        draft.unlink(missing_ok=True)
        connection.close()
        clean_up()
    return n_waypoints
