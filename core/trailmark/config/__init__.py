"""Typed configuration."""

from trailmark.config.base import UNNAMED, PluginConfig, Sensor, SensorRole, sensor_roles
from trailmark.config.source import Mounting, SourceConfig

__all__ = ["UNNAMED", "Mounting", "PluginConfig", "Sensor", "SensorRole", "SourceConfig", "sensor_roles"]
