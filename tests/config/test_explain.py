"""What is wrong with a value, in words: every branch of a union, a misspelt word, a list that is too short."""

from __future__ import annotations

from typing import Any, Literal

import pytest

from trailmark.config import PluginConfig
from trailmark.config.document import Document, Problems
from trailmark.config.explain import validate_at
from trailmark.errors import ConfigError


class Gate(PluginConfig):
    gate: float | Literal["off"] | None = None
    start: Literal["first", "last", "unknown"] | tuple[float, float, float] = "first"
    kind: Literal["ekf", "ukf"] = "ekf"


@pytest.mark.parametrize(
    ("data", "story"),
    [
        ({"gate": "on"}, "gate: must be a valid number or 'off', not 'on'"),
        ({"gate": "offf"}, "gate: must be 'off', not 'offf' (did you mean 'off'?)"),
        ({"gate": [1]}, "gate: must be a valid number or 'off', not [1]"),
        ({"start": "frist"}, "not 'frist' (did you mean 'first'?)"),
        ({"start": 3}, "start: must be 'first', 'last' or 'unknown' or a list, not 3"),
        ({"start": [1.0, 2.0]}, "start: the list is too short: item 3 is missing"),
        ({"kind": "pf"}, "kind: must be 'ekf' or 'ukf', not 'pf'"),
    ],
)
def test_what_is_wrong_is_said_with_all_that_would_be_right(data: dict[str, Any], story: str) -> None:
    problems = Problems(Document(data))

    assert validate_at(Gate, data, (), problems, None) is None

    with pytest.raises(ConfigError) as raised:
        problems.raise_if_any()
    (line,) = str(raised.value).splitlines()
    assert story in line
