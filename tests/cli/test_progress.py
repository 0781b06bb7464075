"""How far a run is."""

from __future__ import annotations

import pytest

from trailmark.cli import progress
from trailmark.cli.progress import RunProgress, share_text
from trailmark.pipeline import Pipeline

SIM = {"plugin": "sim", "world": "ground_course", "route": "straight", "sensors": ["wheels"]}
WHEELS = {"wheels": {"plugin": "odometry"}}


def test_where_the_end_is_known_the_share_and_the_time_left_are_told() -> None:
    assert share_text(0.25, 10.0) == "25 %, 30 s left: "


@pytest.mark.parametrize("share", [None, 0.0, 1.0, 1.2])
def test_where_nothing_can_be_foreseen_nothing_is_told_of_it(share: float | None) -> None:
    assert share_text(share, 10.0) == ""


@pytest.mark.parametrize("window", [{"duration_s": 4}, {"start_s": 1.0, "stop_s": 5.0}, {}])
def test_of_a_drive_along_a_route_the_share_is_told(
    window: dict[str, float], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "_LINE_S", 0.0)
    shares = []
    with Pipeline({"sources": {"robot": SIM | window}, "localizers": WHEELS}) as pipeline, RunProgress("auto") as show:
        for step in pipeline:
            show(pipeline, step)
            shares.append(show._share(pipeline, step))

    assert " %, " in capsys.readouterr().err
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0, abs=0.1)
