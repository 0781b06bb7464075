"""Rows of an experiment."""

from __future__ import annotations

import json
import math

import pytest

from trailmark.experiments import Row


@pytest.mark.parametrize(
    ("ours", "bar", "better", "met"),
    [
        (0.1, 0.2, "lower", True),
        (0.3, 0.2, "lower", False),
        (0.3, 0.2, "higher", True),
        (0.1, 0.2, "higher", False),
        (0.2, 0.2, "lower", True),
        (0.1, None, "lower", None),
        (None, 0.2, "lower", False),
        (math.nan, 0.2, "lower", False),
    ],
)
def test_a_bar_is_met_on_its_better_side(ours: float | None, bar: float | None, better: str, met: bool | None) -> None:
    assert Row("e", "i", "m", ours, bar=bar, better=better).met is met  # type: ignore[arg-type]


def test_the_document_has_the_promised_keys_and_no_nan() -> None:
    document = Row("B", "odometer", "%", math.inf, paper=0.99, bar=0.02, spread=math.nan, n=3, seeds=3).document()

    assert set(document) == {
        "experiment", "item", "unit", "paper", "bar", "stretch", "ours", "spread", "better", "met", "n", "seeds",
    }  # fmt: skip
    assert json.loads(json.dumps(document, allow_nan=False))["ours"] is None
