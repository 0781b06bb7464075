"""What the plugin registers, and how cheap that is."""

from __future__ import annotations

import subprocess
import sys

from trailmark.plugins import Registry
from trailmark_ground_vo import plugin
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.map_localizer import GroundMap


def test_the_localizers_and_their_configs_can_be_loaded():
    registry = Registry()

    plugin.trailmark_register(registry)

    spec = registry.find("localizer", "ground_vo")
    assert spec.load() is GroundVO
    assert spec.load_config() is GroundVOConfig
    assert spec.gives == {"motion"}
    spec = registry.find("localizer", "ground_map")
    assert spec.load() is GroundMap
    assert spec.load_config() is GroundMapConfig
    assert spec.gives == {"fix"}


def test_registering_imports_nothing_heavy():
    code = (
        "import sys, trailmark_ground_vo.plugin, trailmark_ground_vo.config;"
        "print([m for m in ('cv2', 'numba', 'scipy', 'sklearn', 'matplotlib') if m in sys.modules])"
    )

    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert shown.stdout.strip() == "[]"


def test_the_starter_asks_which_way_is_forward_and_how_wide_a_picture_is(tmp_path):
    asked = [sys.executable, "-m", "trailmark.cli", "init", "ground", "--out", str(tmp_path / "ground.yaml")]

    said = subprocess.run(asked, capture_output=True, text=True, check=True).stdout

    assert "Which way is forward in the picture?" in said
    assert "yaw_deg 180" in said
    assert "How wide is the ground that one picture shows?" in said
