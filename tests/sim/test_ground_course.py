"""The courses of the ground-camera paper, and their options."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark.interfaces import Mode
from trailmark_sim.ground.camera import GroundCameraSensor
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import OPTIONS, WORLDS, build_world, options_model, world_module
from trailmark_sim.worlds.base import WorldOptions


def floor_of(route: str, mode: Mode = "teach", **extra: object) -> GroundCameraSensor:
    options = WorldOptions(route=route, mode=mode, sensors=("floor",), extra=extra)
    (camera,) = build_world("ground_course", options).sensors
    assert isinstance(camera, GroundCameraSensor)
    return camera


@pytest.mark.parametrize(("route", "length_m"), [("straight", 10.0), ("indoor", 13.4), ("outdoor", 243.4)])
def test_the_courses_have_the_papers_lengths(route: str, length_m: float) -> None:
    world = build_world("ground_course", WorldOptions(route=route, sensors=()))

    assert world.routes[route].length_m == pytest.approx(length_m, abs=1e-3)
    assert next(iter(world.routes)) == route
    assert world.routes[route].start == Pose2()


def test_the_route_passes_four_gates_half_a_metre_wide_without_touching() -> None:
    world = build_world("ground_course", WorldOptions(route="indoor", sensors=()))
    route, poles = world.routes["indoor"], world.truth["poles"]

    touched = {world.collides(route.pose_at(station)) for station in np.arange(0.0, 13.4, 0.02)}

    assert touched == {None}
    gaps = np.linalg.norm(poles[0::2, :2] - poles[1::2, :2], axis=1) - poles[0::2, 2] - poles[1::2, 2]
    np.testing.assert_allclose(gaps, 0.50)
    assert world.vehicle.width_m == 0.39


def test_a_vehicle_six_centimetres_off_touches_the_gates() -> None:
    world = build_world("ground_course", WorldOptions(route="indoor", sensors=()))
    route = world.routes["indoor"]

    touched = {world.collides(route.pose_at(station) @ Pose2(0.0, 0.06)) for station in np.arange(0.0, 13.4, 0.02)}

    assert touched - {None} == {f"the left pole of gate {n}" for n in (1, 2, 3, 4)}


def test_the_other_courses_have_no_poles() -> None:
    world = build_world("ground_course", WorldOptions(route="straight", sensors=()))

    assert len(world.truth["poles"]) == 0
    assert world.collides(Pose2(1.5, 0.25)) is None


def test_the_campus_has_several_grounds() -> None:
    zones = floor_of("outdoor").tiles.ground.zones

    assert {zone.floor.name for zone in zones} == {"asphalt", "concrete", "pavers", "gravel", "soil", "terrazzo"}


def test_a_strip_of_carpet_lies_on_the_path_only_when_it_is_driven_again() -> None:
    strip = [{"from_m": 4.0, "to_m": 4.5, "floor": "carpet"}]
    inside, beside = (VehicleState(Pose2(x)) for x in (4.25, 5.0))

    taught, again = (floor_of("straight", mode, covered=strip) for mode in ("teach", "replay"))

    assert again.radiance(inside).std() > 2.0 * taught.radiance(inside).std()
    np.testing.assert_array_equal(again.radiance(beside), taught.radiance(beside))


def test_a_strip_may_lie_there_from_the_beginning() -> None:
    strip = [{"from_m": 4.0, "to_m": 4.5, "floor": "carpet", "when": "always"}]

    taught, again = (floor_of("straight", mode, covered=strip) for mode in ("teach", "replay"))

    state = VehicleState(Pose2(4.25))
    np.testing.assert_array_equal(again.radiance(state), taught.radiance(state))


def test_another_day_comes_with_replay() -> None:
    day = {"day": 2, "dirt": 0.5, "gain": 0.9}
    taught, again = (floor_of("straight", mode, in_replay=day) for mode in ("teach", "replay"))
    state = VehicleState(Pose2(1.0))

    difference = again.radiance(state) - taught.radiance(state)

    assert difference.std() > 2.0
    assert again.optics.gain == 0.9
    assert taught.optics.gain == 1.0


def test_the_floor_can_be_chosen_and_turned() -> None:
    ground = floor_of("outdoor", floor="terrazzo", floor_yaw_deg=90.0).tiles.ground

    assert [(zone.floor.name, zone.floor.yaw_rad) for zone in ground.zones] == [("terrazzo", pytest.approx(np.pi / 2))]


def test_every_course_lies_on_its_own_ground() -> None:
    straight, indoor = (floor_of(route).radiance(VehicleState()) for route in ("straight", "indoor"))

    assert abs(np.corrcoef(straight.ravel(), indoor.ravel())[0, 1]) < 0.5


@pytest.mark.parametrize(
    ("options", "story"),
    [
        (WorldOptions(route="indor"), r"no route named 'indor' \(did you mean 'indoor'\?\)"),
        (WorldOptions(sensors=("flor",)), r"no sensor named 'flor' \(did you mean 'floor'\?\)"),
        (WorldOptions(rates_hz={"laser": 10.0}), "no sensor named 'laser'"),
        (WorldOptions(extra={"flor": "wood"}), "has no option 'flor'"),
        (WorldOptions(extra={"floor": "wool"}), "option 'floor' of world 'ground_course'"),
        (WorldOptions(extra={"covered": [{"from_m": 20, "to_m": 21, "floor": "soil"}]}), "the route is 10.0 m long"),
        (WorldOptions(extra={"covered": [{"from_m": 2, "to_m": 1, "floor": "soil"}]}), "must lie beyond from_m"),
        (WorldOptions(extra={"covered": [{"from_m": 1, "to_m": 2}]}), "say what covers it"),
        (WorldOptions(extra={"camera": {"field_mm": [0, 10]}}), "two positive lengths"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(options: WorldOptions, story: str) -> None:
    with pytest.raises(ConfigError, match=story) as caught:
        build_world("ground_course", options)
    assert "\n" not in str(caught.value)


def test_every_registered_world_keeps_the_contract_of_worlds() -> None:
    for name in WORLDS:
        module = world_module(name)
        assert module.SENSORS
        assert module.ROUTES
        assert (module.__doc__ or "").strip()
        assert callable(getattr(module, WORLDS[name].partition(":")[2]))
        assert options_model(name).__doc__
    assert set(OPTIONS) <= set(WORLDS)
