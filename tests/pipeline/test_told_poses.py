"""A person tells where the robot is, by way of a source."""

from __future__ import annotations

import pytest

from trailmark.errors import RunError
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline


def pipeline_of(fakes, estimator) -> Pipeline:
    class Told(fakes.ToyRobot):
        drives_itself = True

        def start(self, session):
            self.session = session

        def frames(self):
            for i, frame in enumerate(super().frames()):
                if i == 2:
                    self.session.tell_pose(Pose2(3.0, 4.0, 0.5), None)
                yield frame

    return Pipeline(fakes.parts({"robot": Told(5)}, {"vo": fakes.Scripted()}, estimator=estimator))


def test_the_belief_is_where_the_person_says(fakes) -> None:
    steps = list(pipeline_of(fakes, DeadReckoning(DeadReckoningConfig())))

    assert steps[-1].belief.pose_map_base == Pose2(3.0, 4.0, 0.5)


def test_an_estimator_that_fails_at_it_is_named(fakes) -> None:
    class Deaf(DeadReckoning):
        def set_pose(self, pose_map_base, covariance=None, stamp_s=None):
            raise KeyError("pose")

    with pytest.raises(RunError, match="the estimator failed in set_pose: KeyError: 'pose'"):
        list(pipeline_of(fakes, Deaf(DeadReckoningConfig())))


def test_an_estimator_that_answers_nothing_is_named(fakes) -> None:
    class Mute(DeadReckoning):
        def set_pose(self, pose_map_base, covariance=None, stamp_s=None):
            return None

    with pytest.raises(RunError, match="the estimator failed in set_pose: TypeError: it returned NoneType"):
        list(pipeline_of(fakes, Mute(DeadReckoningConfig())))
