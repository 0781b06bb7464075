"""What plugins write their configs with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

__all__ = ["UNNAMED", "IsLocalizer", "LocalizerName", "PluginConfig", "Sensor", "SensorRole", "sensor_roles"]

#: Value of a sensor role that the config leaves to the host: the only sensor of a fitting kind.
UNNAMED = ""


class PluginConfig(BaseModel):
    """Base of every plugin's config: frozen, unknown keys forbidden, docstrings become descriptions."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        allow_inf_nan=False,
        validate_default=True,
    )

    @model_validator(mode="before")
    @classmethod
    def _leave_roles_to_the_host(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        unnamed = {name: UNNAMED for name in sensor_roles(cls) if cls.model_fields[name].is_required()}
        return unnamed | values

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core_schema))
        required = [name for name in schema.get("required", []) if name not in sensor_roles(cls)]
        schema.pop("required", None)
        return schema | ({"required": required} if required else {})


@dataclass(frozen=True, slots=True)
class SensorRole:
    """Marks a config field that names a sensor, and the kinds that fit.

    Attributes
    ----------
    kinds : tuple of str
        Kinds of sensor that the localizer takes in this role; empty: any.
    """

    kinds: tuple[str, ...]


if TYPE_CHECKING:  # a checker reads Sensor["image"] as a Literal, which is a str: attribute access then type-checks
    from typing import Literal as Sensor
else:

    class Sensor:
        """Type of a config field that names a sensor: ``camera: Sensor["image", "rgbd"]``.

        Left out, the role is filled with the only sensor of a fitting kind. An optional role is
        written ``light: Sensor["scalar"] | None = None`` and stays empty unless named.
        """

        def __class_getitem__(cls, kinds: str | tuple[str, ...]) -> Any:
            names = (kinds,) if isinstance(kinds, str) else tuple(kinds)
            return Annotated[str, SensorRole(names)]


@dataclass(frozen=True, slots=True)
class IsLocalizer:
    """Marks a text that is the name of a localizer."""


LocalizerName = Annotated[str, IsLocalizer()]
"""The name of a localizer; as the key of a mapping (``dict[LocalizerName, X]``) it is checked against those there are.

A name that no localizer has is no error: a bench leaves localizers out, cell by cell.
"""


def sensor_roles(model: type[BaseModel]) -> dict[str, SensorRole]:
    """Return the roles of a config model: field name to the kinds that fit, in order of definition.

    Parameters
    ----------
    model : type
        A config model; fields annotated with ``Sensor[...]`` are its roles.

    Returns
    -------
    dict of str to SensorRole
        Field names and the kinds of payload that fit, in order of definition.
    """
    roles: dict[str, SensorRole] = {}
    for name, info in model.model_fields.items():
        role = next((item for item in info.metadata if isinstance(item, SensorRole)), None)
        role = role or _role_in(info.annotation)
        if role is not None:
            roles[name] = role
    return roles


def _role_in(annotation: Any) -> SensorRole | None:
    """Find the mark inside ``Sensor[...] | None``."""
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(item, SensorRole):
            return item
    for argument in getattr(annotation, "__args__", ()):
        role = _role_in(argument)
        if role is not None:
            return role
    return None
