"""The belief that localizers, sinks and the controller share: until something changes it, and for reading alone."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from trailmark.errors import RunError
from trailmark.estimates import ALL_HEALTHY, Applied, Belief, Estimate, Fix, Motion
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.frames import Frame
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Localizer, Session
from trailmark.pipeline.localizers.estimator import EstimatorRunner
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.parts import LocalizerPart


class Foreign(Estimator):
    """Gives out its own arrays and mappings, and counts how often it is asked."""

    def __init__(self, **fields) -> None:
        super().__init__(None)
        self.fields = fields
        self.pose, self.asked = Pose2(), 0

    def apply(self, source: str, estimate: Estimate) -> Applied:
        return Applied("accepted")

    def set_pose(self, pose_map_base, covariance=None, stamp_s=None) -> Applied:
        self.pose = pose_map_base
        return Applied("accepted")

    def belief(self, stamp_s=None) -> Belief:
        self.asked += 1
        return Belief(stamp_s or 0.0, self.pose, **self.fields)


def runner_of(estimator: Estimator) -> EstimatorRunner:
    return EstimatorRunner(estimator, None, array("q"))


def test_at_the_same_stamp_the_estimator_is_asked_once() -> None:
    foreign = Foreign()
    runner = runner_of(foreign)

    assert runner.belief(1.0) is runner.belief(1.0)
    assert foreign.asked == 1


def test_a_pose_that_is_told_is_in_the_belief_at_the_same_stamp() -> None:
    runner = runner_of(Foreign())
    runner.belief(1.0)

    runner.set_pose(Pose2(3.0, 4.0, 0.5))

    assert runner.belief(1.0).pose_map_base == Pose2(3.0, 4.0, 0.5)


def test_a_localizer_that_is_switched_off_is_in_the_belief_at_the_same_stamp() -> None:
    runner = runner_of(Foreign())
    runner.belief(1.0)

    runner.switch_off("vo", "it failed")

    assert runner.belief(1.0).health == {"vo": "switched off: it failed"}


@pytest.mark.parametrize("stamp_s", [1.0, None])
def test_nobody_changes_the_belief_of_others_in_place(stamp_s: float | None) -> None:
    covariance, health = np.eye(3), {"vo": "silent"}
    belief = runner_of(Foreign(covariance=covariance, health=health)).belief(stamp_s)

    with pytest.raises(ValueError, match="read-only"):
        belief.covariance[0, 0] = 9.0
    told: Any = belief.health
    with pytest.raises(TypeError):
        told["vo"] = "well"
    covariance[0, 0] = 9.0
    health["vo"] = "well"
    np.testing.assert_array_equal(belief.covariance, np.eye(3))
    assert belief.health == {"vo": "silent"}


def test_health_that_is_no_mapping_is_a_failure_of_the_estimator() -> None:
    with pytest.raises(RunError, match="the estimator failed in belief: TypeError"):
        runner_of(Foreign(health=None)).belief(1.0)


@pytest.mark.parametrize(
    "estimator", [DeadReckoning(DeadReckoningConfig()), Kalman(KalmanConfig()), Smoother(SmootherConfig())]
)
def test_beliefs_of_our_estimators_are_shared_as_they_are_and_cannot_be_changed(estimator: Estimator) -> None:
    estimator.start(Session(start_pose=Pose2()))
    estimator.apply("wheels", Motion(0.0, 0.1, Pose2(0.05), np.diag([1e4, 1e4, 1e4])))
    given = estimator.belief(0.1)

    belief = runner_of(estimator).belief(0.1)

    assert belief is given  # nothing is copied
    with pytest.raises(ValueError, match="read-only"):
        belief.covariance[0, 0] = 1.0


def test_a_view_that_is_read_only_of_what_an_estimator_goes_on_with_is_copied() -> None:
    own = np.eye(3)
    runner = runner_of(Foreign(covariance=read_only(own), health=ALL_HEALTHY))
    belief = runner.belief(1.0)

    own[0, 0] = 7.0

    assert belief.covariance[0, 0] == 1.0


class Ailing(Localizer):
    """Says of its health what it was given, or raises it."""

    said: Any = ""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        return ()

    def health(self) -> str:
        if isinstance(self.said, BaseException):
            raise self.said
        return self.said


def asked(runner: EstimatorRunner, said: Any) -> EstimatorRunner:
    """Apply an estimate of a localizer that says this of its health."""
    localizer = Ailing(None)
    localizer.said = said
    part = SimpleNamespace(name="tags", localizer=localizer, sensors=frozenset({"cam"}))
    runner.apply(cast("LocalizerPart", part), Fix(1.0, Pose2(), np.eye(3)), 1.0)
    return runner


def test_what_a_localizer_says_of_its_health_is_in_the_belief_until_it_is_well() -> None:
    runner = asked(runner_of(Foreign()), "landmark 3 was moved")
    assert runner.belief(1.0).health == {"tags": "landmark 3 was moved"}

    asked(runner, "")
    assert not runner.belief(1.0).health


def test_the_word_of_the_estimator_goes_before_that_of_the_localizer() -> None:
    runner = asked(runner_of(Foreign(health={"tags": "silent"})), "landmark 3 was moved")
    assert runner.belief(1.0).health == {"tags": "silent"}


@pytest.mark.parametrize(
    ("said", "words"), [(None, "not words"), (7, "not words"), (ZeroDivisionError("by 0"), "by 0")]
)
def test_health_that_fails_is_a_failure_of_the_localizer(said: Any, words: str) -> None:
    with pytest.raises(LocalizerFailedError, match=f"localizer 'tags' failed in health: .*{words}"):
        asked(runner_of(Foreign()), said)


def test_health_that_is_too_long_is_cut() -> None:
    assert len(asked(runner_of(Foreign()), "x" * 5000).belief(1.0).health["tags"]) == 1000
