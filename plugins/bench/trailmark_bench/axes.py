"""The values of a bench's axes, as they are written: each a piece of a run config."""

from __future__ import annotations

import os
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from trailmark.config.document import Keys, Problems
from trailmark.config.explain import validate_at
from trailmark.config.files import resolve_path
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.config import Limits
from trailmark_bench.context import MatrixContext

__all__ = ["AxisReader", "AxisValue"]

# Keys of a value of an axis that are the bench's, not those of a part.
_OWN_KEYS = ("about", "limits", "needs", "teach")


@dataclass(frozen=True, slots=True, eq=False)
class AxisValue:
    """One value of an axis, as a piece of a run config.

    Attributes
    ----------
    axis, name : str
        Section of ``cells:``, and what it is called there.
    piece : dict
        Of a run config.
    keys, where : tuple
        What these keys of the run config hold is written at those of the bench config.
    teach : dict or None
        What is different while the path is taught; None: with this value nothing has to be taught.
    missing : str
        Why it cannot run here; empty: it can.
    limits : dict
        Limits that it has for itself.
    about : str
        Localizer of it that figures are told of; empty: the first.
    is_installed : bool
        Nobody named it: it is there because a plugin is. Where it finds no sensor, that is nobody's mistake.
    """

    axis: str
    name: str
    piece: dict[str, Any]
    keys: Keys = ()
    where: Keys = ()
    teach: dict[str, Any] | None = None
    missing: str = ""
    limits: dict[str, Any] = field(default_factory=dict)
    about: str = ""
    is_installed: bool = False


class AxisReader:
    """Reads the axes of one matrix.

    Parameters
    ----------
    context : MatrixContext
        The matrix.
    problems : Problems
        Takes what is wrong.
    """

    def __init__(self, context: MatrixContext, problems: Problems) -> None:
        self._document = context.document
        self._matrix = context.matrix
        self._where = context.where
        self._plugins = context.plugins
        self._problems = problems
        self.notices: list[str] = []

    def values(self, axis: str) -> list[AxisValue]:
        """Return the values of an axis; what is wrong with one is noted, and it is left out."""
        written: dict[str, Any] = dict(getattr(self._matrix, axis))
        keys: Keys = (*self._where, axis)
        found = [self._value(axis, str(name), value, (*keys, name)) for name, value in written.items()]
        if axis == "localizers" and self._matrix.installed is not None:
            installed = self._installed_localizers(written).items()
            found += [self._value(axis, name, part, (*keys, name), is_installed=True) for name, part in installed]
        return [value for value in found if value is not None]

    def _installed_localizers(self, written: Mapping[str, Any]) -> dict[str, Any]:
        """Return the localizers that are installed and can be had without a word, by name."""
        wanted = self._matrix.installed
        assert wanted is not None
        named = {value.get("plugin") for value in written.values() if isinstance(value, Mapping)}
        found: dict[str, Any] = {}
        for spec in self._plugins.registry.specs("localizer"):
            is_wanted = not spec.gives or spec.gives & set(wanted.gives)
            if is_wanted and spec.name not in {*named, *wanted.leave_out, *written}:
                try:
                    spec.load_config()()
                    spec.load()
                except ValidationError as error:
                    keys = ", ".join(".".join(map(str, problem["loc"])) for problem in error.errors())
                    self.notices.append(f"localizer {spec.name!r} is left out: it needs {keys}")
                except Exception as error:  # a stranger's plugin: whatever is wrong is no matter of this bench
                    self.notices.append(f"localizer {spec.name!r} is left out: {str(error).splitlines()[0]}")
                else:
                    part = {"plugin": spec.name}
                    found[spec.name] = {"about": spec.name, **wanted.beside, spec.name: part} if wanted.beside else part
        return found

    def _value(self, axis: str, name: str, value: Any, keys: Keys, *, is_installed: bool = False) -> AxisValue | None:
        if isinstance(value, str):
            value = {"plugin": value}
        if not isinstance(value, Mapping):
            self._problems.add(keys, f"must be a mapping, not {value!r}")
            return None
        own = {key: value[key] for key in _OWN_KEYS if key in value}
        content = {key: deepcopy(item) for key, item in value.items() if key not in _OWN_KEYS}
        teach = own.get("teach")
        if teach is not None and not isinstance(teach, Mapping):
            self._problems.add((*keys, "teach"), f"must be a mapping, not {teach!r}")
            return None
        piece, run_keys, where = self._piece(axis, name, content, keys)
        missing = self._missing(own.get("needs", ()), keys)
        limits = self._limits(own.get("limits", {}), (*keys, "limits"))
        about = str(own.get("about", ""))
        if about and about not in piece.get("localizers", {}):
            hint = nearest_or_all(about, piece.get("localizers", {}), "localizers of it")
            self._problems.add((*keys, "about"), f"no localizer is called {about!r}{hint}")
        teach = None if teach is None else dict(teach)
        return AxisValue(axis, name, piece, run_keys, where, teach, missing, limits, about, is_installed)

    def _piece(self, axis: str, name: str, content: dict[str, Any], keys: Keys) -> tuple[dict[str, Any], Keys, Keys]:
        """Return a value as a piece of a run config, and which keys of it stand where."""
        match axis:
            case "sources" | "localizers":
                if "plugin" in content:
                    return {axis: {name: content}}, (axis, name), keys
                return {axis: content}, (axis,), keys
            case "estimators" | "controllers":
                return {axis[:-1]: content}, (axis[:-1],), keys
            case "perturbations":
                return {"perturb": content}, ("perturb",), keys
        return content, (), keys

    def _limits(self, written: Any, keys: Keys) -> dict[str, Any]:
        """Return the limits that a value has for itself."""
        if not isinstance(written, Mapping):
            self._problems.add(keys, f"must be a mapping, not {written!r}")
            return {}
        limits = validate_at(Limits, written, keys, self._problems, self._document.base_dir)
        return {} if limits is None else limits.model_dump(mode="json", exclude_unset=True)

    def _missing(self, needs: Any, keys: Keys) -> str:
        paths = [needs] if isinstance(needs, str) else list(needs)
        for path in paths:
            try:
                found = resolve_path(str(path), self._document.base_dir)
            except ValueError as error:
                return str(error)
            if not os.path.exists(found):
                return f"needs {found}, which is not there"
        return ""
