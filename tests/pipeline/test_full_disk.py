"""A disk that fills up while a run is written: the run fails, says why, and what fits is there."""

from __future__ import annotations

import errno
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import trailmark
from trailmark.cli.errors import exit_code_of
from trailmark.errors import RunError
from trailmark.estimates import Applied, EstimateRecord, Lost
from trailmark.geometry import read_tum
from trailmark.pipeline.outputs.recorder import ESTIMATE_COLUMNS, Recorder
from trailmark.pipeline.outputs.whole_files import cut_after_last_line, overwrite_in_place, write_whole

N_FRAMES = 400


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a table of wheel odometry."""
    path = tmp_path_factory.mktemp("drive") / "wheels.csv"
    path.write_text("t,x,y,theta\n" + "".join(f"{i / 10},{i * 0.01},0,0\n" for i in range(N_FRAMES)))
    return path


def config_of(drive: Path) -> dict[str, Any]:
    return {
        "sources": {"wheels": {"plugin": "csv_odometry", "path": str(drive)}},
        "localizers": {"odometry": {"plugin": "odometry"}},
    }


class Disk:
    """A disk on which so many bytes can still be written, below one folder."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path, free_bytes: int) -> None:
        self._free_bytes, self._folder, self._open = free_bytes, folder, io.open
        monkeypatch.setattr(io, "open", self.open)  # pathlib's, too

    def open(self, file: Any, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        if not isinstance(file, str | Path) or self._folder not in Path(file).parents or mode == "r":
            return self._open(file, mode, *args, **kwargs)
        raw = _File(self, str(file), mode.replace("b", ""))
        if kwargs.get("buffering") == 0:
            return raw
        if "b" in mode:
            return io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", newline=kwargs.get("newline"))

    def take(self, n_bytes: int) -> None:
        if n_bytes > self._free_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._free_bytes -= n_bytes


class _File(io.FileIO):
    """A file on a `Disk`; what it holds already may be written over."""

    def __init__(self, disk: Disk, path: str, mode: str) -> None:
        super().__init__(path, mode)
        self._disk = disk

    def write(self, data: Any) -> int:
        self._disk.take(max(0, self.tell() + len(data) - os.fstat(self.fileno()).st_size))
        return super().write(data)


def assert_what_there_was_is_there(out: Path) -> None:
    """See that a folder says that its run has failed, and that every file in it is whole."""
    about = json.loads((out / "run.json").read_text())
    assert about["status"] == "failed"
    assert "No space left on device" in about["reason"] or "File too large" in about["reason"]
    assert not list(out.rglob("*.part"))
    rows = (out / "estimates.csv").read_text().splitlines(keepends=True)
    assert all(row.endswith("\n") and row.count(",") >= len(ESTIMATE_COLUMNS) - 1 for row in rows)
    n_frames = about.get("counters", {}).get("frames", N_FRAMES / 2)  # until the disk was full
    for track in out.rglob("*.tum"):
        assert len(read_tum(track)) >= n_frames - 2


# Free bytes: from nothing to all that the run needs, so that each of its writes is the one that fails.
@pytest.mark.parametrize("free_kib", [*range(34, 130, 6)])
def test_whichever_write_fails_the_run_says_so(
    free_kib: int, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    Disk(monkeypatch, tmp_path, free_kib << 10)
    with pytest.raises(RunError, match="No space left on device") as caught:
        trailmark.run(config_of(drive), out, report=False)
    monkeypatch.undo()

    assert exit_code_of(caught.value) == 1
    assert "This is a bug" not in capsys.readouterr().err
    if out.exists():
        assert_what_there_was_is_there(out)


def test_a_run_that_is_left_at_once_says_so_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(tmp_path, {"mode": "track"}, None)
    recorder.open({}, {})
    recorder.on_estimate_record(EstimateRecord(0.0, "eye", Lost(0.0, "dark"), Applied("lost")))
    Disk(monkeypatch, tmp_path, 0)

    recorder.mark("interrupted", "interrupted by SIGTERM")
    monkeypatch.undo()

    about = json.loads((tmp_path / "run.json").read_text())
    assert (about["status"], about["reason"]) == ("interrupted", "interrupted by SIGTERM")


def test_a_run_that_cannot_begin_leaves_nothing(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, tmp_path, 1 << 10)
    with pytest.raises(RunError, match=r"cannot write to .*: No space left on device"):
        trailmark.run(config_of(drive), tmp_path / "out", report=False)

    assert not (tmp_path / "out").exists()


@pytest.fixture
def tmpfs(tmp_path: Path) -> Iterator[Path]:
    """Return a folder on a file system of 96 KiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=96k", "tmpfs", folder], capture_output=True)
    if mounted.returncode:
        pytest.skip("only root can mount a small file system")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def cli(*arguments: str, preexec: Any = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "trailmark.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, preexec_fn=preexec)


def test_on_a_small_file_system(drive: Path, tmpfs: Path) -> None:
    out = tmpfs / "out"
    done = cli("run", str(drive), "--localizer", "odometry", "--out", str(out), "--no-report")

    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert_what_there_was_is_there(out)


def test_a_store_that_fails_half_way_is_exit_code_1(drive: Path, tmpfs: Path, tmp_path: Path) -> None:
    config = tmp_path / "teach.yaml"
    config.write_text(
        f"sources: {{wheels: {{plugin: csv_odometry, path: {drive}}}}}\n"
        "localizers: {odometry: {plugin: odometry}}\npath_store: {spacing_m: 0.001}\n"
    )
    out = tmp_path / "out"
    done = cli("teach", str(config), "--store", str(tmpfs / "a.trail"), "--out", str(out), "--no-report")

    assert done.returncode == 1, done.stderr
    assert "the path store failed in" in done.stderr
    about = json.loads((out / "run.json").read_text())
    assert (about["status"], about["reason"].startswith("the path store failed in")) == ("failed", True)
    assert (out / "trajectories/fused.tum").stat().st_size > 0


def test_files_that_may_not_grow(drive: Path, tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    out = tmp_path / "out"
    done = cli(
        *("run", str(drive), "--localizer", "odometry", "--out", str(out), "--no-report"),
        preexec=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000)),
    )

    assert done.returncode == 1
    assert "File too large" in done.stderr
    assert_what_there_was_is_there(out)


class TestFiles:
    def test_a_file_is_whole_or_the_old_one(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        write_whole(tmp_path / "a", "old")
        Disk(monkeypatch, tmp_path, 2)
        with pytest.raises(OSError, match="No space"):
            write_whole(tmp_path / "a", "new and long")

        assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]

    def test_in_place_needs_no_space(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = tmp_path / "a"
        path.write_text("running" + " " * 20)
        Disk(monkeypatch, tmp_path, 0)

        assert overwrite_in_place(path, "failed: no space")
        assert not overwrite_in_place(path, "failed: no space, and a story")
        assert path.read_text() == "failed: no space"

    @pytest.mark.parametrize(("text", "left"), [("a\nb\nc", "a\nb\n"), ("a\nb\n", "a\nb\n"), ("abc", ""), ("", "")])
    def test_a_table_ends_with_a_whole_line(self, tmp_path: Path, text: str, left: str) -> None:
        path = tmp_path / "a"
        path.write_text(text)
        cut_after_last_line(path)

        assert path.read_text() == left
