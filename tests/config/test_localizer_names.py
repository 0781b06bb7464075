"""Names of localizers in an estimator's config: what nobody is called is told, with its line and the nearest name."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.config import load_run_config
from trailmark.plugins import Plugins, load_plugins

CONFIG = """
sources: {robot: {plugin: sim, world: ground_course, route: straight, sensors: [wheels]}}
localizers: {wheels: {plugin: odometry}}
estimator:
  plugin: kalman
  sources:
    wheels: {errors: scale}
"""


@pytest.fixture(scope="module")
def installed() -> Plugins:
    return load_plugins()


def notices(tmp_path: Path, installed: Plugins, text: str) -> tuple[str, ...]:
    config = tmp_path / "run.yaml"
    config.write_text(text)
    return load_run_config(config, plugins=installed).notices


def test_names_of_localizers_are_taken_without_a_word(tmp_path: Path, installed: Plugins) -> None:
    assert notices(tmp_path, installed, CONFIG) == ()


def test_a_name_that_no_localizer_has_is_told_with_its_line_and_the_nearest(tmp_path: Path, installed: Plugins) -> None:
    (notice,) = notices(tmp_path, installed, CONFIG + "    whels: {loss: huber}\n")

    assert "run.yaml line 8: estimator.sources.whels: no localizer is called 'whels'" in notice
    assert "did you mean 'wheels'?" in notice


def test_where_none_is_near_all_are_listed(tmp_path: Path, installed: Plugins) -> None:
    (notice,) = notices(tmp_path, installed, CONFIG + "    sonar: {loss: huber}\n")

    assert "no localizer is called 'sonar'; localizers: wheels" in notice
