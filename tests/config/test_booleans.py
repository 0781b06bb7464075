"""A true or false for a number is refused, in the config of every part; pydantic takes it for 1 or 0."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import pytest
from pydantic import BaseModel, Field, ValidationError

from trailmark.config import PluginConfig
from trailmark.config.host import LocalizerOptions, RunSettings
from trailmark.plugins import load_plugins

_SPECS = [spec for spec in load_plugins().registry.specs() if spec.config is not None]


class Inner(PluginConfig):
    size_m: float = 1.0


class Outer(PluginConfig):
    tilt_deg: float = Field(1.0, gt=0)
    n: int | None = None
    wait_s: float | Literal["auto"] = "auto"
    corner: tuple[float, float] = (0.0, 0.0)
    gains: dict[str, float] = Field(default_factory=dict)
    parts: list[Inner] = Field(default_factory=list)
    is_on: bool = False
    level: float | bool = False
    anything: dict[str, Any] = Field(default_factory=dict)
    later: float = Field(0.0, alias="async")


@pytest.mark.parametrize(
    ("keys", "place"),
    [
        ({"tilt_deg": True}, ("tilt_deg",)),
        ({"n": False}, ("n",)),
        ({"wait_s": True}, ("wait_s",)),
        ({"corner": [0.0, True]}, ("corner", 1)),
        ({"gains": {"x": True}}, ("gains", "x")),
        ({"parts": [{"size_m": True}]}, ("parts", 0, "size_m")),
        ({"async": True}, ("async",)),
    ],
)
def test_a_boolean_for_a_number_is_refused_where_it_stands(keys: dict[str, Any], place: tuple[object, ...]) -> None:
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(keys)

    assert [error["loc"] for error in caught.value.errors()] == [place]


def test_a_boolean_is_taken_where_it_may_stand() -> None:
    config = Outer.model_validate({"is_on": True, "level": True, "anything": {"x": True}, "n": 1, "tilt_deg": 2})

    assert config.is_on
    assert config.level is True
    assert config.anything == {"x": True}


def _models_in(model: type[BaseModel], seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """Yield a model and those that its fields are made of."""
    if model not in seen:
        seen.add(model)
        yield model
        for info in model.model_fields.values():
            for part in _leaves(info.annotation):
                if isinstance(part, type) and issubclass(part, BaseModel):
                    yield from _models_in(part, seen)


def _leaves(annotation: Any) -> list[Any]:
    inner = getattr(annotation, "__args__", ())
    return [leaf for each in inner for leaf in _leaves(each)] if inner else [annotation]


def _numeric_keys(model: type[BaseModel]) -> list[str]:
    """Return the keys that take a number, and no boolean, by the model's own schema."""
    properties = model.model_json_schema(by_alias=True).get("properties", {})
    kinds = {key: {part.get("type") for part in about.get("anyOf", [about])} for key, about in properties.items()}
    return [key for key, types in kinds.items() if types & {"number", "integer"} and not types & {"boolean", None}]


@pytest.mark.parametrize("spec", _SPECS, ids=[f"{spec.kind}-{spec.name}" for spec in _SPECS])
def test_every_part_refuses_a_boolean_for_a_number(spec: Any) -> None:
    seen: set[type[BaseModel]] = set()
    for model in _models_in(spec.load_config(), seen):
        for key in _numeric_keys(model):
            with pytest.raises(ValidationError) as caught:
                model.model_validate({key: True})

            assert (key,) in [error["loc"] for error in caught.value.errors()], f"{model.__name__}.{key} takes true"


@pytest.mark.parametrize(("model", "key"), [(LocalizerOptions, "latency_ms"), (RunSettings, "control_hz")])
def test_the_host_refuses_a_boolean_for_a_number(model: type[BaseModel], key: str) -> None:
    with pytest.raises(ValidationError) as caught:
        model.model_validate({key: True})

    assert (key,) in [error["loc"] for error in caught.value.errors()]
