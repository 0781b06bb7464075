"""The folder of a run: where it is, that nothing is lost by it, what it holds."""

from __future__ import annotations

import re
import shutil
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from trailmark.errors import ConfigError
from trailmark.writing import DRAFTS

__all__ = ["files_in", "link_latest", "new_folder", "prepare_folder"]

# What a run writes, and may therefore replace.
_OWN = (
    "config.yaml",
    "run.json",
    "estimates.csv",
    "metrics.json",
    "timing.json",
    "beliefs.csv",
    "outlines.json",
    "report.html",
    "trajectories",
    "plots",
    "pictures",
)


def new_folder(name: str, root: Path | str = "runs") -> Path:
    """Return a folder that does not exist yet: ``runs/YYYYmmdd-HHMMSS-NAME``."""
    word = re.sub(r"[^A-Za-z0-9_.-]+", "-", name).strip("-.") or "run"
    path = Path(root) / f"{datetime.now():%Y%m%d-%H%M%S}-{word}"
    candidates = (path.with_name(f"{path.name}-{n}") for n in range(2, 1000))
    return path if not path.exists() else next(candidate for candidate in candidates if not candidate.exists())


def prepare_folder(folder: Path | str, overwrite: bool = False) -> Path:
    """Return the folder, made and free of an earlier run.

    Raises
    ------
    ConfigError
        If it is not empty and `overwrite` is not set, is a file, or cannot be made.
    """
    path = Path(folder).absolute()
    try:
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            if not overwrite:
                raise ConfigError(f"the folder {folder} is not empty; choose another, or say --overwrite")
            _clear(path)
    except OSError as error:
        raise ConfigError(f"cannot write to {folder}: {error.strerror or error}") from error
    return path


def link_latest(folder: Path) -> None:
    """Point the link ``latest`` beside the folder to it, where the file system can."""
    link = folder.parent / "latest"
    with suppress(OSError):
        if link.is_symlink():
            link.unlink()
        link.symlink_to(folder.name, target_is_directory=True)


def files_in(folder: Path) -> list[str]:
    """Return the files of a run, relative to its folder, sorted."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _clear(path: Path) -> None:
    for name in _OWN:
        target = path / name
        if target.is_dir() and not target.is_symlink():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)
    for draft in path.glob(DRAFTS):
        draft.unlink(missing_ok=True)
