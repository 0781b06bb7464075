"""The sources as the plugin registers them."""

from __future__ import annotations

import pytest

from trailmark.config import SourceConfig
from trailmark.interfaces import FrameSource
from trailmark.plugins.registry import Owner, Registry
from trailmark_datasets.plugin import trailmark_register

NAMES = (
    "camera",
    "carmen_log",
    "csv_odometry",
    "csv_records",
    "euroc",
    "image_folder",
    "kitti_odometry",
    "rgbd_folder",
    "rosbag",
    "tum_rgbd",
    "video",
)


@pytest.fixture
def registry() -> Registry:
    registry = Registry(Owner("datasets", "trailmark", "0"))
    trailmark_register(registry)
    return registry


def test_all_sources_are_registered(registry):
    assert registry.names("source") == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_class_and_config_fit_their_names(registry, name):
    spec = registry.find("source", name)

    assert issubclass(spec.load(), FrameSource)
    assert issubclass(spec.load_config(), SourceConfig)
    assert spec.load().is_live == (name == "camera")


@pytest.mark.parametrize("name", NAMES)
def test_every_key_is_described(registry, name):
    fields = registry.find("source", name).load_config().model_fields

    assert all(field.description for field in fields.values())


def test_only_bags_need_an_extra(registry):
    assert {spec.name for spec in registry.specs() if spec.extra} == {"rosbag"}
