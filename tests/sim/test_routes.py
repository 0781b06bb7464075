"""Routes, pilots and the motion between frames."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.commands import Steer4WS, Stop
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark_sim.motion import VehicleIntegrator
from trailmark_sim.obstacles import Pole, touched_pole
from trailmark_sim.pilots import Pilot
from trailmark_sim.routes import Route, arc, line, trace
from trailmark_sim.vehicles import Differential, FourWheelSteering, Holonomic, SkidSteer, Vehicle

BENDS = Route.from_poses(trace(Pose2(1.0, 2.0, 0.5), [line(0.6), arc(1.0, 60), arc(1.0, -60), line(0.6)]), 0.25)


def driven(vehicle: Vehicle, route: Route = BENDS, seed: int = 1) -> VehicleIntegrator:
    motion = VehicleIntegrator(vehicle, route.start, seed, Pilot(route, vehicle))
    for n in range(1, 4000):
        motion.state_at(n * 0.05)
        if motion.has_finished:
            return motion
    raise AssertionError("the vehicle never arrived")


def test_a_route_of_pieces_has_their_length_and_turn() -> None:
    poses = trace(Pose2(1.0, 2.0, 0.5), [line(1.0), arc(2.0, 90), line(1.0)], blend_m=0.2)

    route = Route.from_poses(poses, 0.3)

    assert route.length_m == pytest.approx(2.0 + math.pi, abs=1e-4)
    assert poses[-1, 2] == pytest.approx(0.5 + math.pi / 2)
    assert route.curvature_at(2.5) == pytest.approx(0.5, abs=1e-3)
    assert route.curvature_at(0.5) == pytest.approx(0.0, abs=1e-9)


def test_curvature_changes_gradually_between_pieces() -> None:
    route = Route.from_poses(trace(Pose2(), [line(1.0), arc(1.0, 60)], blend_m=0.4), 0.3)

    curvatures = [route.curvature_at(station) for station in np.arange(0.75, 1.3, 0.01)]

    assert np.abs(np.diff(curvatures)).max() < 0.04  # 1 / 0.4 m per 10 mm, and a little
    assert route.curvature_at(1.0) == pytest.approx(0.5, abs=0.03)


def test_a_route_through_points_passes_them() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.2], [2.0, 1.0], [2.5, 2.0]])

    route = Route.through(points, 0.3)

    for x, y in points:
        assert route.path.locate(Pose2(float(x), float(y))).lateral_m == pytest.approx(0.0, abs=2e-3)


def test_a_swaying_route_weaves_about_the_way_and_ends_where_it_does() -> None:
    way = Route.from_poses(trace(Pose2(1.0, 2.0, 0.5), [line(4.0), arc(2.0, 60), line(4.0)]), 0.25)

    swaying = way.swaying(0.003, np.random.default_rng(7))

    assert swaying.start == way.start
    assert swaying.path[-1].pose_map_base.distance_to(way.path[-1].pose_map_base) < 1e-9
    lateral = np.array([way.path.locate(waypoint.pose_map_base).lateral_m for waypoint in swaying.path])
    assert np.sqrt(np.mean(lateral**2)) == pytest.approx(0.003, rel=0.25)
    ahead = np.array([w.pose_map_base.inverse() @ p for w, p in zip(swaying.path, swaying.path.positions[1:])])
    assert np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])).max() < 3.5e-3  # half a step in the sharpest bend, 0.7 / m


def test_a_route_without_length_is_refused() -> None:
    with pytest.raises(ConfigError, match="a route needs a length, not 0"):
        trace(Pose2(), [line(0.0)])


@pytest.mark.parametrize(
    ("vehicle", "tolerance_m"),
    [(FourWheelSteering(), 2e-3), (Differential(), 2e-3), (Holonomic(), 3e-3), (SkidSteer(), 0.03)],
)
def test_a_pilot_keeps_every_vehicle_on_the_route_and_stops_at_its_end(vehicle: Vehicle, tolerance_m: float) -> None:
    motion = VehicleIntegrator(vehicle, BENDS.start, 1, Pilot(BENDS, vehicle))

    laterals = []
    for n in range(1, 4000):
        state = motion.state_at(n * 0.05)
        laterals.append(BENDS.path.locate(state.pose_map_base).lateral_m)
        if motion.has_finished:
            break

    assert motion.has_finished
    assert np.abs(laterals).max() < tolerance_m
    assert state.pose_map_base.distance_to(BENDS.pose_at(99.0)) < 3e-3 + tolerance_m


def test_a_pilot_does_not_stop_where_the_route_passes_its_own_end() -> None:
    around = Route.from_poses(trace(Pose2(), [line(2.0), arc(0.8, 180), line(1.5)]), 0.25)

    motion = driven(Holonomic(), around)

    # the end is level with a place on the first line
    assert motion.state_at(1e3).pose_map_base.distance_to(around.pose_at(99.0)) < 0.02


def test_a_pilot_drives_with_the_speed_of_the_route() -> None:
    motion = VehicleIntegrator(FourWheelSteering(), BENDS.start, 1, Pilot(BENDS, FourWheelSteering()))

    assert motion.state_at(4.0).twist.forward_mps == pytest.approx(0.25, abs=1e-6)


def test_a_pilot_finds_back_to_the_route() -> None:
    vehicle = FourWheelSteering()
    motion = VehicleIntegrator(vehicle, BENDS.start @ Pose2(0.0, 0.05, 0.1), 1, Pilot(BENDS, vehicle))

    state = motion.state_at(8.0)

    assert abs(BENDS.path.locate(state.pose_map_base).lateral_m) < 3e-3


def test_the_way_does_not_depend_on_when_it_is_looked_at() -> None:
    vehicle = FourWheelSteering()
    rare, often = (VehicleIntegrator(vehicle, BENDS.start, 3, Pilot(BENDS, vehicle)) for _ in range(2))
    for stamp_s in np.sort(np.random.default_rng(7).uniform(0.0, 6.0, 500)):
        often.state_at(float(stamp_s))

    assert often.state_at(6.0) == rare.state_at(6.0)


def test_a_command_holds_from_its_stamp() -> None:
    motion = VehicleIntegrator(FourWheelSteering(speed_lag_s=0.0), Pose2(), 1, None)

    motion.command(0.1234, Steer4WS(0.0, 0.0, 0.2))

    assert motion.state_at(0.1234).pose_map_base.x == 0.0
    assert motion.state_at(1.1234).pose_map_base.x == pytest.approx(0.2)


def test_a_command_takes_over_from_the_pilot() -> None:
    motion = VehicleIntegrator(FourWheelSteering(), BENDS.start, 1, Pilot(BENDS, FourWheelSteering()))
    motion.state_at(2.0)

    motion.command(2.0, Stop("enough", done=True))
    motion.state_at(5.0)

    assert motion.pilot is None
    assert motion.has_finished


def test_a_stop_that_is_not_done_does_not_finish() -> None:
    motion = VehicleIntegrator(FourWheelSteering(), Pose2(), 1, None)

    motion.command(0.0, Stop("waiting"))
    motion.state_at(3.0)

    assert not motion.has_finished
    assert motion.stands_since_s == 0.0


def test_slip_depends_on_the_seed_and_not_on_the_way() -> None:
    first, again, other = (driven(Differential(), seed=seed) for seed in (1, 1, 2))
    end = 60.0

    assert first.state_at(end) == again.state_at(end)
    assert first.state_at(end).pose_map_base == other.state_at(end).pose_map_base
    assert first.state_at(end).pose_start_wheels != other.state_at(end).pose_start_wheels


POLE = Pole("the pole", 1.0, 1.0, 0.05)


@pytest.mark.parametrize(
    ("pose", "touches"),
    [
        (Pose2(1.0, 1.0, 0.7), True),
        (Pose2(1.0 - 0.349, 1.0, 0.0), True),  # half of 0.6 m and the radius
        (Pose2(1.0 - 0.351, 1.0, 0.0), False),
        (Pose2(1.0, 1.0 - 0.244, 0.0), True),  # half of 0.39 m and the radius
        (Pose2(1.0, 1.0 - 0.246, 0.0), False),
        (Pose2(1.0, 1.0 - 0.246, math.pi / 2), True),  # turned, its length points there
        (Pose2(1.0 - 0.34, 1.0 - 0.235, 0.0), False),  # beyond the corner
    ],
)
def test_a_rectangle_touches_a_pole(pose: Pose2, touches: bool) -> None:
    assert touched_pole([POLE], 0.6, 0.39, pose) == ("the pole" if touches else None)
