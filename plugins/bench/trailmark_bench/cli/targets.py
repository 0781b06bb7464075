"""Where the commands of a bench may write: nothing that stands there is replaced unless that was asked for."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from trailmark.errors import ConfigError

__all__ = ["is_stream", "refuse_standing_file", "refuse_strange_folder"]

# What the title of a bench's page ends with stands near its begin.
_TITLE_END, _N_READ = b", a Trailmark bench</title>", 65536
_OPENED = ("/dev/stdout", "/dev/stderr")


def is_stream(path: Path) -> bool:
    """Return whether a path is of no file that could be replaced: a device, or what the shell has opened."""
    is_opened = str(path) in _OPENED or path.is_relative_to("/dev/fd") or path.is_relative_to("/proc")
    return is_opened or (path.exists() and not path.is_file())


def refuse_standing_file(path: Path, overwrite: bool) -> None:
    """Refuse to replace a file.

    Raises
    ------
    ConfigError
        If there is one, and `overwrite` is not set.
    """
    if path.exists() and not is_stream(path) and not overwrite:
        raise ConfigError(f"{path} is there already; choose another --to, or --overwrite")


def refuse_strange_folder(folder: Path, overwrite: bool) -> None:
    """Refuse to write a site beside files of somebody else; an earlier site of a bench is renewed.

    Raises
    ------
    ConfigError
        If there are some, and `overwrite` is not set.
    """
    if overwrite or not folder.is_dir() or not any(folder.iterdir()) or _is_page(folder / "index.html"):
        return
    raise ConfigError(f"{folder} is not empty, and no site of a bench; choose another --to, or --overwrite")


def _is_page(file: Path) -> bool:
    with suppress(OSError), file.open("rb") as page:
        return _TITLE_END in page.read(_N_READ)
    return False
