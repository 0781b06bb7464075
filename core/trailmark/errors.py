"""Errors that Trailmark raises on purpose.

::

    TrailmarkError
    ├── ConfigError (also ValueError)      a config, an option or an argument is wrong
    │   └── SensorMismatchError            the sensors of the run do not fit its localizers
    ├── ShapeError (also ValueError)       an array has the wrong shape, size or dtype
    ├── PluginError
    │   ├── UnknownPluginError             nothing of that name is registered
    │   └── PluginLoadError                it is registered, but cannot be imported or built
    │       └── ConstructionError (also RunError)    its constructor raised
    ├── DataError
    │   ├── SourceError                    a recording or device gives something unusable
    │   │   └── SourceFailedError (also RunError)    the source itself raised
    │   └── StoreError                     a path store is corrupt, foreign, too new or not writable
    │       └── StoreFailedError (also RunError)     it failed while it was written
    └── RunError                           a part raised while the pipeline ran

Getting lost is not an error: it is the estimate ``Lost``.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = [
    "ConfigError",
    "ConstructionError",
    "DataError",
    "PluginError",
    "PluginLoadError",
    "RunError",
    "SensorMismatchError",
    "ShapeError",
    "SourceError",
    "SourceFailedError",
    "StoreError",
    "StoreFailedError",
    "TrailmarkError",
    "UnknownPluginError",
]


class TrailmarkError(Exception):
    """Base of every error that Trailmark raises on purpose.

    The message is one or more lines that say what is wrong, where, and what to do next;
    the command line prints it as it is.
    """


class ConfigError(TrailmarkError, ValueError):
    """A config file, an option or an argument is wrong; the request cannot be carried out."""


class SensorMismatchError(ConfigError):
    """The sensors that the sources turn out to have do not fit what the config asks for."""


class ShapeError(TrailmarkError, ValueError):
    """An array has the wrong shape, size or dtype."""


class PluginError(TrailmarkError):
    """Something is wrong with a plugin."""


class UnknownPluginError(PluginError):
    """Nothing of that kind and name is registered.

    Attributes
    ----------
    available : tuple of str
        The names that are registered for this kind.
    """

    def __init__(self, message: str, available: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.available = tuple(available)


class PluginLoadError(PluginError):
    """A registered plugin could not be imported or constructed."""


class DataError(TrailmarkError):
    """A file or device gives data that cannot be used."""


class SourceError(DataError):
    """A frame source cannot go on: unreadable image, changed size, stamp that goes back."""


class StoreError(DataError):
    """A path store is corrupt, foreign, of a newer schema, or not writable."""


class RunError(TrailmarkError):
    """A part of the pipeline raised while it ran; `part` names it.

    Attributes
    ----------
    part : str
        Kind and name of the part, for example ``localizer 'floor'``.
    """

    def __init__(self, message: str, part: str = "") -> None:
        super().__init__(message)
        self.part = part


class ConstructionError(PluginLoadError, RunError):
    """The constructor of a part raised what is no error of Trailmark."""


class SourceFailedError(SourceError, RunError):
    """A frame source raised what is no error of Trailmark, or gave what is no frame."""


class StoreFailedError(StoreError, RunError):
    """A path store failed while it was written; what was committed before is in it."""
