"""Message types of ROS 2: read and written as CDR by rosbags, and described for DDS from the same definitions."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cache, partial
from types import new_class
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

__all__ = [
    "dds_type_name",
    "deserialize",
    "idl_type",
    "is_known",
    "new_message",
    "ros_type_name",
    "serialize",
    "type_hash",
]

#: Bytes from which on a message is not copied.
_LONG = 1 << 14

# What no store of rosbags brings.
_FURTHER = {
    "ackermann_msgs/msg/AckermannDrive": (
        "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk\n"
    ),
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
}


@cache
def _store() -> Typestore:
    """Return the definitions of Jazzy; those of Humble to Kilted are the same for every type that is used here."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _FURTHER.items():
        store.register(get_types_from_msg(text, name))
    return store


def is_known(type_name: str) -> bool:
    """Return whether a type such as ``nav_msgs/msg/Odometry`` is defined here."""
    return type_name in _store().types


def deserialize(cdr: bytes, type_name: str) -> Any:
    """Return a message from its CDR bytes; pixels and points are views of them."""
    # Rosbags cuts the first 4 bytes off, which copies what is no view. In a view numbers of 8 bytes are not aligned:
    # of short messages, which have such, a copy costs nothing.
    return _store().deserialize_cdr(cdr if len(cdr) < _LONG else memoryview(cdr), type_name)


def serialize(message: Any) -> bytes:
    """Return a message as CDR bytes, with their header."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def new_message(type_name: str, fields: Mapping[str, Any]) -> Any:
    """Return a message of a type; a field that is left out is zero, empty or a message of such."""
    made, blanks = _parts(type_name)
    return made(**{name: blank() for name, blank in blanks if name not in fields}, **fields)


@cache
def _parts(type_name: str) -> tuple[Callable[..., Any], list[tuple[str, Callable[[], Any]]]]:
    """Return what makes messages of a type, and what makes a blank value of each of its fields."""
    fields = _store().fielddefs[type_name][1]
    return _store().types[type_name], [(name, _blank(definition)) for name, definition in fields]


def _blank(definition: Any) -> Callable[[], Any]:
    import numpy as np

    node, detail = definition
    if node.name == "NAME":
        return lambda: new_message(detail, {})
    if node.name == "BASE":
        kind = detail[0]
        value = "" if kind in ("string", "wstring") else np.dtype(_numpy_name(kind)).type(0).item()
        return lambda: value
    (inner, inner_detail), length = detail
    n = length if node.name == "ARRAY" else 0
    if inner.name == "BASE" and inner_detail[0] not in ("string", "wstring"):
        return partial(np.zeros, n, dtype=_numpy_name(inner_detail[0]))
    blank = _blank((inner, inner_detail))
    return lambda: [blank() for _ in range(n)]


def _numpy_name(kind: str) -> str:
    return {"byte": "uint8", "char": "uint8", "octet": "uint8"}.get(kind, kind)


def type_hash(type_name: str) -> str:
    """Return the hash by which ROS 2 since Iron knows a type: ``RIHS01_...``."""
    return str(_store().hash_rihs01(type_name))


def dds_type_name(type_name: str) -> str:
    """Return the name of a type in DDS: ``nav_msgs::msg::dds_::Odometry_``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type_name(dds_name: str) -> str:
    """Return the name of a type in ROS; names that are no message of ROS come back as they are."""
    parts = dds_name.split("::")
    if len(parts) == 4 and parts[2] == "dds_" and parts[3].endswith("_"):
        return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"
    return dds_name


@cache
def idl_type(type_name: str) -> Any:
    """Return the type as a class of cyclonedds, for its name and shape alone: bytes never go through it."""
    from cyclonedds.idl import IdlStruct

    fields = {name: _idl_field(definition) for name, definition in _store().fielddefs[type_name][1]}
    namespace = {"__annotations__": fields, "__module__": __name__}
    name, told = f"{type_name.rpartition('/')[2]}_", {"typename": dds_type_name(type_name)}
    bare = new_class(name, (IdlStruct,), told, lambda body: body.update(namespace))
    return dataclasses.dataclass(bare)


def _idl_field(definition: Any) -> Any:
    from cyclonedds.idl import types

    node, detail = definition
    if node.name == "NAME":
        return idl_type(detail)
    if node.name == "BASE":
        kind = detail[0]
        if kind in ("string", "wstring"):
            return str
        return bool if kind == "bool" else getattr(types, _numpy_name(kind))
    inner, length = detail
    if node.name == "ARRAY":
        return types.array[_idl_field(inner), length]
    return types.sequence[_idl_field(inner), length] if length else types.sequence[_idl_field(inner)]
