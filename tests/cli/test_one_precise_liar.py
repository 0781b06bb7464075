"""Wheels beside a precise camera whose scale is wrong: nothing decides between the two, and the belief says so."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from trailmark.evaluation import find_metric

Run = Callable[..., "subprocess.CompletedProcess[str]"]

CONFIG = """
sources:
  robot:
    plugin: sim
    world: ground_course
    route: straight
    sensors: [wheels, floor]
    rates_hz: {floor: 40, wheels: 40}
    duration_s: 6
    perturb: {sensors: [floor], wrong: {scale: 1.1}}
localizers: {wheels: {plugin: odometry}, floor: {plugin: ground_vo, camera: floor}}
estimator: {plugin: kalman}
"""


@pytest.mark.slow
def test_a_camera_whose_scale_is_wrong_beside_wheels_is_not_silently_believed(
    trailmark: Run, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    (tmp_path / "run.yaml").write_text(CONFIG)

    done = trailmark("run", "run.yaml", "--out", "out")

    assert done.returncode == 0, done.stderr
    trajectories = json.loads((tmp_path / "out" / "metrics.json").read_text())["trajectories"]
    assert find_metric(trajectories["fused"]["metrics"], "silent") == 0.0
    told = r"localizer 'floor': wheels and floor disagree by \d\.\d % of the way, steadily: nothing decides, and the"
    assert [text for text in caplog.messages if re.fullmatch(told + " belief covers both", text)]
