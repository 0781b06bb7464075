"""Worlds and their options in words."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from trailmark_sim.sensors.catalogue import names_in
from trailmark_sim.worlds import WORLDS, options_model, world_module

__all__ = ["option_rows", "world_rows"]


def world_rows() -> list[dict[str, Any]]:
    """Return name, summary, routes, sensors and options of every world, without building one."""
    rows: list[dict[str, Any]] = []
    for name in sorted(WORLDS):
        module = world_module(name)
        summary = (module.__doc__ or "").strip().splitlines()[0]
        options = list(options_model(name).model_fields)
        names = {"routes": list(module.ROUTES), "sensors": list(names_in(module.SENSORS)), "options": options}
        rows.append({"world": name, "summary": summary} | names)
    return rows


def option_rows(world: str) -> list[dict[str, str]]:
    """Return key, default and meaning of every option of a world, nested ones with dots.

    Raises
    ------
    ConfigError
        If there is no world of that name.
    """
    world_module(world)
    return _rows(options_model(world), "")


def _rows(model: type[BaseModel], prefix: str) -> list[dict[str, str]]:
    rows = []
    for name, field in model.model_fields.items():
        default = "" if field.is_required() or field.default in (None, ()) else str(field.default)
        inner = _model_in(field.annotation)
        meaning = (field.description or "").replace("\n", " ")
        rows.append({"key": prefix + name, "default": "" if inner else default, "meaning": meaning})
        if inner is not None:
            rows += _rows(inner, f"{prefix}{name}.")
    return rows


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the model that a field holds, alone, in a union or in a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(part) for part in getattr(annotation, "__args__", ()))
    return next((model for model in found if model is not None), None)
