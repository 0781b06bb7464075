"""The quantities that every evaluation computes, each declared once, in the order of tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from trailmark.metrics import MetricSpec

__all__ = ["QUANTITIES", "quantities_of", "spec_of"]


def _summary(stem: str, unit: str, protocol: Any, difference: str) -> list[MetricSpec]:
    """Return what a `Summary` gives besides the numbers that have columns."""
    return [
        MetricSpec(f"{stem}_{word}_{unit}", unit, protocol=protocol, difference=f"{difference}_{word}_{unit}")
        for word in ("rmse", "mean", "median", "max")
    ]


def _columns() -> list[MetricSpec]:
    """Return the quantities that have a column, in their order."""
    return [
        MetricSpec("tracked_fraction", "share", "higher", "nothing", "tracked"),
        _error("ate_rmse_m", "m", "ATE rmse", ("difference_rmse_m", "difference rmse"), "alignment"),
        _error("ate_max_m", "m", "max", ("difference_max_m", "largest difference"), "alignment"),
        _error(
            "ate_heading_rmse_deg",
            "deg",
            "heading rmse",
            ("difference_heading_rmse_deg", "heading difference"),
            "alignment",
        ),
        _error("rpe_rmse_m", "m", "RPE", ("relative_difference_rmse_m", "relative difference"), "distance"),
        MetricSpec("drift_percent", "%", title="drift"),
        _error("end_error_m", "m", "end error", ("end_difference_m", "difference at end"), ""),
    ]


def _error(name: str, unit: str, title: str, difference: tuple[str, str], protocol: Any) -> MetricSpec:
    """Return an error with a column, and what stands for it without truth: name and title."""
    return MetricSpec(name, unit, "lower", "truth", title, protocol, *difference)


#: Errors of path offsets; they have a table of their own.
_OFFSETS = (("along", "m"), ("lateral", "m"), ("heading", "deg"))


def _all_quantities() -> tuple[MetricSpec, ...]:
    columns = _columns()
    known = {spec.name for spec in columns}
    others = [
        *_summary("ate", "m", "alignment", "difference"),
        *_summary("ate_heading", "deg", "alignment", "difference_heading"),
        *_summary("rpe", "m", "distance", "relative_difference"),
        *_summary("rpe_heading", "deg", "distance", "relative_difference_heading"),
        MetricSpec("drift_deg_per_m", "deg/m"),  # in the details: the table has room for twelve columns
        MetricSpec("end_error_percent", "%", difference="end_difference_percent"),
        MetricSpec("end_heading_error_deg", "deg", difference="end_heading_difference_deg"),
        *_summary("lateral", "m", "", ""),
        *_summary("path_heading", "deg", "", ""),
        *(
            MetricSpec(f"offset_{word}_rmse_{unit}", unit, difference=f"offset_{word}_difference_rmse_{unit}")
            for word, unit in _OFFSETS
        ),
        MetricSpec("nees_per_dof", "", "near one"),
        MetricSpec("nees_inside_fraction", "share", "higher"),
        MetricSpec("nis_per_dof", "", "near one", "nothing"),
        MetricSpec("nis_inside_fraction", "share", "higher", "nothing"),
    ]
    return (*columns, *(spec for spec in others if spec.name not in known))


#: In the order of tables; those with a title have a column.
QUANTITIES: tuple[MetricSpec, ...] = _all_quantities()
_BY_NAME = {spec.name: spec for spec in QUANTITIES}


def quantities_of(documents: Iterable[Mapping[str, Any]]) -> tuple[MetricSpec, ...]:
    """Return the quantities of some ``metrics.json``: the built-in ones, and those that metric plugins declared there.

    Parameters
    ----------
    documents : iterable of mapping of str to Any
        Contents of ``metrics.json``.

    Returns
    -------
    tuple of MetricSpec
        The built-in declarations, then those of the documents; where two documents declare a name, the last.
    """
    declared = {name: item for document in documents for name, item in (document.get("quantities") or {}).items()}
    return (*QUANTITIES, *(MetricSpec.from_document(item) for name, item in declared.items() if name not in _BY_NAME))


def spec_of(name: str, quantities: Iterable[MetricSpec] = QUANTITIES) -> MetricSpec:
    """Return the declaration of a quantity, or of the difference that stands for one.

    What nobody declared is better the lower it is.

    Parameters
    ----------
    name : str
        The quantity's name, without a protocol.
    quantities : iterable of MetricSpec
        Declarations to search.

    Returns
    -------
    MetricSpec
        The declaration; for a name that is declared nowhere a new one, of a quantity that is better the lower it is.
    """
    for spec in quantities:
        difference = spec.as_difference()
        if spec.name == name:
            return spec
        if difference is not None and difference.name == name:
            return difference
    return MetricSpec(name)
