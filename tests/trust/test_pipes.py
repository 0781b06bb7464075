"""Pipes and devices in place of files are refused by name; none is waited for without a word."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from trailmark.errors import DataError
from trailmark.evaluation.estimates_table import read_estimates
from trailmark.geometry import read_tum
from trailmark.interfaces import Session
from trailmark.report.live import RunWatch
from trailmark_datasets.bagfile import open_bag
from trailmark_datasets.config import CsvOdometryConfig
from trailmark_datasets.csv_odometry import CsvOdometry
from trailmark_datasets.textfiles import lines_of

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")


@pytest.fixture(autouse=True)
def no_wait() -> Iterator[None]:
    """Fail, rather than wait for ever."""

    def ring(*_: object) -> None:
        raise TimeoutError("waited for a pipe")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe.csv")
    return tmp_path / "pipe.csv"


@pytest.mark.parametrize(
    "read",
    [
        read_tum,
        read_estimates,
        lambda path: list(lines_of(path)),
        lambda path: open_bag(path, "ros2_humble").__enter__(),
    ],
    ids=["trajectory", "estimates", "text", "bag"],
)
def test_a_pipe_is_refused(pipe: Path, read) -> None:
    with pytest.raises(DataError, match=r"pipe\.csv.* is a device or a pipe"):
        read(pipe)


def test_a_table_that_is_a_pipe_is_refused(pipe: Path) -> None:
    source = CsvOdometry(CsvOdometryConfig.model_construct(path=pipe))

    with pytest.raises(DataError, match="is a device or a pipe"):
        source.start(Session(name="wheels"))


def test_a_pipe_inside_a_recording_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "metadata.yaml")

    with pytest.raises(DataError, match=r"metadata\.yaml is a device or a pipe"), open_bag(tmp_path, "ros2_humble"):
        pass


def test_a_run_whose_estimates_are_a_pipe_is_looked_at(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"status": "done"}')
    os.mkfifo(tmp_path / "estimates.csv")

    assert not RunWatch(tmp_path).look()
