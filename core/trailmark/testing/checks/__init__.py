"""The contract of every kind of part, as checks that a plugin's own tests run."""

from trailmark.testing.checks.controllers import controller_checks, parametrize_with_controller_checks
from trailmark.testing.checks.estimators import estimator_checks, parametrize_with_estimator_checks
from trailmark.testing.checks.faults import fault_checks, parametrize_with_fault_checks
from trailmark.testing.checks.localizers import localizer_checks, parametrize_with_localizer_checks
from trailmark.testing.checks.sinks import parametrize_with_sink_checks, sink_checks
from trailmark.testing.checks.sources import parametrize_with_source_checks, source_checks
from trailmark.testing.checks.stores import parametrize_with_store_checks, store_checks

__all__ = [
    "controller_checks",
    "estimator_checks",
    "fault_checks",
    "localizer_checks",
    "parametrize_with_controller_checks",
    "parametrize_with_estimator_checks",
    "parametrize_with_fault_checks",
    "parametrize_with_localizer_checks",
    "parametrize_with_sink_checks",
    "parametrize_with_source_checks",
    "parametrize_with_store_checks",
    "sink_checks",
    "source_checks",
    "store_checks",
]
