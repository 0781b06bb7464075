"""The world that a config asks for."""

from __future__ import annotations

from trailmark.interfaces import Mode
from trailmark_sim.config import SimConfig
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions

__all__ = ["build_configured_world"]


def build_configured_world(config: SimConfig, seed: int = 0, mode: Mode = "track") -> World:
    """Build the world of a config.

    Parameters
    ----------
    config : SimConfig
        Which world, and what it is asked for.
    seed : int
        Of everything that differs from run to run.
    mode : {"track", "teach", "replay"}
        Some worlds change between teaching and coming back.

    Raises
    ------
    ConfigError
        If the world has no such route or sensor.
    """
    options = WorldOptions(
        seed=seed,
        world_seed=config.world_seed,
        mode=mode,
        sensors=config.sensors,
        rates_hz=config.rates_hz,
        route=config.route,
        threads=config.threads,
        vehicle=None if config.vehicle is None else config.vehicle.build(),
        extra=config.options,
    )
    return build_world(config.world, options)
