"""The contract of the source and of the localizer."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from trailmark_mrclam.config import MrclamLandmarksConfig, RangeBearingConfig
from trailmark_mrclam.localizer import RangeBearing
from trailmark_mrclam.source import MrclamLandmarks

from trailmark.testing import (
    landmark_run,
    parametrize_with_localizer_checks,
    parametrize_with_source_checks,
)


@parametrize_with_localizer_checks(
    RangeBearing,
    config=RangeBearingConfig(sightings="sightings"),
    frames=landmark_run(n_frames=30),
)
def test_the_localizer(check: Callable[[], None]) -> None:
    check()


def recording() -> MrclamLandmarksConfig:
    folder = Path(tempfile.mkdtemp())
    (folder / "Barcodes.dat").write_text("6 72\n7 27\n")
    (folder / "Landmark_Groundtruth.dat").write_text("6 4.0 0.0 0.001 0.001\n7 0.0 3.0 0.001 0.001\n")
    lines = [f"{10 + 0.5 * i} {72 if i % 2 else 27} {4 - 0.05 * i:.2f} 0.1" for i in range(20)]
    (folder / "Robot1_Measurement.dat").write_text("\n".join(lines) + "\n")
    return MrclamLandmarksConfig(path=folder / "Robot1_Measurement.dat")


@parametrize_with_source_checks(MrclamLandmarks, config=recording)
def test_the_source(check: Callable[[], None]) -> None:
    check()
