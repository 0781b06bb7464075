"""The plots: what stands at their axes."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.report.figures import distribution_figure
from trailmark.report.style import LineStyle, plotting


@pytest.mark.parametrize("decades", [0.05, 0.3, 0.9, 2.0, 5.0])
def test_a_logarithmic_axis_has_plain_numbers_however_narrow_it_is(decades: float) -> None:
    errors_m = 1.3e-3 * np.logspace(0.0, decades, 200)

    with plotting("a test"):
        figure = distribution_figure({"wheels": errors_m}, {"wheels": LineStyle("#0072b2", 1.3)})
        figure.draw_without_rendering()
    axis = figure.axes[0].xaxis
    low, high = axis.get_view_interval()
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    labels = [t.label1.get_text() for t in ticks if low <= t.get_loc() <= high and t.label1.get_text()]

    assert 2 <= len(labels) <= 12
    assert [float(label) for label in labels] == sorted({float(label) for label in labels})
