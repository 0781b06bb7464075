"""The live source keeps the contract of sources, and comes lightly; where what it needs is missing, it says so."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.plugins import load_plugins
from trailmark.testing import source_checks

SPEC = load_plugins().registry.find("source", "ros2")
NAMES = sorted(source_checks(SPEC.load(), lambda: None))


@pytest.mark.parametrize("name", NAMES)
def test_contract(name, domain, robot, messages) -> None:
    robot.repeat("/odom", 100.0, lambda k: messages.odometry(0.01 * k))
    keys = {"domain": domain, "topics": {"wheels": "/odom"}, "command": "/cmd_vel"}

    source_checks(SPEC.load(), lambda: SPEC.load_config().model_validate(keys), n_frames=20)[name]()


def test_it_says_in_a_line_what_to_install() -> None:
    code = (
        "import sys; sys.modules['cyclonedds'] = None\n"
        "from trailmark.api import create\n"
        "from trailmark.errors import PluginLoadError\n"
        "for kind, keys in (('source', {'topics': {'wheels': '/odom'}}), ('sink', {})):\n"
        "    try:\n"
        "        create(kind, 'ros2', **keys)\n"
        "    except PluginLoadError as error:\n"
        "        print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    lines = done.stdout.strip().splitlines()
    assert len(lines) == 2
    assert all("pip install 'trailmark[ros2]'" in line for line in lines)


def test_a_config_without_topics_is_refused() -> None:
    with pytest.raises(ValueError, match="name a topic, as topics"):
        SPEC.load_config().model_validate({})


def test_a_topic_without_its_slash_is_refused() -> None:
    with pytest.raises(ValueError, match="'odom' is no topic"):
        SPEC.load_config().model_validate({"topics": {"wheels": "odom"}})


def test_an_interface_cannot_carry_markup() -> None:
    with pytest.raises(ValueError, match="neither loopback nor the name"):
        SPEC.load_config().model_validate({"topics": {"wheels": "/odom"}, "interface": 'lo"/><x a="'})
