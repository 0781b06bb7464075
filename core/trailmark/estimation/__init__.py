"""Estimators: one belief of many estimates, whatever order they come in."""

from trailmark.estimation.history import History

__all__ = ["History"]
