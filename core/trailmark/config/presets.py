"""Presets: one word in a config that stands for several keys, each with where its value comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from trailmark.config.base import PluginConfig

__all__ = ["PresetConfig", "PresetValue"]


@dataclass(frozen=True, slots=True)
class PresetValue:
    """What a preset gives to one key.

    Attributes
    ----------
    value : object
        As a config would give it.
    source : str
        Where it comes from: a section or an equation of a paper, or what the paper leaves out.
    """

    value: Any
    source: str


class PresetConfig(PluginConfig):
    """Config with a key `preset`; what a config writes beside it wins.

    Derived classes list their presets in `presets` and narrow the type of `preset`:

    >>> class Steering(PresetConfig):
    ...     presets: ClassVar = {"paper": {"speed_mps": PresetValue(0.3, "Sec. V")}}
    ...     preset: str | None = None
    ...     '''`paper`: as printed.'''
    ...     speed_mps: float = 0.5
    ...     '''Speed [m/s].'''
    >>> Steering(preset="paper").speed_mps, Steering(preset="paper", speed_mps=1.0).speed_mps
    (0.3, 1.0)
    """

    #: Values of the keys by preset.
    presets: ClassVar[Mapping[str, Mapping[str, PresetValue]]] = {}

    preset: str | None = None
    """Several keys at once; what is written beside it wins."""

    @model_validator(mode="before")
    @classmethod
    def _take_preset(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        named = values.get("preset")
        chosen = cls.presets.get(named) if isinstance(named, str) else None
        return values if chosen is None else {key: one.value for key, one in chosen.items()} | values

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        told = schema.get("properties", {}).get("preset")
        if told is not None:
            told["description"] = " ".join([told.get("description", ""), *map(cls._as_text, cls.presets)]).strip()
        return schema

    @classmethod
    def _as_text(cls, preset: str) -> str:
        """Return what a preset sets, in words."""
        return f"{preset} sets " + "; ".join(
            f"{key}: {_as_written(one.value)} ({one.source})" for key, one in cls.presets[preset].items()
        )


def _as_written(value: Any) -> str:
    """Return a value as a config has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_as_written, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
