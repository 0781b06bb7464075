"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Recordings that are not shipped: ``TRAILMARK_DATA``, or ``../shared/data`` beside the checkout."""
    folder = Path(os.environ.get("TRAILMARK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set TRAILMARK_DATA to their folder")
    return folder
