"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# How long an example takes says more about the machine than about the code; CI tries the same examples each time.
settings.register_profile("trailmark", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("trailmark")

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Recordings that are not shipped: ``TRAILMARK_DATA``, or ``../shared/data`` beside the checkout."""
    folder = Path(os.environ.get("TRAILMARK_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set TRAILMARK_DATA to their folder")
    return folder
