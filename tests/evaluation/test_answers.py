"""How soon there is an answer, how soon a right one, and how long the longest silence is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.evaluation import JudgedEstimates, metrics_of, read_estimates
from trailmark.evaluation.answers import answers
from trailmark.geometry import Trajectory
from trailmark.plugins import load_plugins

Write = Callable[..., Path]
Judge = Callable[[str, bool], dict[str, float]]

#: The robot stands at the origin, and is looked for once a second.
_TRUTH = Trajectory(np.arange(200.0), np.zeros((200, 3)))
_X_M = {"r": 0.0, "w": 3.0}


def _row(stamp_s: int, letter: str) -> str:
    if letter == "l":
        return f"{stamp_s},eye,lost,,{stamp_s},,,,,,,,,,unused,,,dark,"
    status = "refused" if letter == "x" else "accepted"
    return f"{stamp_s},eye,fix,,{stamp_s},{_X_M.get(letter, 0.0)},0,0,1e4,0,0,1e4,0,1e4,{status},,,,"


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    """Return the figures of looks a second apart: right, wrong, lost or refused, a letter each."""

    def judged(looks: str, has_truth: bool = True) -> dict[str, float]:
        header = "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt"
        table = tmp_path_factory.getbasetemp() / "estimates.csv"
        rows = [_row(stamp_s, letter) for stamp_s, letter in enumerate(looks)]
        table.write_text("\n".join([f"{header},status,nis,dof,reason,details", *rows]) + "\n")
        found = answers(JudgedEstimates(read_estimates(table), _TRUTH if has_truth else None))
        return {name.partition("[")[0]: value for name, value in found.items()}

    return judged


def test_the_first_answer_may_be_wrong_and_the_first_right_one_comes_later(judge: Judge) -> None:
    found = judge("lllwwrrr", True)

    assert (found["first_answer_s"], found["first_right_s"]) == (3.0, 5.0)


def test_a_fault_costs_the_time_to_the_next_right_answer(judge: Judge) -> None:
    found = judge("rrrllwwrlr", True)

    assert found["recovery_s"] == 5.0  # from the third look to the eighth
    assert found["longest_silence_s"] == 3.0  # it spoke, wrongly


def test_who_never_comes_back_is_silent_to_the_end(judge: Judge) -> None:
    assert judge("rrllll", True)["recovery_s"] == 4.0


def test_who_never_answers_has_the_worst_figures_there_are(judge: Judge) -> None:
    assert judge("llll", False) == {"first_answer_s": 3.0, "longest_silence_s": 3.0}
    assert judge("wwww", True)["first_right_s"] == 3.0


def test_what_was_refused_is_no_answer(judge: Judge) -> None:
    assert judge("xxrr", True)["first_answer_s"] == 2.0


def test_without_truth_nobody_knows_what_is_right(judge: Judge) -> None:
    assert set(judge("lrr", False)) == {"first_answer_s", "longest_silence_s"}


@given(looks=st.text("lrwx", min_size=1, max_size=30))
def test_right_answers_are_no_sooner_and_no_denser_than_answers(judge: Judge, looks: str) -> None:
    found = judge(looks, True)

    assert 0.0 <= found["first_answer_s"] <= found.get("first_right_s", len(looks)) <= len(looks)
    if "recovery_s" in found:
        assert found["longest_silence_s"] <= max(found["first_right_s"], found["recovery_s"])


def test_it_is_built_in_and_declares_what_it_measures() -> None:
    metric = metrics_of(load_plugins().registry)["answers"]

    assert {spec.name for spec in metric.quantities if spec.needs == "truth"} == {"first_right_s", "recovery_s"}
