"""Typed configuration: what plugins write their configs with, and how a config becomes a run."""

from trailmark.config.base import UNNAMED, PluginConfig, Sensor, SensorRole, sensor_roles
from trailmark.config.calibrations import read_calibration
from trailmark.config.document import Document, read_document
from trailmark.config.entries import EstimatorEntry, LocalizerEntry, PartEntry, PathStoreEntry, SourceEntry
from trailmark.config.files import ConfigPath, ExistingFile, ExistingPath, OutputPath
from trailmark.config.host import LocalizerOptions, PathStoreOptions, RunSettings, StopWhen
from trailmark.config.load import load_run_config
from trailmark.config.localizer_names import LocalizerName
from trailmark.config.perturbation import Occluders, Perturbation, WrongCalibration
from trailmark.config.roles import refuse_duplicate_sensors, resolve_all_roles, resolve_roles
from trailmark.config.run import RunConfig, SensorOverride
from trailmark.config.source import Mounting, SourceConfig

__all__ = [
    "UNNAMED",
    "ConfigPath",
    "Document",
    "EstimatorEntry",
    "ExistingFile",
    "ExistingPath",
    "LocalizerEntry",
    "LocalizerName",
    "LocalizerOptions",
    "Mounting",
    "Occluders",
    "OutputPath",
    "PartEntry",
    "PathStoreEntry",
    "PathStoreOptions",
    "Perturbation",
    "PluginConfig",
    "RunConfig",
    "RunSettings",
    "Sensor",
    "SensorOverride",
    "SensorRole",
    "SourceConfig",
    "SourceEntry",
    "StopWhen",
    "WrongCalibration",
    "load_run_config",
    "read_calibration",
    "read_document",
    "refuse_duplicate_sensors",
    "resolve_all_roles",
    "resolve_roles",
    "sensor_roles",
]
