"""The lock on the folder of a bench."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from trailmark_bench.lock import LOCK_FILE, FolderLock

# Windows as far as this module knows it: another module of the system, and no O_NOFOLLOW.
_ON_WINDOWS = """
import os, sys, types
from pathlib import Path

held = set()

def locking(descriptor, mode, n_bytes):
    key = os.fstat(descriptor).st_ino
    if key in held:
        raise PermissionError(13, "Permission denied")
    held.add(key)

sys.modules["fcntl"] = None
sys.modules["msvcrt"] = types.SimpleNamespace(locking=locking, LK_NBLCK=2)
folder = Path(sys.argv[1])
import trailmark.errors
del os.O_NOFOLLOW
sys.platform = "win32"
from trailmark_bench.lock import FolderLock

FolderLock(folder)
try:
    FolderLock(folder)
except BlockingIOError:
    print("refused")
"""


def test_a_folder_is_locked_once_until_it_is_released(tmp_path: Path) -> None:
    lock = FolderLock(tmp_path)
    with pytest.raises(BlockingIOError):
        FolderLock(tmp_path)

    lock.release()
    lock.release()

    FolderLock(tmp_path).release()


def test_the_lock_goes_with_its_process(tmp_path: Path) -> None:
    take = "import os, sys; from pathlib import Path; from trailmark_bench.lock import FolderLock;"
    take += " lock = FolderLock(Path(sys.argv[1])); os._exit(0)"
    subprocess.run([sys.executable, "-c", take, str(tmp_path)], check=True, timeout=60)

    FolderLock(tmp_path).release()


def test_a_lock_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("kept")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / LOCK_FILE).symlink_to(tmp_path / "elsewhere")

    with pytest.raises(OSError, match="symbolic link"):
        FolderLock(tmp_path / "folder")

    assert (tmp_path / "elsewhere").read_text() == "kept"


def test_where_there_is_no_fcntl_the_lock_is_that_of_windows(tmp_path: Path) -> None:
    found = subprocess.run(
        [sys.executable, "-c", _ON_WINDOWS, str(tmp_path)], capture_output=True, text=True, timeout=60, check=False
    )

    assert (found.returncode, found.stdout, found.stderr) == (0, "refused\n", "")
