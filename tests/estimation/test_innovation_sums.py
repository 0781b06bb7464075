"""Sums of innovations that are kept from one belief to the next are those of all anew, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation.kalman import one_sided
from trailmark.estimation.kalman.diagnosis import FaultDiagnosis
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.one_sided import InnovationSums
from trailmark.estimation.kalman.state import FilterState, Gaussian

Told = tuple[tuple[float, Innovation], ...]


def told(rng: np.random.Generator, since_s: float, n: int) -> Told:
    """Return innovations of poses, one every 0.1 s."""
    seen = (Innovation(rng.normal(size=3), 10.0 * rng.normal(size=(3, 3)), 1e-3 * np.eye(3)) for _ in range(n))
    return tuple((since_s + 0.1 * i, one) for i, one in enumerate(seen))


def state_with(innovations: Told) -> FilterState:
    """Return a state after some innovations."""
    state = FilterState(innovations[-1][0], None)
    return state.with_diagnosis(state.diagnosis._replace(innovations=innovations))


def test_what_is_kept_changes_no_bit_and_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, sums, asked = np.random.default_rng(1), InnovationSums(), []
    first, anchors = told(rng, 0.0, 40), [FilterState(1.45, None), FilterState(2.5, None)]
    redone = (*first[:37], *told(rng, 3.7, 6))  # something came late
    forgotten = redone[10:]
    size_in_pose = Innovation.size_in_pose
    monkeypatch.setattr(Innovation, "size_in_pose", lambda one: (asked.append(one), size_in_pose(one))[1])

    for innovations, anchor, n_new in (
        (first, anchors[0], 25),
        (redone, anchors[0], 6),
        (forgotten, anchors[0], 0),
        (forgotten, anchors[1], 17),
    ):
        asked.clear()
        kept = sums.until_now(state_with(innovations), anchor)
        assert len(asked) == n_new

        since = [one for stamp_s, one in innovations if stamp_s > anchor.stamp_s]
        sizes = [size_in_pose(one) for one in since]
        assert kept[0].tobytes() == np.add.reduce([gain for _, _, gain in sizes]).tobytes()
        assert kept[1:] == (max(way_m for way_m, _, _ in sizes), max(turn_rad for _, turn_rad, _ in sizes))


def test_a_window_is_asked_about_once_until_something_is_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    sums, asked, seen = InnovationSums(), [], told(np.random.default_rng(1), 0.0, 20)
    lies = one_sided._lies_to_one_side
    monkeypatch.setattr(one_sided, "_lies_to_one_side", lambda *args: (asked.append(1), lies(*args))[1])
    gaussian = Gaussian(np.zeros(3), np.eye(3), UNAFFECTED)
    state = FilterState(seen[-1][0], gaussian).with_diagnosis(
        FaultDiagnosis(
            corrections=np.full(3, 0.1),
            correction_covariance=1e-4 * np.eye(3),
            anchors=(FilterState(0.5, gaussian),),
            innovations=seen,
        )
    )
    again = state.with_diagnosis(state.diagnosis._replace(corrections=np.full(3, 1e-3)))

    found = [one_sided.covariance_of_one_sided_corrections(one, sums) for one in (state, state, again)]

    assert len(asked) == 2
    assert [bool(one.any()) for one in found] == [True, True, False]


def test_an_absolute_estimate_at_the_instant_of_an_anchor_is_none_since_then() -> None:
    gaussian, seen = Gaussian(np.zeros(3), np.eye(3), UNAFFECTED), told(np.random.default_rng(1), 0.0, 20)
    diagnosis = FaultDiagnosis(
        corrections=np.full(3, 0.1),
        correction_covariance=1e-4 * np.eye(3),
        anchors=(FilterState(seen[-1][0], gaussian),),
        innovations=seen,
    )

    found = one_sided.covariance_of_one_sided_corrections(FilterState(seen[-1][0], gaussian).with_diagnosis(diagnosis))

    assert not found.any()
