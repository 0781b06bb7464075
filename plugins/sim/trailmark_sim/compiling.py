"""Compiling what sensors are drawn with in a second process, while this one compiles what looks at them.

Numba compiles one kernel at a time in a process. On a second core a camera costs no time: the kernels meet on disk,
where numba keeps them. A localizer takes longer to compile than a camera, so that the process then helps with its own.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from trailmark.isolation.compiling import CompilingProcess, compile_offered
from trailmark.isolation.orphan import end_with_stdin
from trailmark.worker import n_cores
from trailmark_sim.building import build_configured_world
from trailmark_sim.config import SimConfig
from trailmark_sim.sensors.site import SensorModel
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds.base import World

__all__ = ["FirstReadings"]

logger = logging.getLogger(__name__)

#: Keys of the config that decide which kernels a world needs, and for what types.
_KERNEL_KEYS = {"world", "options", "route", "sensors", "rates_hz", "world_seed"}

#: How long the first frame waits for the other process [s]. It needs about 15 s of processor time; one that hangs at a
#: locked or full disk must not keep the run from beginning.
_PATIENCE_S = 60.0

#: How far the other process stands back where there are fewer idle cores than processes.
_NICENESS = 5


class FirstReadings:
    """The first reading of each sensor, which compiles its kernels.

    Parameters
    ----------
    config : SimConfig
        What world was built.
    world : World
        The world.
    state : VehicleState
        Where the vehicle stands.
    """

    def __init__(self, config: SimConfig, world: World, state: VehicleState) -> None:
        self._sensors: Sequence[SensorModel] = world.sensors
        self._state = state
        self._process = _compile_beside(config) if _takes_long(world) else None
        if self._process is None:
            _read_all(self._sensors, state)

    def wait(self) -> None:
        """Wait until all is compiled: no reading is late for it. Where the wait is interrupted, the other one ends."""
        if self._process is None:
            return
        try:
            if not self._process.wait(_PATIENCE_S):
                logger.warning("the process that compiles for sensors is not done in %g s: it is ended", _PATIENCE_S)
        finally:
            self.close()
        _read_all(self._sensors, self._state)  # whatever became of it: what it did not compile is compiled here

    def close(self) -> None:
        """End the other process, if it has not ended."""
        if self._process is not None:
            self._process.close()
            self._process = None  # only now: whoever is interrupted here can close again


def _takes_long(world: World) -> bool:
    if world.slow_kernel is None or n_cores() < 2:
        return False
    from trailmark.kernels import is_kept

    return not is_kept(world.slow_kernel)


def _compile_beside(config: SimConfig) -> CompilingProcess | None:
    """Start a process that reads each sensor of such a world once; None: it does not start."""
    try:
        return CompilingProcess([sys.executable, "-P", "-m", __name__, config.model_dump_json(include=_KERNEL_KEYS)])
    except OSError as error:
        logger.info("no process compiles beside this one: %s", error)
        return None


def _read_all(sensors: Sequence[SensorModel], state: VehicleState) -> None:
    for sensor in sensors:
        sensor.render(0, 0.0, state)


def main() -> None:
    """Compile for the config on the command line, beside the process that holds the other end of standard input."""
    config_json, folder = sys.argv[1:]
    end_with_stdin(Path(folder))
    if hasattr(os, "nice"):  # not on Windows
        os.nice(_NICENESS)
    _compile_for(config_json)
    compile_offered(Path(folder))


def _compile_for(config_json: str) -> None:
    """Read each sensor of the world of a config once."""
    world = build_configured_world(SimConfig.model_validate_json(config_json))
    _read_all(world.sensors, VehicleState(world.start))


if __name__ == "__main__":
    main()
