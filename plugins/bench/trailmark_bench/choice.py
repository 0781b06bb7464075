"""Which combinations of a matrix are meant: ``exclude`` in the config, ``--only`` on the command line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from trailmark.config.document import Keys, Problems
from trailmark.errors import ConfigError
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.config import AXES
from trailmark_bench.context import MatrixContext

__all__ = ["Only", "exclusions", "is_excluded"]

_AXES = ("matrix", *AXES.values(), "seed")


class Only:
    """Chooses cells by ``--only axis=pattern``.

    Parameters
    ----------
    patterns : mapping of str to list of str
        Patterns by axis, with ``*`` and ``?``.
    """

    def __init__(self, patterns: Mapping[str, list[str]]) -> None:
        self._patterns = patterns
        self._used: set[tuple[str, str]] = set()

    @classmethod
    def read(cls, only: Sequence[str]) -> Only:
        """Return what the options say."""
        patterns: dict[str, list[str]] = {}
        for item in only:
            axis, equals, pattern = item.partition("=")
            if not equals or not pattern:
                raise ConfigError(f"--only {item}: write AXIS=NAME, for example --only localizer=klt")
            if axis not in _AXES:
                raise ConfigError(f"--only {item}: no axis is called {axis!r}{nearest_or_all(axis, _AXES, 'axes')}")
            patterns.setdefault(axis, []).extend(pattern.split(","))
        return cls(patterns)

    def keeps(self, matrix: str, coordinates: Mapping[str, Any]) -> bool:
        """Whether a cell is meant; one of a matrix without places, whatever places are."""
        known = {"matrix": matrix, **coordinates}
        asked = {axis: found for axis, found in self._patterns.items() if axis != "place" or axis in known}
        fits = [self._any(axis, patterns, known) for axis, patterns in asked.items()]  # notes all of them
        return all(fits)

    def refuse_unused(self) -> None:
        """Refuse patterns that no cell fits: a misspelt name would leave an empty bench."""
        for axis, patterns in self._patterns.items():
            for pattern in patterns:
                if (axis, pattern) not in self._used:
                    raise ConfigError(f"--only {axis}={pattern}: no cell has such a {axis}")

    def _any(self, axis: str, patterns: Sequence[str], known: Mapping[str, Any]) -> bool:
        fits = [pattern for pattern in patterns if axis in known and fnmatchcase(str(known[axis]), pattern)]
        self._used |= {(axis, pattern) for pattern in fits}
        return bool(fits)


def exclusions(
    context: MatrixContext, known: Mapping[str, Sequence[str]], problems: Problems
) -> list[Mapping[str, Any]]:
    """Return the rules that leave cells of a matrix out, with every name in them checked.

    Those of the whole bench may name values of other matrices.

    Parameters
    ----------
    context : MatrixContext
        The matrix.
    known : mapping of str to sequence of str
        Values of the matrix' axes, by what one value of each is called.
    problems : Problems
        Takes what is wrong.
    """
    section, matrix = context.section, context.matrix
    for index, rule in enumerate(matrix.exclude):
        _check_rule(rule, known, (*context.where, "exclude", index), problems)
    rules: list[Mapping[str, Any]] = list(matrix.exclude)
    for index, rule in enumerate(section.exclude):
        for axis in rule:
            if axis not in _AXES:
                hint = nearest_or_all(str(axis), _AXES, "axes")
                problems.add(("bench", "exclude", index), f"no axis is called {axis!r}{hint}")
        if "matrix" not in rule or _is_meant(rule["matrix"], matrix.name):
            rules.append({axis: value for axis, value in rule.items() if axis != "matrix"})
    return rules


def is_excluded(rules: Sequence[Mapping[str, Any]], coordinates: Mapping[str, Any]) -> bool:
    """Whether a rule leaves a cell out."""
    return any(_fits(rule, coordinates) for rule in rules)


def _check_rule(rule: Mapping[str, Any], known: Mapping[str, Sequence[str]], keys: Keys, problems: Problems) -> None:
    for axis, value in rule.items():
        if axis not in known:
            problems.add(keys, f"no axis is called {axis!r}{nearest_or_all(str(axis), known, 'axes')}")
            continue
        for name in value if isinstance(value, list | tuple) else [value]:
            if not any(fnmatchcase(candidate, str(name)) for candidate in known[axis]):
                problems.add(
                    (*keys, axis), f"no {axis} is called {name!r}{nearest_or_all(str(name), known[axis], f'{axis}s')}"
                )


def _fits(rule: Mapping[str, Any], coordinates: Mapping[str, Any]) -> bool:
    return bool(rule) and all(
        axis in coordinates and _is_meant(value, coordinates[axis]) for axis, value in rule.items()
    )


def _is_meant(value: Any, name: Any) -> bool:
    values = value if isinstance(value, list | tuple) else [value]
    return any(fnmatchcase(str(name), str(item)) for item in values)
