"""A person tells where the robot is, by way of a source."""

from __future__ import annotations

import numpy as np
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


def camera(fakes):
    return fakes.Recording(fakes.image_frames("cam", [0.0, 0.1, 0.2]))


COMPLEX = np.eye(3) * (1 + 1j)


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (((1.0, 2.0, 0.0),), "it is tuple, not a Pose2"),
        ((Pose2(), None, np.nan), "its stamp is nan"),
        ((Pose2(), None, "now"), "its stamp is 'now'"),
        ((Pose2(), np.eye(2)), "its covariance is of shape (2, 2)"),
        ((Pose2(), COMPLEX), "not (3, 3) and real"),
        ((Pose2(), [[1.0, 2.0], [3.0], [4.0]]), "its covariance is no matrix"),
        ((Pose2(), [["a"] * 3] * 3), "not (3, 3) and real"),
    ],
)
def test_what_is_no_pose_is_refused_and_changes_nothing(fakes, told, words: str) -> None:
    parts = fakes.parts({"cam": camera(fakes)}, {"vo": fakes.Scripted()})
    with Pipeline(parts) as pipeline:
        before = next(pipeline).belief
        outcome = pipeline.set_pose(*told)

        assert outcome.status == "refused"
        assert words in outcome.reason
        assert next(pipeline).belief.pose_map_base == before.pose_map_base


def test_a_program_tells_a_pose_for_an_instant(fakes) -> None:
    with Pipeline(fakes.parts({"cam": camera(fakes)}, {"vo": fakes.Scripted()})) as pipeline:
        step = next(pipeline)

        assert pipeline.set_pose(Pose2(1.0, 2.0, 0.0), np.eye(3) * 1e-4, step.stamp_s).status == "accepted"
        assert next(pipeline).belief.pose_map_base == Pose2(1.0, 2.0, 0.0)


def test_an_estimator_that_fails_when_a_program_tells_is_named(fakes) -> None:
    class Deaf(DeadReckoning):
        def set_pose(self, pose_map_base, covariance=None, stamp_s=None):
            raise SystemExit

    parts = fakes.parts({"cam": camera(fakes)}, {"vo": fakes.Scripted()}, estimator=Deaf(DeadReckoningConfig()))
    with Pipeline(parts) as pipeline, pytest.raises(RunError, match="the estimator failed in set_pose: SystemExit"):
        pipeline.set_pose(Pose2())
