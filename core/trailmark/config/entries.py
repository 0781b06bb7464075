"""The parts of a run as they were configured: validated, and not yet constructed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from trailmark.config.base import PluginConfig
from trailmark.config.document import Keys
from trailmark.config.host import EstimatorOptions, LocalizerOptions, NoOptions, PathStoreOptions
from trailmark.config.source import SourceConfig
from trailmark.frames import Calibration
from trailmark.interfaces import Access, PathStore
from trailmark.plugins.spec import Spec

__all__ = ["EstimatorEntry", "FaultEntry", "LocalizerEntry", "PartEntry", "PathStoreEntry", "SourceEntry"]

Options = TypeVar("Options", bound=PluginConfig, covariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartEntry(Generic[Options]):
    """A part of a run, from its section of the config to the running object.

    Attributes
    ----------
    name : str
        Its name in the config; for a part that has none there, its section, and for a sink its plugin
        (a second one of the same plugin gets ``_2``).
    spec : Spec
        Its plugin.
    config : PluginConfig
        The plugin's own keys.
    options : PluginConfig
        The keys that the host adds for every part of this kind.
    keys : tuple of str and int
        Where it stands in the config.
    place : str
        The same for messages: ``config.yaml line 7: localizers.floor``.
    document : dict
        The part as a config would give it, every default filled in.
    """

    name: str
    spec: Spec
    config: PluginConfig
    options: Options
    keys: Keys = field(default=(), compare=False)
    place: str = field(default="", compare=False)
    document: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def construct(self) -> Any:
        """Return the part, not started.

        Raises
        ------
        PluginLoadError
            If its class cannot be imported or constructed; the message says where the part stands in the config.
        """
        return self.spec.construct(self.config, self.place)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEntry(PartEntry[NoOptions]):
    """A fault of a source's sensors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceEntry(PartEntry[NoOptions]):
    """A frame source; its calibration and its faults are read already.

    Attributes
    ----------
    calibration : Calibration or None
        Of the source's only sensor, from ``config.calibration``.
    faults : tuple of FaultEntry
        From ``config.perturb``, in the order in which they are applied.
    perturbed : tuple of str or None
        The sensors that the faults befall; None: all that they can.
    """

    config: SourceConfig
    calibration: Calibration | None = None
    faults: tuple[FaultEntry, ...] = ()
    perturbed: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerEntry(PartEntry[LocalizerOptions]):
    """A localizer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorEntry(PartEntry[EstimatorOptions]):
    """The estimator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PathStoreEntry(PartEntry[PathStoreOptions]):
    """The path store."""

    def open(self, access: Access | None, base_dir: Path | None) -> PathStore | None:
        """Return the store for one access, not started; None if the config does not say which store it is.

        Parameters
        ----------
        access : {"read", "create", "append", "overwrite"} or None
            How it is opened; None: for teaching, as the config says.
        base_dir : Path or None
            Where relative paths start.
        """
        store_class: type[PathStore] = self.spec.load()
        with self.spec.naming_what_fails(self.place):
            return store_class.open(self.config, access, base_dir)
