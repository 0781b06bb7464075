"""A localizer that says far too much, or what cannot be: it is cut, or refused."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, PathOffset
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline

WORDS = "x" * 5_000_000
MANY = {f"score_{i}": float(i) for i in range(200_000)}


def records_of(fakes, estimates: list[Estimate]) -> list[Estimate]:
    """Return what is recorded of a localizer that says this about each of three frames."""

    class Talker(fakes.Scripted):
        def observe(self, frame: Frame, belief: Belief) -> list[Estimate]:
            return estimates

    frames = fakes.image_frames("cam", [0.0, 0.1, 0.2])
    steps = list(Pipeline(fakes.parts({"cam": fakes.Recording(frames)}, {"talker": Talker()})))
    return [record.estimate for step in steps for record in step.estimates]


@pytest.mark.parametrize(
    ("estimate", "n_details", "n_letters"),
    [
        (Lost(0.0, WORDS), 0, 1000),
        (Lost(0.0, "dark", MANY), 1000, 4),
        (Fix(0.0, Pose2(1.0), np.eye(3), MANY), 1000, 0),
    ],
)
def test_it_is_cut_and_that_is_said_once(fakes, caplog, estimate, n_details: int, n_letters: int) -> None:
    kept = records_of(fakes, [estimate, Lost(0.0, "dark")])

    assert len(kept) == 6
    for one in kept[::2]:
        assert len(one.details) == n_details
        assert len(getattr(one, "reason", "")) == n_letters
    assert kept[1] == Lost(0.0, "dark")
    assert caplog.text.count("localizer 'talker' says too much about an estimate") == 1


def test_what_people_can_read_is_left_as_it_is(fakes, caplog) -> None:
    estimate = Lost(0.0, "x" * 1000, {f"score_{i}": float(i) for i in range(1000)})

    assert records_of(fakes, [estimate])[0] is estimate
    assert not caplog.text


@pytest.mark.parametrize(
    "estimate",
    [
        Fix(0.0, Pose2(1e308), np.eye(3)),
        Motion(-1.0, 0.0, Pose2(0.0, -1e13), np.eye(3)),
        PathOffset(0.0, 1e13, 0.0, 0.0, np.eye(3)),
    ],
)
def test_an_estimate_beyond_all_reason_is_refused(fakes, estimate: Estimate) -> None:
    parts = fakes.parts(
        {"cam": fakes.Recording(fakes.image_frames("cam", [0.0]))},
        {"far": fakes.Scripted(lambda frame, belief: [estimate])},
    )

    (step,) = Pipeline(parts)

    (record,) = step.estimates
    assert record.outcome.status == "refused"
    assert "no robot comes so far" in record.outcome.reason
