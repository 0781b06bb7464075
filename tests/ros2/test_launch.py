"""The launch file, with a stand-in for `launch`, of which no wheels exist."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from trailmark.cli import main

EXAMPLE = Path(__file__).parents[2] / "examples" / "ros2"


@pytest.fixture
def process_of(monkeypatch: pytest.MonkeyPatch, load_script: Callable[[str], ModuleType]):
    """Return what takes launch arguments and returns the process that is started, as its keywords."""
    launch, actions, substitutions = (ModuleType(f"launch{name}") for name in ("", ".actions", ".substitutions"))
    vars(launch)["LaunchDescription"] = list
    for name in ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction"):
        vars(actions)[name] = lambda *words, **keys: SimpleNamespace(words=words, **keys)
    vars(substitutions)["LaunchConfiguration"] = lambda name: SimpleNamespace(perform=lambda context: context[name])
    for module in (launch, actions, substitutions):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    described = load_script("examples/ros2/trailmark.launch.py").generate_launch_description()

    def process(**given: str) -> SimpleNamespace:
        *arguments, action = described
        defaults = {argument.words[0]: argument.default_value for argument in arguments}
        assert given.keys() <= defaults.keys()
        (started,) = action.function(defaults | given)
        return started

    return process


def test_arguments_become_a_command_that_trailmark_understands(process_of, capsys) -> None:
    process = process_of(config="no.yaml", mode="replay", store="place.trail", set="seed=1 sources.robot.domain=7")

    program, *words = process.cmd
    with pytest.raises(SystemExit):
        main(words)
    said = "".join(capsys.readouterr())

    assert program == "trailmark"
    assert words[-4:] == ["--set", "seed=1", "--set", "sources.robot.domain=7"]
    assert "no.yaml" in said  # the words are understood, the config is not there
    assert "No such option" not in said


def test_arguments_that_are_left_out_are_not_said(process_of) -> None:
    assert process_of().cmd == ["trailmark", "run", "robot.yaml", "--no-report"]


def test_it_gets_time_to_stop_the_robot(process_of) -> None:
    assert float(process_of().sigterm_timeout) >= 5.0
