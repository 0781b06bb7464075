"""The registry: every part that a config can name, as specs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TypedDict, Unpack

from trailmark.errors import PluginError, PluginLoadError, UnknownPluginError
from trailmark.metrics import Judged, MetricSpec
from trailmark.plugins.candidates import ALLOW_VARIABLE, PluginRecord
from trailmark.plugins.spec import KINDS, Kind, Spec, import_string

__all__ = ["NO_PLUGINS", "About", "Owner", "Registry"]

#: What to say when not even core's own entry point is there.
NO_PLUGINS = "no plugins registered: run `pip install -e .`"

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_ESTIMATES = frozenset({"motion", "fix", "path_offset"})


@dataclass(frozen=True, slots=True)
class Owner:
    """The plugin that registers.

    Attributes
    ----------
    name : str
        Name of the entry point.
    distribution, version : str
        The installed distribution that it belongs to; empty for a file.
    module : str
        Its module.
    """

    name: str = ""
    distribution: str = ""
    version: str = ""
    module: str = ""


class About(TypedDict, total=False):
    """What a plugin may add to a registration, by name: ``summary="Reads a ring of sonars"``.

    Attributes
    ----------
    summary : str
        One line for lists.
    reference : str
        The publication that it follows.
    extra : str or None
        The extra of its distribution that brings what it needs: ``pip install NAME[extra]``.
    """

    summary: str
    reference: str
    extra: str | None


class _Declared(TypedDict, total=False):
    """What parts of one kind declare besides; see the fields of `Spec`."""

    gives: frozenset[str]
    opens: tuple[str, ...]
    judges: Judged
    quantities: tuple[MetricSpec, ...]


class Registry:
    """Parts by kind and name. Plugins get one in ``trailmark_register`` and add to it.

    A target or config is an import string ``"package.module:Name"``; ``":Name"`` means the plugin's own module. What
    else there is to say of a part is told by name: see `About`.

    Parameters
    ----------
    owner : Owner
        The plugin whose parts are being registered.
    specs : iterable of Spec
        Parts to begin with.
    absent : iterable of PluginRecord
        Plugins that did not load, so that a search can say what is missing.
    """

    def __init__(
        self, owner: Owner | None = None, specs: Iterable[Spec] = (), absent: Iterable[PluginRecord] = ()
    ) -> None:
        self._owner = owner or Owner()
        self._specs = list(specs)
        self._absent = tuple(absent)

    def __iter__(self) -> Iterator[Spec]:
        return iter(self._specs)

    def __len__(self) -> int:
        return len(self._specs)

    def source(
        self,
        name: str,
        target: str | type,
        config: str | type | None = None,
        *,
        opens: Iterable[str] = (),
        **about: Unpack[About],
    ) -> None:
        """Register a `FrameSource`; its config derives from `SourceConfig`.

        `opens` names what it plays without a config, see `Spec`.
        """
        self._add("source", name, target, config, about, opens=tuple(opens))

    def fault(self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]) -> None:
        """Register a `Fault`: ``perturb`` of every source then takes its name as a key, with its config below."""
        self._add("fault", name, target, config, about)

    def localizer(
        self,
        name: str,
        target: str | type,
        config: str | type | None = None,
        *,
        gives: Iterable[str] = (),
        **about: Unpack[About],
    ) -> None:
        """Register a `Localizer`. `gives` names the estimates it may say: ``motion``, ``fix``, ``path_offset``.

        Two that give motion are refused on one sensor and under dead reckoning: 10 m would become 20.
        """
        given = frozenset(gives)
        if not given <= _ESTIMATES:
            raise ValueError(f"localizer {name!r} gives {sorted(given - _ESTIMATES)}; choose of {sorted(_ESTIMATES)}")
        self._add("localizer", name, target, config, about, gives=given)

    def estimator(
        self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]
    ) -> None:
        """Register an `Estimator`."""
        self._add("estimator", name, target, config, about)

    def path_store(
        self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]
    ) -> None:
        """Register a `PathStore`."""
        self._add("path_store", name, target, config, about)

    def controller(
        self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]
    ) -> None:
        """Register a `Controller`."""
        self._add("controller", name, target, config, about)

    def sink(self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]) -> None:
        """Register a `Sink`."""
        self._add("sink", name, target, config, about)

    def metric(
        self,
        name: str,
        target: str | type,
        config: str | type | None = None,
        *,
        judges: Judged = "trajectory",
        quantities: Iterable[MetricSpec] = (),
        **about: Unpack[About],
    ) -> None:
        """Register a metric: a function that returns numbers by name.

        It `judges` a trajectory, ``function(estimate, truth)`` of equal stamps and in one frame, or the estimates of a
        localizer as it told them, ``function(judged)`` with a `trailmark.evaluation.JudgedEstimates`. Its numbers are
        called ``NAME.key``, or as its `quantities` declare; what is declared with a title has a column in every table.
        """
        self._add("metric", name, target, config, about, judges=judges, quantities=tuple(quantities))

    def experiment(
        self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]
    ) -> None:
        """Register an experiment of ``trailmark reproduce``."""
        self._add("experiment", name, target, config, about)

    def dataset(self, name: str, target: str, **about: Unpack[About]) -> None:
        """Register a recording: the import string of a `trailmark.datasets.Dataset`. ``trailmark data`` lists it."""
        self._add("dataset", name, target, None, about)

    def executor(self, name: str, target: str | type, config: str | type | None = None, **about: Unpack[About]) -> None:
        """Register an executor of bench cells."""
        self._add("executor", name, target, config, about)

    def specs(self, kind: str | None = None) -> tuple[Spec, ...]:
        """Return the specs of one kind, or all, in the order of kind, name and distribution."""
        chosen = (spec for spec in self._specs if kind is None or spec.kind == kind)
        return tuple(sorted(chosen, key=lambda spec: (KINDS.index(spec.kind), spec.name, spec.distribution)))

    def names(self, kind: str) -> tuple[str, ...]:
        """Return the names of one kind, sorted."""
        return tuple(sorted({spec.name for spec in self._specs if spec.kind == kind}))

    def find(self, kind: str, name: str) -> Spec:
        """Return the spec of a name, or of ``distribution:name`` where several distributions offer it.

        Raises
        ------
        UnknownPluginError
            If nothing of that kind and name is registered.
        PluginLoadError
            If a plugin of that name is installed but did not load.
        PluginError
            If two plugins offer it and the name does not say which.
        """
        if kind not in KINDS:
            raise UnknownPluginError(f"no kind of part is called {kind!r}; kinds: {', '.join(KINDS)}", KINDS)
        distribution, _, bare = name.rpartition(":")
        found = [spec for spec in self._specs if (spec.kind, spec.name) == (kind, bare)]
        if distribution:
            found = [spec for spec in found if _normal(spec.distribution) == _normal(distribution)]
        if len(found) == 1:
            return found[0]
        raise _ambiguous(found) if found else self._not_found(kind, name, bare)

    def kept_out(self) -> str:
        """Return which plugins are installed and may not load, and why: any of them might bring what is missing."""
        disabled = ", ".join(record.name for record in self._absent if record.status == "disabled")
        blocked = ", ".join(record.name for record in self._absent if record.status == "blocked")
        return "; ".join(
            f"{names} may not load ({why})"
            for names, why in (
                (disabled, f"not on the list of {ALLOW_VARIABLE} or plugins.enable"),
                (blocked, "blocked"),
            )
            if names
        )

    def _add(
        self,
        kind: Kind,
        name: str,
        target: str | type,
        config: str | type | None,
        about: About,
        **declared: Unpack[_Declared],
    ) -> None:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{kind} {name!r}: use lower-case letters, digits and underscores, a letter first")
        if unknown := about.keys() - About.__annotations__.keys():
            known = ", ".join(About.__annotations__)
            raise TypeError(f"{kind} {name!r}: nothing called {', '.join(sorted(unknown))} can be told; known: {known}")
        owner = self._owner
        if any((spec.kind, spec.name, spec.entry_point) == (kind, name, owner.name) for spec in self._specs):
            raise ValueError(f"{kind} {name!r} is registered twice by the same plugin")
        self._specs.append(
            Spec(
                kind,
                name,
                import_string(target, owner.module),
                None if config is None else import_string(config, owner.module),
                distribution=owner.distribution,
                version=owner.version,
                entry_point=owner.name,
                **about,
                **declared,
            )
        )

    def _not_found(self, kind: str, name: str, bare: str) -> PluginError:
        for record in self._absent:
            if bare == record.name:
                return _absent_error(kind, name, record)
        if not self._specs and not self._absent:
            return UnknownPluginError(NO_PLUGINS)
        names = self.names(kind)
        close = get_close_matches(bare, names, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        broken = [record for record in self._absent if record.status == "failed"]
        story = f". Did not load: {', '.join(record.origin for record in broken)}" if broken else ""
        story += f". {self.kept_out()}" if self.kept_out() else ""
        return UnknownPluginError(
            f"no {kind} named {name!r}{hint}; available: {', '.join(names) or 'none'}{story}. "
            "Run 'trailmark plugins' to see what is installed",
            names,
        )


def _absent_error(kind: str, name: str, record: PluginRecord) -> PluginError:
    if record.status == "failed":
        return PluginLoadError(
            f"{kind} {name!r} is not available: {record.origin} did not load: {record.error}. "
            "Run 'trailmark plugins doctor' for the traceback"
        )
    why = "blocked" if record.status == "blocked" else "not on the list of plugins that may load"
    return UnknownPluginError(f"{kind} {name!r} is not available: {record.origin} is {why}")


def _ambiguous(found: list[Spec]) -> PluginError:
    first = found[0]
    origins = " and ".join(spec.origin for spec in found)
    choices = sorted({f"{spec.distribution}:{spec.name}" for spec in found})
    hint = f"write {' or '.join(choices)}" if len(choices) == len(found) else "block one of them"
    return PluginError(f"{first.kind} {first.name!r} is offered by {origins}: {hint}")


def _normal(distribution: str) -> str:
    return re.sub(r"[-_.]+", "-", distribution).lower()
