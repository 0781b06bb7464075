"""Sensors and calibrations as documents: plain mappings for YAML and JSON, for people and for path stores.

A calibration names no model; its keys do::

    metres_per_pixel: 3.9e-4                    # GroundPlane; also [along u, along v]
    lens: {fx: 800, fy: 800, cx: 320, cy: 240}  # a Pinhole
    flat_field: flat.png                        # an array: a file, rows of numbers, or shape, dtype and base64

Poses are ``{x, y, z}`` in metres and ``roll``, ``pitch``, ``yaw`` with the unit in the key: ``yaw_deg`` or ``yaw_rad``.
Reading what was written gives the same numbers, bit for bit.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames.array_documents import array_to_document, in_words, read_array
from trailmark.frames.calibration import Arrays, Calibration, DepthCamera, GroundPlane, Omni, Pinhole
from trailmark.frames.sensors import SensorInfo
from trailmark.geometry import Pose3

__all__ = [
    "calibration_from_document",
    "calibration_to_document",
    "sensor_from_document",
    "sensor_to_document",
]

T = TypeVar("T")
Document = Mapping[str, Any]

_WIDEST_PIXEL_M = 1e9
"""Beyond this, and below its inverse, what is computed of a picture would overflow where nobody knows the key."""

_MODELS: tuple[type[Calibration], ...] = (Pinhole, Omni, GroundPlane, DepthCamera, Arrays)


def sensor_to_document(sensor: SensorInfo) -> dict[str, Any]:
    """Return all that is known about a sensor as a mapping that JSON and YAML can hold."""
    return dict(_write(sensor))


def sensor_from_document(document: Document) -> SensorInfo:
    """Return the sensor of a document. It reads no file: arrays must stand in the document itself.

    Raises
    ------
    ConfigError
        If a key is unknown or missing, or a value is wrong; the message names the key.
    """
    return _read(SensorInfo, document, "sensor", None)


def calibration_to_document(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as a mapping that JSON and YAML can hold."""
    return dict(_write(calibration))


def calibration_from_document(document: Document, base_dir: str | Path | None = None) -> Calibration:
    """Return the calibration of a document; the model follows from its keys.

    Parameters
    ----------
    document : mapping
        As people write it, or as `calibration_to_document` gives it.
    base_dir : path, optional
        Folder at which file names of arrays (``.npy``, ``.png``) start; without it, they are refused.

    Raises
    ------
    ConfigError
        If a key is unknown or missing, a value is wrong or a file cannot be read; the message names the key.
    """
    return _calibration(document, "calibration", None if base_dir is None else Path(base_dir))


# --- reading ---------------------------------------------------------------------------------------------------------


def _calibration(value: Any, where: str, base_dir: Path | None) -> Calibration:
    document = _mapping(value, where)
    if not document:
        raise ConfigError(f"{where} is empty; give for example metres_per_pixel, or fx, fy, cx and cy")
    known = [key for model in _MODELS for key in _keys(model)]
    for key in document:
        if key not in known:
            raise ConfigError(_unknown(key, known, where))
    fitting = [model for model in _MODELS if any(key in _keys(model) for key in document)]
    if len(fitting) > 1:
        first, second = ([key for key in document if key in _keys(model)] for model in fitting[:2])
        raise ConfigError(
            f"{where} mixes {first[0]!r} of {fitting[0].__name__} with {second[0]!r} of {fitting[1].__name__};"
            " a calibration is of one model (the lens of a ground camera stands under 'lens')"
        )
    return _read(fitting[0], document, where, base_dir)


def _read(model: type[T], value: Any, where: str, base_dir: Path | None) -> T:
    document = _mapping(value, where)
    keys = _keys(model)
    for key in document:
        if key not in keys:
            raise ConfigError(_unknown(key, keys, where))
    given = {key: item for key, item in document.items() if item is not None}
    missing = [key for key, is_required in keys.items() if is_required and key not in given]
    if missing:
        raise ConfigError(f"{where} lacks {', '.join(missing)}, which {model.__name__} needs")
    arguments = {key: _READERS[key](item, f"{where}.{key}", base_dir) for key, item in given.items()}
    try:
        return model(**arguments)
    except ShapeError as error:
        raise ConfigError(f"{where}: {error}") from error


def _keys(model: type[Any]) -> dict[str, bool]:
    """Return the fields of a model, and whether each must be given."""
    missing = dataclasses.MISSING
    return {f.name: f.default is missing and f.default_factory is missing for f in dataclasses.fields(model)}


def _unknown(key: Any, known: Sequence[str] | Mapping[str, Any], where: str) -> str:
    near = difflib.get_close_matches(str(key), list(known), n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(known)}"
    return f"{where} has an unknown key {str(key)[:40]!r}; {hint}"


def _mapping(value: Any, where: str) -> Document:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where} must be a mapping of keys to values, not {in_words(value)}")
    return value


def _number(value: Any, where: str, _: Path | None = None) -> float:
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isfinite(number):
            return number
    raise ConfigError(f"{where} must be a finite number, not {in_words(value)}")


def _numbers(value: Any, where: str, _: Path | None = None) -> tuple[float, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        raise ConfigError(f"{where} must be a list of numbers, not {in_words(value)}")
    return tuple(_number(item, f"{where}[{index}]") for index, item in enumerate(value))


def _scales(value: Any, where: str, _: Path | None = None) -> tuple[float, ...]:
    """Read metres per pixel: one number for both directions, or one for each."""
    scales = (_number(value, where),) * 2 if isinstance(value, Real) else _numbers(value, where)
    if any(scale > _WIDEST_PIXEL_M or 0 < scale < 1 / _WIDEST_PIXEL_M for scale in scales):
        raise ConfigError(
            f"{where} must be from {1 / _WIDEST_PIXEL_M:.0e} to {_WIDEST_PIXEL_M:.0e} m, not {in_words(value)}"
        )
    return scales


def _size(value: Any, where: str, _: Path | None = None) -> tuple[int, int]:
    numbers = _numbers(value, where)
    if len(numbers) != 2 or any(number != int(number) or number < 1 for number in numbers):
        raise ConfigError(f"{where} must be [width, height] in whole pixels, not {in_words(value)}")
    return int(numbers[0]), int(numbers[1])


def _text(value: Any, where: str, _: Path | None = None) -> str:
    if not isinstance(value, str):
        raise ConfigError(f"{where} must be a word, not {in_words(value)}")
    return str(value)


def _word(*words: str) -> Callable[[Any, str, Path | None], str]:
    def read(value: Any, where: str, _: Path | None) -> str:
        if value not in words:
            raise ConfigError(f"{where} must be {' or '.join(words)}, not {in_words(value)}")
        return str(value)

    return read


def _lens(value: Any, where: str, base_dir: Path | None) -> Pinhole:
    return _read(Pinhole, value, where, base_dir)


def _pose(value: Any, where: str, _: Path | None) -> Pose3:
    document = _mapping(value, where)
    lengths, angles = ("x", "y", "z"), ("roll", "pitch", "yaw")
    known = [*lengths, *(f"{angle}_{unit}" for angle in angles for unit in ("deg", "rad"))]
    arguments: dict[str, float] = {}
    for key, item in document.items():
        if key not in known:
            raise ConfigError(_unknown(key, known, where))
        number = _number(item, f"{where}.{key}")
        name = key.partition("_")[0]
        if name in arguments:
            raise ConfigError(f"{where} gives {name} twice, in degrees and in radians; give one")
        arguments[name] = math.radians(number) if key.endswith("_deg") else number
    return Pose3(**arguments)


def _arrays(value: Any, where: str, base_dir: Path | None) -> dict[str, npt.NDArray[Any]]:
    document = _mapping(value, where)
    return {str(name): read_array(item, f"{where}.{name}", base_dir) for name, item in document.items()}


def _flat_field(value: Any, where: str, base_dir: Path | None) -> npt.NDArray[Any]:
    """Read relative brightness; a picture of a uniform surface holds grey levels, so it is divided by its mean."""
    array = read_array(value, where, base_dir)
    if np.issubdtype(array.dtype, np.integer) and array.any():
        return np.asarray(array / array.mean(), dtype=np.float32)
    return array


_READERS: dict[str, Callable[[Any, str, Path | None], Any]] = {
    **dict.fromkeys(("fx", "fy", "cx", "cy", "rate_hz", "forward_deg"), _number),
    **dict.fromkeys(("centre_u", "centre_v", "radius_inner_px", "radius_outer_px"), _number),
    **dict.fromkeys(("lens", "colour", "depth"), _lens),
    **dict.fromkeys(("pose_base_sensor", "pose_colour_depth"), _pose),
    **dict.fromkeys(("name", "kind"), _text),
    "distortion": _numbers,
    "turns": _word("clockwise", "counterclockwise"),
    "metres_per_pixel": _scales,
    "flat_field": _flat_field,
    "depth_kind": _word("z", "range"),
    "arrays": _arrays,
    "size": _size,
    "calibration": _calibration,
}


# --- writing ---------------------------------------------------------------------------------------------------------


def _write(value: Any) -> Any:
    """Return a value in the types of JSON; fields that are None are left out."""
    if isinstance(value, np.ndarray):
        return array_to_document(value)
    if isinstance(value, Pose3):
        return {f.name + ("" if len(f.name) == 1 else "_rad"): float(getattr(value, f.name)) for f in _fields(value)}
    if dataclasses.is_dataclass(value):
        return {f.name: _write(getattr(value, f.name)) for f in _fields(value) if getattr(value, f.name) is not None}
    if isinstance(value, Mapping):
        return {str(key): _write(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_write(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _fields(value: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(value)
