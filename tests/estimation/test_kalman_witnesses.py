"""How much one localizer may say of hypotheses that others contradict."""

from __future__ import annotations

import math

import pytest

from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.witnesses import SUSPICION, with_testimony
from trailmark.estimation.kalman.witnesses import Testimony as Said


def rival(**heard: Said) -> RivalFilter:
    state = FilterState(5.0, None, diagnosis=FaultDiagnosis())
    return RivalFilter(state, 0.0, begun=FilterState(1.0, None, diagnosis=FaultDiagnosis()), heard=heard)


def test_of_a_hypothesis_that_began_later_who_spoke_before_has_said_nothing() -> None:
    """The laser spoke against the first alone; the camera speaks against the second."""
    against = Said(-10.0, 2.0, 4.0)

    first, second = with_testimony([rival(laser=against), rival()], "camera", [0.0, -8.0])

    assert first.log_alone == pytest.approx(10.0 - SUSPICION)
    assert second.log_alone == pytest.approx(8.0 - SUSPICION)
    assert math.isclose(second.heard["camera"].log, -8.0)


def test_who_is_said_to_lie_says_little_against_it_where_two_others_do_not() -> None:
    """The camera's map counts in full against nobody lying, as the laser and the omni do, too."""
    fault = DetectedFault(2.0, "lies", contradicted_by=frozenset({"laser", "omni"}))
    lies = FilterState(5.0, None, diagnosis=FaultDiagnosis(absolute_faults={"map": fault}))
    begun = FilterState(1.0, None, diagnosis=FaultDiagnosis())
    others = {"laser": Said(-8.0, 2.0, 4.0), "omni": Said(-8.0, 2.0, 4.0)}
    agree = {"laser": Said(0.0, math.inf, 4.0), "omni": Said(0.0, math.inf, 4.0)}

    honest, liar = with_testimony([rival(**others), RivalFilter(lies, 0.0, begun=begun, heard=agree)], "map", [0, -9.0])

    assert honest.log_alone == 0.0
    assert liar.log_alone == pytest.approx(9.0 - SUSPICION)
