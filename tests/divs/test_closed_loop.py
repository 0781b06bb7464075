"""Teach a way through a corridor, come back another day, and be held on it: localizer, estimator and controller."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from trailmark.commands import Stop, Velocity
from trailmark.estimates import Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint
from trailmark_controllers.drift_steering import DriftSteering
from trailmark_controllers.drift_steering_config import DriftSteeringConfig
from trailmark_divs.config import DivsConfig
from trailmark_divs.localizer import Divs

DT_S = 0.05
SPEED_MPS = 0.3


@dataclass
class Robot:
    """A unicycle with wheels that are a little off, and a camera."""

    world: object
    pose: Pose2
    rng: np.random.Generator
    light: dict
    scale: float | None = None

    def __post_init__(self):
        drawn, self.bias_rad_per_m = 1 + self.rng.normal(0, 0.01), self.rng.normal(0, 0.002)
        self.scale = drawn if self.scale is None else self.scale

    def picture(self):
        shaken = self.pose @ Pose2(theta=self.rng.normal(0, 0.002))
        return Image(self.world.picture(shaken, self.rng, **self.light))

    def drive(self, stamp_s, command):
        way_m, turn_rad = command.forward_mps * DT_S, command.yaw_radps * DT_S
        self.pose = self.pose @ Pose2.exp(way_m, 0.0, turn_rad)
        noise_rad = self.rng.normal(0, 0.006 * math.sqrt(abs(way_m)))
        told = Pose2.exp(way_m * self.scale, 0.0, turn_rad + self.bias_rad_per_m * way_m + noise_rad)
        return Motion(stamp_s, stamp_s + DT_S, told, information_from_sigmas(2e-3, 2e-3, 3e-3))


def step(robot, localizer, estimator, k, command):
    frame = Frame("front", k * DT_S, robot.picture())
    for estimate in localizer.observe(frame, estimator.belief(frame.stamp_s)):
        estimator.apply("streams", estimate)
    belief = estimator.belief(frame.stamp_s)
    command = command(belief)
    if not isinstance(command, Stop):
        estimator.apply("wheels", robot.drive(frame.stamp_s, command))
    return belief, command


def teach(world, localizer_map, config, pieces):
    """Drive pieces of (way, turn); return the path as the robot believes it, and as it truly was."""
    robot = Robot(world, Pose2(), np.random.default_rng(0), {})
    localizer, estimator = Divs(config), DeadReckoning(DeadReckoningConfig())
    localizer.start(Session(name="streams", mode="teach", sensors={"front": world.sensor()}, map=localizer_map))
    estimator.start(Session(mode="teach", start_pose=Pose2()))
    believed, true = [], []
    script = [Velocity(SPEED_MPS, 0, turn / way * SPEED_MPS) for way, turn in pieces for _ in range(round(way / 0.015))]
    for k, command in enumerate(script):
        belief, _ = step(robot, localizer, estimator, k, lambda _, command=command: command)
        if not believed or belief.travelled_m >= believed[-1].station_m + 0.05:
            believed.append(Waypoint(len(believed), belief.travelled_m, belief.pose_map_base))
            true.append(Waypoint(len(true), belief.travelled_m, robot.pose))
    localizer.finish()
    return Path(believed), Path(true)


def replay(world, localizer_map, config, path, start, seed, scale=None):
    """Return where the robot truly went, and whether it arrived."""
    robot = Robot(world, start, np.random.default_rng(seed), {"gamma": 0.7, "noise": 4.0}, scale)
    localizer, estimator = Divs(config), DeadReckoning(DeadReckoningConfig())
    controller = DriftSteering(DriftSteeringConfig())
    session = Session(name="streams", mode="replay", sensors={"front": world.sensor()}, path=path, map=localizer_map)
    for part in (localizer, controller):
        part.start(session)
    estimator.start(Session(mode="replay", path=path, start_pose=path[0].pose_map_base))
    poses = []
    for k in range(6000):
        poses.append(robot.pose)
        _, command = step(robot, localizer, estimator, k, controller.step)
        if isinstance(command, Stop):
            return poses, command.done
    return poses, False


def beside(path, poses):
    """Return stations and offsets of true poses from the true taught path."""
    near, found = None, []
    for pose in poses:
        on_path = path.locate(pose, near)
        near = on_path.station_m
        found.append((near, on_path.lateral_m, on_path.heading_rad))
    return np.array(found).T


@pytest.mark.parametrize("heading_deg", [5, -10])
def test_a_robot_that_starts_askew_comes_back_to_its_path(corridor, localizer_map, heading_deg):
    config = DivsConfig(camera="front")
    path, true_path = teach(corridor, localizer_map, config, [(8.0, 0.0)])

    poses, arrived = replay(corridor, localizer_map, config, path, Pose2(0, 0, math.radians(heading_deg)), seed=3)

    station_m, lateral_m, heading_rad = beside(true_path, poses)
    later = np.abs(lateral_m[station_m > 2.0])
    assert arrived
    assert later[-1] < 0.10
    assert abs(math.degrees(heading_rad[-1])) < 2.0
    assert (later - np.minimum.accumulate(later)).max() < 0.05


def around_the_corner(corner, localizer_map, config, scale=None):
    """Return the largest offset, where it was last, and whether it arrived."""
    pieces = [(6.8, 0.0), (1.2 * math.pi / 2, math.pi / 2), (6.0, 0.0)]
    path, true_path = teach(corner, localizer_map, config, pieces)
    poses, arrived = replay(corner, localizer_map, config, path, Pose2(0, 0.05, 0.05), seed=4, scale=scale)
    _, lateral_m, _ = beside(true_path, poses)
    return np.abs(lateral_m).max(), arrived


def test_a_robot_follows_its_path_around_a_corner(corner, localizer_map):
    largest_m, arrived = around_the_corner(corner, localizer_map, DivsConfig(camera="front"))

    assert arrived
    assert largest_m < 0.15
    assert 0.02 < localizer_map.load("summary")["turning_share"] < 0.5


@pytest.mark.parametrize("how", [{"correspondence": "appearance"}, {"landmark_spacing_m": 2.0, "threshold": "otsu"}])
def test_wheels_that_are_5_percent_off_do_not_miss_the_corner_where_the_view_counts(corner, localizer_map, how):
    largest_m, arrived = around_the_corner(corner, localizer_map, DivsConfig(camera="front", **how), scale=1.05)

    assert arrived
    assert largest_m < 0.20


def test_wheels_that_are_5_percent_off_turn_too_early_by_distance_alone_and_less_so_with_landmarks(
    corner, localizer_map
):
    alone_m, _ = around_the_corner(corner, localizer_map, DivsConfig(camera="front"), scale=1.05)
    localizer_map.rows.clear()
    config = DivsConfig(camera="front", landmark_spacing_m=2.0)

    corrected_m, arrived = around_the_corner(corner, localizer_map, config, scale=1.05)

    assert alone_m > 0.25
    assert arrived
    assert corrected_m < alone_m * 2 / 3  # what is left depends on how near to the corner the last landmark lies
