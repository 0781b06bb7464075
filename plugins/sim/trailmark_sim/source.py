"""The simulator as a frame source that can be driven."""

from __future__ import annotations

import copy
import heapq
import logging
import math
from collections.abc import Iterator, Mapping

from trailmark.commands import Command, Stop
from trailmark.errors import ConfigError
from trailmark.frames import Frame, Payload, SensorInfo
from trailmark.frames.outlines import Outlines
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Drivable, Session
from trailmark_sim.building import build_configured_world
from trailmark_sim.compiling import FirstReadings
from trailmark_sim.config import SimConfig
from trailmark_sim.keyboard import KEYS_HELP, KeyboardPilot, Terminal
from trailmark_sim.motion import VehicleIntegrator
from trailmark_sim.names import unknown_name
from trailmark_sim.outlines import box_outline
from trailmark_sim.pilots import Driver, Pilot
from trailmark_sim.placing import place_vehicle
from trailmark_sim.rng import frame_rng, stream_key
from trailmark_sim.routes import Route
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds.base import SensorModel, World

__all__ = ["SimSource"]

logger = logging.getLogger(__name__)

#: How often it is checked whether the vehicle touches something [s].
_CHECK_S = 0.02


class SimSource(Drivable):
    """A vehicle in a simulated world.

    Frames of several sensors come in the order of their stamps; at equal stamps in the order of the world's sensors.
    A command holds from the last frame yielded. All that is random is keyed by (seed, mode, stream, frame): the
    same run gives the same bytes, whatever else is asked of it and with however many threads.
    """

    config: SimConfig
    _pending: Command | None

    def __init__(self, config: SimConfig) -> None:
        super().__init__(config)
        self._terminal: Terminal | None = None
        self._first_readings: FirstReadings | None = None
        self._is_closed = False
        self._forget()

    def start(self, session: Session) -> None:
        """Build the world, put the vehicle down, and render every sensor once to warm up, here or beside.

        Raises
        ------
        ConfigError
            If the world has no such route or sensor, or the vehicle would stand in something.
        """
        config = self.config
        self._is_closed = False
        self._forget()
        # A copy of the generator: started again, the source is as new.
        seed = int(copy.deepcopy(session.rng).integers(1 << 62))
        self._seed = stream_key(seed, session.mode)
        self._world = build_configured_world(config, self._seed, session.mode)
        self._route = self._choose_route()
        self._sensors = self._world.sensors
        auto = "commands" if session.mode == "replay" else "route"
        self._driver = auto if config.driver == "auto" else config.driver
        self.drives_itself = self._driver != "commands"
        self._place = place_vehicle(config, session, self._world, self._route, self._seed)
        self._refuse_to_stand_in_something(self._place.pose)
        if self._driver == "keyboard":
            self._terminal = Terminal()
            logger.warning("drive with the keys: %s", KEYS_HELP)
        self._first_readings = FirstReadings(config, self._world, VehicleState(self._place.pose))

    def close(self) -> None:
        """End the frames, and give the terminal back."""
        self._is_closed = True
        if self._first_readings is not None:
            self._first_readings.close()
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    @property
    def world(self) -> World:
        """The world that was built: its routes, and what else is known exactly; known after `start`."""
        return self._world

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {sensor.info.name: sensor.info for sensor in self._sensors}

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return self._world.vehicle.accepts

    def drive(self, command: Command) -> None:
        """Take a command. While it drives itself, only `Stop` is obeyed."""
        if type(command) not in self.accepts:
            kinds = ", ".join(sorted(kind.__name__ for kind in self.accepts))
            raise ConfigError(
                f"the vehicle of world {self.config.world!r} takes {kinds}, not {type(command).__name__};"
                " choose another controller or vehicle"
            )
        if not self.drives_itself or isinstance(command, Stop):
            self._pending = command

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of all sensors until the route or the task is done, or time is up."""
        self._forget()
        self._await_kernels()
        self._motion = VehicleIntegrator(self._world.vehicle, self._place.pose, self._seed, self._build_driver())
        for stamp_s, k, sensor in _schedule(self._sensors):
            if self._is_closed or self._is_over(stamp_s):
                return
            state = self._state_at(stamp_s)
            yield Frame(sensor.info.name, stamp_s, sensor.render(k, stamp_s, state))
            if self._pending is not None:
                self._motion.command(stamp_s, self._pending)
                self._pending = None

    def look(self, k: int = 0) -> Payload:
        """Return reading `k` of the first sensor, as if the vehicle stood where it was put down."""
        self._await_kernels()
        sensor = self._sensors[0]
        return sensor.render(k, k / sensor.rate_hz, VehicleState(self._place.pose))

    def ground_truth(self) -> Trajectory:
        """Return where the vehicle was at the stamps of the frames."""
        return Trajectory.from_poses(self._truth)

    def outlines(self) -> Outlines:
        """Return what stands in the world, and the vehicle."""
        vehicle = self._world.vehicle
        return Outlines(self._world.around, box_outline(Pose2(), vehicle.length_m, vehicle.width_m))

    def lasts_s(self) -> float | None:
        """Return about how long it drives by itself: the rest of its route, unless the config ends it before."""
        if self._driver != "route":
            return None
        route_s = (self._route.length_m - self._place.station_m) / self._route.speed_mps
        return min(route_s, self.config.duration_s or math.inf)

    def counters(self) -> Mapping[str, int]:
        """Return how often the vehicle came to touch something."""
        return {"collisions": self._n_collisions}

    def _await_kernels(self) -> None:
        if self._first_readings is not None:
            self._first_readings.wait()

    def _forget(self) -> None:
        self._pending = None
        self._truth: list[tuple[float, Pose2]] = []
        self._touches: str | None = None
        self._n_collisions = self._n_checks = 0

    def _build_driver(self) -> Driver | None:
        """Return the driver; None: commands drive the vehicle."""
        if self._terminal is not None:
            return KeyboardPilot(self._world.vehicle, self._terminal)
        return Pilot(self._route, self._world.vehicle, self._place.station_m) if self._driver == "route" else None

    def _state_at(self, stamp_s: float) -> VehicleState:
        while self._n_checks * _CHECK_S <= stamp_s:  # on a grid: sensors do not change what is counted
            self._check_touch(self._n_checks * _CHECK_S)
            self._n_checks += 1
        state = self._motion.state_at(stamp_s)
        if not self._truth or stamp_s > self._truth[-1][0]:
            self._truth.append((stamp_s, state.pose_map_base))
        return state

    def _check_touch(self, stamp_s: float) -> None:
        touches = self._world.collides(self._motion.state_at(stamp_s).pose_map_base)
        if touches is not None and touches != self._touches:
            self._n_collisions += 1
            end = "; this ends the run (on_collision: end)" if self.config.on_collision == "end" else ""
            logger.warning("the vehicle touches %s at %.2f s%s", touches, stamp_s, end)
        self._touches = touches

    def _is_over(self, stamp_s: float) -> bool:
        config = self.config
        if config.duration_s is not None and stamp_s >= config.duration_s:
            return True
        if self._n_collisions and config.on_collision == "end":
            return True
        return self._motion.has_finished or stamp_s - self._motion.stands_since_s > config.patience_s

    def _choose_route(self) -> Route:
        config, routes = self.config, self._world.routes
        name = config.route or next(iter(routes))
        if name not in routes:
            raise ConfigError(f"sim: world {config.world!r} has {unknown_name('route', name, routes)}")
        wanted, fastest = config.speed_mps, self._world.vehicle.max_speed_mps
        if wanted is not None and wanted > fastest:
            raise ConfigError(f"sim: speed_mps is {wanted:g}, but the vehicle drives {fastest:g} m/s at most")
        route = routes[name].at_speed(min(wanted or routes[name].speed_mps, fastest))
        return route.swaying(config.sway_m, frame_rng(config.world_seed, "sway")) if config.sway_m else route

    def _refuse_to_stand_in_something(self, pose: Pose2) -> None:
        touches = self._world.collides(pose)
        if touches is not None:
            where = f"({pose.x:.2f} m, {pose.y:.2f} m, {math.degrees(pose.theta):.1f} deg)"
            raise ConfigError(f"sim: at {where} the vehicle stands in {touches}; choose another start")


def _schedule(sensors: tuple[SensorModel, ...]) -> Iterator[tuple[float, int, SensorModel]]:
    """Yield stamp, number and sensor of all readings without end, in the order of stamps, then of sensors."""
    queue = [(0.0, order, 0) for order in range(len(sensors))]
    while queue:
        stamp_s, order, k = queue[0]
        yield stamp_s, k, sensors[order]
        heapq.heapreplace(queue, ((k + 1) / sensors[order].rate_hz, order, k + 1))
