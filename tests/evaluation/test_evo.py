"""Our figures against evo (GPL: in tests only), on curved paths in the plane, where it works."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
import pytest

from trailmark.evaluation import align, associate, evaluate, relative_error
from trailmark.geometry import Pose2, Trajectory

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    evo_metrics = pytest.importorskip("evo.core.metrics")
    evo_trajectory = pytest.importorskip("evo.core.trajectory")


def _in_space(trajectory: Trajectory) -> object:
    half = trajectory.headings / 2.0
    zeros = np.zeros(len(trajectory))
    return evo_trajectory.PoseTrajectory3D(
        positions_xyz=np.column_stack([trajectory.positions, zeros]),
        orientations_quat_wxyz=np.column_stack([np.cos(half), zeros, zeros, np.sin(half)]),
        timestamps=trajectory.stamps_s.copy(),
    )


@pytest.fixture
def estimate(figure_eight: Trajectory, noisy: Callable[..., Trajectory]) -> Trajectory:
    return noisy(figure_eight, 0.02, 0.01).transformed(Pose2(4.0, -2.0, 2.5))


def _statistics(metric: object, truth: object, estimate: object) -> dict[str, float]:
    metric.process_data((truth, estimate))  # type: ignore[attr-defined]
    return metric.get_all_statistics()  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize(
    ("relation", "quantity", "scale"),
    [("translation_part", "ate_{}_m", 1.0), ("rotation_angle_deg", "ate_heading_{}_deg", 1.0)],
)
def test_absolute_errors_agree(
    relation: str, quantity: str, scale: float, estimate: Trajectory, figure_eight: Trajectory
) -> None:
    truth_3d, estimate_3d = _in_space(figure_eight), _in_space(estimate)
    estimate_3d.align(truth_3d)  # type: ignore[attr-defined]
    theirs = _statistics(evo_metrics.APE(evo_metrics.PoseRelation[relation]), truth_3d, estimate_3d)

    ours = evaluate(estimate, figure_eight).metrics()

    for word in ("rmse", "mean", "median", "max"):
        assert ours[quantity.format(word) + "[se2,n=401]"] == pytest.approx(scale * theirs[word], abs=1e-9)


def test_the_alignment_agrees(estimate: Trajectory, figure_eight: Trajectory) -> None:
    rotation, translation, _ = _in_space(estimate).align(_in_space(figure_eight))  # type: ignore[attr-defined]

    ours = align(associate(estimate, figure_eight), "se2").pose_truth_estimate

    assert ours.theta == pytest.approx(math.atan2(rotation[1, 0], rotation[0, 0]), abs=1e-9)
    np.testing.assert_allclose([ours.x, ours.y], translation[:2], atol=1e-9)


def test_relative_errors_over_a_time_agree_with_those_over_as_many_frames(
    estimate: Trajectory, figure_eight: Trajectory
) -> None:
    metric = evo_metrics.RPE(
        evo_metrics.PoseRelation.translation_part, delta=20, delta_unit=evo_metrics.Unit.frames, all_pairs=True
    )
    theirs = _statistics(metric, _in_space(figure_eight), _in_space(estimate))

    ours = relative_error(associate(estimate, figure_eight), 1.0, "s")  # 20 frames at 20 Hz

    assert ours is not None
    assert ours.n == 381
    assert ours.position.rmse == pytest.approx(theirs["rmse"], abs=1e-9)
    assert ours.position.median == pytest.approx(theirs["median"], abs=1e-9)
