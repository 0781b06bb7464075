"""How much one localizer may say of hypotheses that others contradict."""

from __future__ import annotations

import math

import pytest

from trailmark.estimation.kalman.diagnosis import FaultDiagnosis, RivalFilter
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
