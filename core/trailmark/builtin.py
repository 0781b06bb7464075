"""Registers core's own parts, by the same hook as plugins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl
from trailmark.metrics import MetricSpec

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the estimators, the path store, the sink and the metric that need no plugin."""
    registry.estimator(
        "dead_reckoning",
        "trailmark.estimation.dead_reckoning:DeadReckoning",
        config="trailmark.estimation.dead_reckoning_config:DeadReckoningConfig",
        summary="Integrates the motion of one localizer; a fix corrects the pose at its own stamp",
        reference="Nagai & Watanabe 2015, Eq. (5)",
    )
    registry.estimator(
        "kalman",
        "trailmark.estimation.kalman.estimator:Kalman",
        config="trailmark.estimation.kalman_config:KalmanConfig",
        summary="Weighs any mix of localizers by their covariances; late, wrong and silent ones included",
        reference="Extended Kalman filter (ours, compared with filterpy) or unscented (filterpy)",
    )
    registry.estimator(
        "smoother",
        "trailmark.estimation.smoother.estimator:Smoother",
        config="trailmark.estimation.smoother_config:SmootherConfig",
        summary="Estimates the poses of the last seconds together: what is said later corrects what was believed",
        reference="Fixed-lag smoothing: Gauss-Newton on a window of poses, the oldest eliminated",
    )
    registry.path_store(
        "sqlite",
        "trailmark.stores.sqlite:SqlitePathStore",
        config="trailmark.stores.sqlite_config:SqliteStoreConfig",
        summary="One file per taught place; a kill at any instant loses nothing that was committed",
    )
    registry.sink(
        "jsonl",
        "trailmark.pipeline.outputs.jsonl:JsonlSink",
        config="trailmark.pipeline.outputs.jsonl_config:JsonlConfig",
        summary="Writes beliefs, estimates and commands as lines of JSON, to a file or to standard output",
    )
    registry.metric(
        "silent",
        "trailmark.evaluation.silent:silent",
        judges="estimates",
        quantities=[
            MetricSpec("answered_fraction", "share", "higher", "nothing", "answered"),
            MetricSpec("silent", "share", title="silent"),
            *(MetricSpec(f"silent_{name}", "share") for name in ("single", "1s", "1m")),
        ],
        summary="Share of estimates that are wrong by more than five of their own sigmas, and of answers",
    )
    registry.metric(
        "answers",
        "trailmark.evaluation.answers:answers",
        judges="estimates",
        quantities=[
            MetricSpec("first_answer_s", "s", needs="nothing"),
            MetricSpec("longest_silence_s", "s", needs="nothing"),
            MetricSpec("first_right_s", "s"),
            MetricSpec("recovery_s", "s"),
        ],
        summary="How soon there was an answer and a right one, and the longest time without",
    )
