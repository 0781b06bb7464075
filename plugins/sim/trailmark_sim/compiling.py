"""Compiling what sensors are drawn with in a second process, while this one compiles what looks at them.

Numba compiles one kernel at a time in a process. A camera over the ground takes about as long as a localizer that looks
at it, and on a second core it costs no time: the kernels meet on disk, where numba keeps them.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress

from trailmark.worker import n_cores
from trailmark_sim.config import SimConfig
from trailmark_sim.sensors.site import SensorModel
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions

__all__ = ["FirstReadings"]

#: What decides which kernels a world needs, and for what types.
_DECIDES = {"world", "options", "route", "sensors", "rates_hz", "world_seed"}


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
        """Wait until all is compiled: no reading is late for it."""
        process, self._process = self._process, None
        if process is not None:
            process.wait()
            _read_all(self._sensors, self._state)  # whatever became of it: what it did not compile is compiled here

    def close(self) -> None:
        """End the other process, if nobody waited for it."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()


def _takes_long(world: World) -> bool:
    if world.slow_kernel is None or n_cores() < 2:
        return False
    from trailmark.kernels import is_kept

    return not is_kept(world.slow_kernel)


def _compile_beside(config: SimConfig) -> subprocess.Popen[bytes] | None:
    """Start a process that reads each sensor of such a world once; None: it does not start."""
    command = [sys.executable, "-P", "-m", __name__, config.model_dump_json(include=_DECIDES)]
    with suppress(OSError):
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for this process, which then ends that one
        )
    return None


def _read_all(sensors: Sequence[SensorModel], state: VehicleState) -> None:
    for sensor in sensors:
        sensor.render(0, 0.0, state)


def main() -> None:
    """Read each sensor of the world of a config once."""
    config = SimConfig.model_validate_json(sys.argv[1])
    options = WorldOptions(
        world_seed=config.world_seed,
        sensors=config.sensors,
        rates_hz=config.rates_hz,
        route=config.route,
        extra=config.options,
    )
    world = build_world(config.world, options)
    _read_all(world.sensors, VehicleState(world.start))


if __name__ == "__main__":
    main()
