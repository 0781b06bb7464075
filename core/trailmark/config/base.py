"""What plugins write their configs with, and what every frame source's config has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationError, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

from trailmark.config.files import ExistingFile

__all__ = [
    "UNNAMED",
    "IsLocalizer",
    "LiveSourceConfig",
    "LocalizerName",
    "Mounting",
    "PluginConfig",
    "Sensor",
    "SensorRole",
    "SourceConfig",
    "sensor_roles",
]

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

    @model_validator(mode="before")
    @classmethod
    def _refuse_booleans_for_numbers(cls, values: Any) -> Any:
        """Refuse ``tilt_deg: true``, which pydantic takes for 1."""
        if not isinstance(values, dict):
            return values
        wrong: list[InitErrorDetails] = []
        for name, info in cls.model_fields.items():
            key = info.alias or name
            if (error := _not_a_number(_types_in(info.annotation))) is not None:
                places = _booleans_in(values.get(key), set())
                wrong += [InitErrorDetails(type=error, loc=(key, *place), input=value) for place, value in places]
        if wrong:
            raise ValidationError.from_exception_data(cls.__name__, wrong)
        return values

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler.resolve_ref_schema(handler(core_schema))
        required = [name for name in schema.get("required", []) if name not in sensor_roles(cls)]
        schema.pop("required", None)
        return schema | ({"required": required} if required else {})


def _booleans_in(value: Any, seen: set[int]) -> Iterator[tuple[tuple[str | int, ...], bool]]:
    """Yield every true and false in a value as it was written, with its place.

    What aliases name many times (`seen` holds the ids) is looked through once: aliases of aliases are a tree without
    end.
    """
    if isinstance(value, bool):
        yield (), value
    elif isinstance(value, dict | list | tuple) and id(value) not in seen:
        seen.add(id(value))
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from (((key, *place), found) for place, found in _booleans_in(item, seen))


def _types_in(annotation: Any) -> list[Any]:
    """Return what a type is made of: of ``tuple[float, float] | Literal["auto"]``, float, float and "auto"."""
    inner = get_args(annotation)
    return [part for each in inner for part in _types_in(each)] if inner else [annotation]


def _not_a_number(types: list[Any]) -> PydanticCustomError | None:
    """Return what is wrong with a boolean, if there is a number among the types and nothing that it may be."""
    if not (float in types or int in types) or any(
        isinstance(part, bool)
        or (isinstance(part, type) and issubclass(part, BaseModel))  # a model looks at its own fields
        or any(part is each for each in (bool, Any, object))
        for part in types
    ):
        return None
    number = "number" if float in types else "integer"
    return PydanticCustomError("number_type", "Input should be a valid {number}", {"number": number})


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


class Mounting(PluginConfig):
    """Where a sensor sits on the robot: ``point_base = pose_base_sensor @ point_sensor``."""

    x: float = 0.0
    """Forward [m]."""
    y: float = 0.0
    """To the left [m]."""
    z: float = 0.0
    """Up [m]."""
    roll_deg: float = 0.0
    """Turn about x [deg]."""
    pitch_deg: float = 0.0
    """Turn about y [deg]."""
    yaw_deg: float = 0.0
    """Turn about z [deg]."""


class SourceConfig(PluginConfig):
    """Base of every source's config. All but `on_bad_frame` is the pipeline's work, not the source's."""

    calibration: ExistingFile | dict[str, Any] | None = None
    """Calibration of the source's only sensor: a file, or the numbers themselves."""
    mounting: Mounting | None = None
    """Mounting of the source's only sensor."""
    ground_truth: ExistingFile | None = None
    """TUM file with the true trajectory of base."""
    time_offset_s: float = 0.0
    """Added to every stamp of this source [s]."""
    start_s: float | None = Field(None, ge=0)
    """Skip what comes earlier than this after the first frame [s]."""
    stop_s: float | None = Field(None, gt=0)
    """End this long after the first frame [s]."""
    rename: dict[str, str] = Field(default_factory=dict)
    """New names for the source's sensors: old to new."""
    on_bad_frame: Literal["error", "skip"] = "error"
    """An unreadable frame, a changed size, a stamp that goes back: ends the run, or is counted and skipped."""
    perturb: dict[str, Any] | None = None
    """Faults of its sensors, on purpose: keys of the fault `basic` (noise, blur, lost frames, a wrong calibration ...),
    names of other faults with their keys, and `sensors`: which sensors they befall, default: all that they can."""


class LiveSourceConfig(SourceConfig):
    """Base of the config of sources whose frames come when they come."""

    reorder_s: float = Field(0.3, ge=0)
    """How long the frames of other sensors wait at most for an earlier one of this source: a camera is 30 to 300 ms
    behind the odometry. They wait no longer than it was late so far. 0: nobody waits for it [s]."""
