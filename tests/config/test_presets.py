"""One word that stands for several keys: what wins, what is told, what is written down."""

from __future__ import annotations

from typing import ClassVar, Literal

import pytest
from pydantic import Field, ValidationError

from trailmark.config import PresetConfig, PresetValue


class Steering(PresetConfig):
    presets: ClassVar = {
        "paper": {
            "speed_mps": PresetValue(0.3, "Sec. V"),
            "is_stepwise": PresetValue(True, "Sec. IV"),
            "region": PresetValue((0.0, 0.5), "Eq. 7"),
        }
    }

    preset: Literal["paper"] | None = None
    """The steering as printed."""
    speed_mps: float = Field(0.5, gt=0)
    """Speed [m/s]."""
    is_stepwise: bool = False
    """Turn, then drive straight."""
    region: tuple[float, float] = (0.0, 1.0)
    """Rows that are looked at."""
    lookahead_m: float = 6.0
    """Not in the paper [m]."""


def test_a_preset_sets_its_keys_and_no_other() -> None:
    assert Steering(preset="paper").model_dump() == {
        "preset": "paper",
        "speed_mps": 0.3,
        "is_stepwise": True,
        "region": (0.0, 0.5),
        "lookahead_m": 6.0,
    }
    assert Steering().speed_mps == 0.5


def test_what_is_written_beside_a_preset_wins() -> None:
    mixed = Steering(preset="paper", speed_mps=0.1, is_stepwise=False)

    assert (mixed.speed_mps, mixed.is_stepwise, mixed.region) == (0.1, False, (0.0, 0.5))


def test_a_config_as_it_was_resolved_says_the_same_again() -> None:
    mixed = Steering(preset="paper", speed_mps=0.1)

    assert Steering.model_validate(mixed.model_dump(mode="json")) == mixed


@pytest.mark.parametrize("wrong", ["papers", 3, ["paper"], {"a": 1}])
def test_a_preset_that_does_not_exist_is_refused(wrong: object) -> None:
    with pytest.raises(ValidationError) as error:
        Steering.model_validate({"preset": wrong})

    assert error.value.errors()[0]["loc"] == ("preset",)


def test_the_schema_tells_what_a_preset_sets_and_from_where() -> None:
    told = Steering.model_json_schema()["properties"]["preset"]["description"]

    assert told == (
        "The steering as printed. paper sets speed_mps: 0.3 (Sec. V); is_stepwise: true (Sec. IV); "
        "region: [0, 0.5] (Eq. 7)"
    )
