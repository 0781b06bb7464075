"""How far a run is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

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


def _at(stamp_s: float, travelled_m: float = 0.0, **pipeline: Any) -> tuple[Any, Any]:
    """Return a pipeline, that of a robot on a taught path of 4 m unless told otherwise, and one of its steps."""
    known: dict[str, Any] = {
        "lasts_s": 60.0,
        "path": _Path(),
        "n_waypoints": 0,
        "parts": SimpleNamespace(controller="tracking"),
        "sensor_origins": [],
    }
    step = SimpleNamespace(stamp_s=stamp_s, frame=None, belief=SimpleNamespace(travelled_m=travelled_m))
    return SimpleNamespace(**known | pipeline), step


class _Path:
    length_m = 4.0

    def __len__(self) -> int:
        return 9


@pytest.mark.parametrize(
    ("changes", "share"),
    [
        ({}, 0.975),  # the end of the path comes long before that of the time
        ({"lasts_s": 12.5}, 1.0),
        ({"parts": SimpleNamespace(controller=None)}, 12.5 / 60.0),  # nobody stops at the end of the path
        ({"parts": SimpleNamespace(controller=None), "lasts_s": None}, 0.975),
        ({"path": None}, 12.5 / 60.0),
        ({"path": None, "lasts_s": None}, None),
    ],
)
def test_the_share_is_that_of_what_ends_the_run(changes: dict[str, Any], share: float | None) -> None:
    show = RunProgress("auto")
    show(*_at(0.0, **changes))

    assert show._share(*_at(12.5, 3.9, **changes)) == pytest.approx(share)


@pytest.mark.parametrize("kind", ["json", "none"])
def test_nobody_is_asked_how_long_it_lasts_where_no_share_is_shown(kind: Any) -> None:
    pipeline, step = _at(0.0)
    del pipeline.lasts_s

    RunProgress(kind)(pipeline, step)


def test_the_time_of_the_bar_goes_on_where_a_film_announces_too_few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_BAR_S", 0.0)
    show = RunProgress("auto")
    show._bar = progress._bar()
    show._task = show._bar.add_task("", total=None)
    for stamp_s in (0.0, 6.0, 12.0):
        pipeline, step = _at(stamp_s, lasts_s=10.0, path=None)
        step.frame = object()
        show(pipeline, step)

    assert not show._bar.finished
