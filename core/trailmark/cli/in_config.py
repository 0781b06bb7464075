"""How a config names a file that a command has written."""

from __future__ import annotations

import json
import re
from pathlib import Path

__all__ = ["path_in_config"]


def path_in_config(file: Path, base_dir: Path) -> str:
    """Return the path of a file as a config in `base_dir` names it, as YAML: relative below it, absolute elsewhere.

    Parameters
    ----------
    file : Path
        A relative one starts at the working folder.
    base_dir : Path
        The config's folder.
    """
    absolute, folder = file.resolve(), base_dir.resolve()
    path = str(absolute.relative_to(folder) if absolute.is_relative_to(folder) else absolute)
    return path if re.fullmatch(r"[A-Za-z_/.][\w/.@-]*", path) else json.dumps(path, ensure_ascii=False)
