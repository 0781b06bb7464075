"""The baselines as the plugin registers them."""

from __future__ import annotations

import pytest

from trailmark.config import sensor_roles
from trailmark.interfaces import Localizer
from trailmark.plugins.registry import Owner, Registry
from trailmark_baselines.plugin import trailmark_register


@pytest.fixture
def registry() -> Registry:
    registry = Registry(Owner("baselines", "trailmark", "0"))
    trailmark_register(registry)
    return registry


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("odometry", "wheels"),
        ("constant_speed", "clock"),
        ("klt", "camera"),
        ("orb", "camera"),
        ("phase_correlation", "camera"),
    ],
)
def test_they_give_motion_and_look_at_one_sensor(registry, name, role):
    spec = registry.find("localizer", name)

    assert issubclass(spec.load(), Localizer)
    assert spec.gives == {"motion"}
    assert list(sensor_roles(spec.load_config())) == [role]
    assert all(field.description for field in spec.load_config().model_fields.values())


def test_the_inertial_unit_gives_motion_and_a_heading(registry):
    spec = registry.find("localizer", "imu")

    assert issubclass(spec.load(), Localizer)
    assert spec.gives == {"motion", "fix"}
    assert all(field.description for field in spec.load_config().model_fields.values())
