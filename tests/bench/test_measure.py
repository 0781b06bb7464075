"""What a cell that has run is worth."""

from __future__ import annotations

from typing import Any

import pytest

from trailmark.pipeline import RunResult
from trailmark_bench.measure import measure_cell, times_of, verdict_of
from trailmark_bench.quantities import metric_of
from trailmark_bench.tables import metric_title


def document(**changes: Any) -> dict[str, Any]:
    """Return ``metrics.json`` of a run in which `cam` spoke and was used."""
    return {
        "trajectories": {"fused": {"poses": 9}, "cam": {"poses": 9}},
        "sources": {"cam": {"estimates": 9, "outcomes": {"accepted": 9}, "says_places": True}},
        "warnings": [],
    } | changes


def warning(about: str, is_worthless: bool = True) -> dict[str, Any]:
    return {"about": about, "fact": "it drives 500 m/s", "remedy": "look", "is_worthless": is_worthless}


def verdict(found: dict[str, Any], subject: str = "fused") -> tuple[str, str]:
    return verdict_of(RunResult(status="done", reason=""), found, subject, "cam")


def test_a_cell_that_says_something_is_good() -> None:
    assert verdict(document()) == ("ok", "")


@pytest.mark.parametrize(
    ("about", "subject", "state"),
    [("cam", "fused", "failed"), ("", "fused", "failed"), ("", "cam", "ok"), ("other", "fused", "ok")],
)
def test_a_cell_whose_figures_are_worth_nothing_has_failed(about: str, subject: str, state: str) -> None:
    assert verdict(document(warnings=[warning(about)]), subject)[0] == state


def test_what_is_only_of_less_worth_is_a_result() -> None:
    assert verdict(document(warnings=[warning("cam", is_worthless=False)]))[0] == "ok"


def test_who_says_path_offsets_alone_needs_no_way() -> None:
    nothing = {"poses": 0, "problem": "no poses"}
    offsets = {"cam": {"estimates": 9, "outcomes": {"accepted": 9}, "says_places": False}}

    found = document(trajectories={"cam": nothing}, sources=offsets)

    assert verdict(found, "cam") == ("ok", "")
    assert verdict(document(trajectories={"cam": nothing}), "cam") == ("failed", "'cam' gave no pose")


@pytest.mark.parametrize("subject", ["fused", "cam"])
def test_a_collision_is_a_failure_whoever_is_judged(subject: str) -> None:
    result = RunResult(status="done", reason="", counters={"source.robot.collisions": 1})

    assert verdict_of(result, document(), subject, "cam") == ("failed", "the robot touched something")


@pytest.mark.parametrize("of_source", [{"silent[n=9]": 0.5, "silent_single[n=9]": 0.1}, {}])
def test_what_a_belief_is_wrong_by_is_not_told_of_the_localizer(monkeypatch, of_source: dict[str, float]) -> None:
    monkeypatch.setattr("trailmark_bench.measure._detail", lambda *args: {})
    found = document(errors=True, stands_still=None, quantities=[])
    found["sources"]["cam"]["metrics"] = of_source
    found["trajectories"]["fused"]["metrics"] = {
        "ate_rmse_m[se2,n=99]": 0.3, "silent[n=99]": 0.0, "silent_single[n=99]": 0.0
    }  # fmt: skip
    result = RunResult(status="done", reason="", timing={"stages": {}, "frames": 9, "wall_s": 1.0})

    answer, _ = measure_cell({"subject": "fused", "localizer": "cam"}, result, found, None)

    belief = {"ate_rmse_m[se2,n=99]": 0.3, "belief_silent[n=99]": 0.0, "belief_silent_single[n=99]": 0.0}
    assert answer["metrics"] == belief | of_source
    assert metric_title(metric_of("belief_silent"))[1] == metric_title(metric_of("silent"))[1]


def test_the_cost_of_a_metre_is_what_all_calls_took_over_the_way() -> None:
    timing = {"stages": {"localizer.cam": {"n": 300, "mean_ms": 2.0, "p95_ms": 5.0}}, "frames": 300, "wall_s": 1.5}
    result = RunResult(status="done", reason="", timing=timing)

    times = times_of(result, "cam", way_m=4.0)

    assert times["call_ms_per_m"] == 150.0
    assert times["call_p95_ms"] == 5.0
    assert "call_ms_per_m" not in times_of(result, "cam", way_m=0.0)
    cost = metric_of("call_ms_per_m")
    assert metric_title(cost) == ("call", "ms/m")
    assert cost.is_of_machine
