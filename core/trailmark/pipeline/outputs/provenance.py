"""Where a result comes from: versions, machine, repositories."""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import trailmark

__all__ = ["cpu_model", "git_describe", "package_versions", "provenance"]

_GIT_PATIENCE_S = 5.0


def provenance(config_dir: Path | None = None) -> dict[str, Any]:
    """Return program, command, time, machine and versions, as they stand in ``run.json``.

    Parameters
    ----------
    config_dir : Path, optional
        Folder of the config: the repository that it lies in is named too.
    """
    return {
        "trailmark": trailmark.__version__,
        "command": shlex.join(sys.argv),
        "started": datetime.now().astimezone().isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu": cpu_model(),
        "packages": package_versions(),
        "git": {
            "trailmark": git_describe(Path(trailmark.__file__).parent, dirty=True),
            "config": None if config_dir is None else git_describe(config_dir),
        },
    }


def package_versions() -> dict[str, str]:
    """Return the versions of the packages that Trailmark needs at run time, as far as they are installed."""
    try:
        wanted = metadata.requires("trailmark") or []
    except metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return {}
    at_run_time = [requirement for requirement in wanted if not re.search(r"extra\s*==\s*.dev", requirement)]
    names = {re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0].lower() for requirement in at_run_time}
    versions = {}
    for name in sorted(names - {"trailmark"}):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # of an extra that is not installed
    return versions


def cpu_model() -> str:
    """Return the name of the processor, as the system gives it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or platform.machine()
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found.group(1).strip() if found else platform.machine()


def git_describe(folder: Path, dirty: bool = False) -> str | None:
    """Return tag or commit of the repository that a folder lies in.

    A repository that came with somebody's recording may hold commands in its ``.git/config``: looking whether files
    were changed runs its filters, and a missing object would be fetched. So neither is done there.

    Parameters
    ----------
    folder : Path
        Any folder.
    dirty : bool
        Add ``-dirty`` if a file was changed; only for a repository whose code is run anyway.
    """
    command = ["git", "-C", str(folder), "-c", "core.fsmonitor=false", "-c", f"core.hooksPath={os.devnull}"]
    command += ["describe", "--always", "--tags", *(["--dirty"] if dirty else [])]
    environment = os.environ | {"GIT_NO_LAZY_FETCH": "1", "GIT_ALLOW_PROTOCOL": "none"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_GIT_PATIENCE_S, check=False, env=environment
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
