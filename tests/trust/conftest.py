"""A stranger's config."""

from __future__ import annotations

from pathlib import Path

import pytest

WHEELS = "sources:\n  wheels: {plugin: csv_odometry, path: wheels.csv}\nlocalizers:\n  wheels: {plugin: odometry}\n"


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """A folder with a config and its recording."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    (folder / "wheels.csv").write_text("t,x,y,theta\n" + "".join(f"{0.1 * i},{0.1 * i},0,0\n" for i in range(30)))
    (folder / "config.yaml").write_text(WHEELS)
    return folder
