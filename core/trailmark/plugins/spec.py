"""What the registry knows about a part before its class is imported."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, get_args

from trailmark.errors import ConstructionError, PluginLoadError
from trailmark.failures import speaks_for_itself, words_of
from trailmark.metrics import Judged, MetricSpec

if TYPE_CHECKING:
    from trailmark.config.base import PluginConfig

__all__ = ["KINDS", "Kind", "Spec", "import_string"]

Kind = Literal[
    "source",
    "localizer",
    "estimator",
    "path_store",
    "controller",
    "sink",
    "fault",
    "metric",
    "dataset",
    "experiment",
    "executor",
]

#: The kinds of part that a plugin may bring.
KINDS: tuple[Kind, ...] = get_args(Kind)

_IMPORT_STRING = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


def import_string(target: str | type, module: str = "") -> str:
    """Return ``"module:Name"`` for a target as plugins write it.

    Parameters
    ----------
    target : str or type
        ``"module:Name"``; ``":Name"``, a name in the plugin's own module; or the object itself.
    module : str
        The plugin's own module.

    Raises
    ------
    ValueError
        If it has another form.
    """
    if not isinstance(target, str):
        return f"{target.__module__}:{target.__qualname__}"
    full = module + target if target.startswith(":") else target
    if not _IMPORT_STRING.fullmatch(full):
        raise ValueError(f"{target!r} is no import string; write 'package.module:Name'")
    return full


@dataclass(frozen=True, slots=True)
class Spec:
    """A registered part. Its class is imported on first use, by `load`.

    Attributes
    ----------
    kind, name : str
        What a config calls it.
    target, config : str
        Import strings of the class and of its config model; ``config`` may be None: no keys.
    summary, reference : str
        One line for listings, and the publication it follows.
    extra : str or None
        The pip extra of the distribution that it needs.
    gives : frozenset of str
        What a localizer may say: of ``motion``, ``fix``, ``path_offset``; empty: not told.
    opens : tuple of str
        What a source plays without a config: patterns of file names (``*.mp4``), or of a file in a
        folder (``*/rgb.txt``). Its config then has the key ``path``.
    judges, quantities
        What a metric is given, ``trajectory`` or ``estimates``, and what it declares of its numbers.
    distribution, version, entry_point : str
        Where it comes from.
    """

    kind: Kind
    name: str
    target: str
    config: str | None = None
    summary: str = ""
    reference: str = ""
    extra: str | None = None
    gives: frozenset[str] = frozenset()
    opens: tuple[str, ...] = ()
    judges: Judged = "trajectory"
    quantities: tuple[MetricSpec, ...] = ()
    distribution: str = ""
    version: str = ""
    entry_point: str = ""

    @property
    def origin(self) -> str:
        """The plugin, in words: ``plugin 'divs' (trailmark 0.1.0)``."""
        return f"plugin {self.entry_point!r} ({f'{self.distribution} {self.version}'.strip()})"

    def load(self) -> Any:
        """Import and return the class (or, for a metric, the function).

        Raises
        ------
        PluginLoadError
            If the import fails, naming the plugin, the error and what to install.
        """
        return self._import_target(self.target)

    def construct(self, config: PluginConfig | None, place: str = "") -> Any:
        """Return an object of the class, made with its config.

        Parameters
        ----------
        config : PluginConfig
            The part's own keys.
        place : str
            Where the part stands in a config, for the message.

        Raises
        ------
        PluginLoadError
            If the class cannot be imported; a `ConstructionError`, if its constructor raises what is no error of
            Trailmark.
        """
        cls = self.load()
        with self.naming_what_fails(place):
            return cls(config)

    @contextmanager
    def naming_what_fails(self, place: str = "") -> Iterator[None]:
        """Turn what a constructor raises into a `ConstructionError` that names the part; for a ``with`` block."""
        try:
            yield
        except BaseException as error:
            if speaks_for_itself(error):
                raise
            raise ConstructionError(
                f"{place and f'{place}: '}{self.kind} {self.name!r} of {self.origin} cannot be constructed:"
                f" {words_of(error)}",
                f"{self.kind} {self.name!r}",
            ) from error

    def load_config(self) -> type[PluginConfig]:
        """Import and return the config model; the empty one where the part has no keys.

        Raises
        ------
        PluginLoadError
            If the import fails, or the model does not derive from `PluginConfig`.
        """
        from trailmark.config.base import PluginConfig  # pydantic is not needed to list plugins

        if self.config is None:
            return PluginConfig
        model = self._import_target(self.config)
        if not (isinstance(model, type) and issubclass(model, PluginConfig)):
            raise PluginLoadError(f"{self.kind} {self.name!r} of {self.origin}: {self.config} is no PluginConfig")
        return model

    def _import_target(self, target: str) -> Any:
        module, _, attribute = target.partition(":")
        try:
            found: Any = import_module(module)
            for part in attribute.split("."):
                found = getattr(found, part)
        except (Exception, SystemExit) as error:  # a module that calls sys.exit() is broken, not a wish to leave
            raise PluginLoadError(
                f"{self.kind} {self.name!r} of {self.origin} cannot be imported: "
                f"{type(error).__name__}: {error}. {self._remedy(error)}"
            ) from error
        return found

    def _remedy(self, error: BaseException) -> str:
        if self.extra and isinstance(error, ImportError):
            return f"Install what it needs: {self.pip_line}"
        return "Run 'trailmark plugins doctor --deep' for the traceback"

    @property
    def pip_line(self) -> str:
        """The command that installs the extra."""
        return f"pip install '{self.distribution or 'trailmark'}[{self.extra}]'"
