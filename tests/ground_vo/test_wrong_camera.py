"""A camera whose scale or mounting is wrong, beside wheels, through the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.cli import main

CONFIG = """
sources:
  robot:
    plugin: sim
    world: ground_course
    route: straight
    sensors: [floor, wheels]
    duration_s: 2.2
    threads: 1
    perturb: {sensors: [floor], wrong: %s}
localizers:
  floor: {plugin: ground_vo}
  wheels: {plugin: odometry}
estimator: {plugin: kalman}
"""


def said_by_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: str) -> str:
    """Return what a run prints, in one line: tables wrap."""
    (tmp_path / "run.yaml").write_text(CONFIG % wrong)
    with pytest.raises(SystemExit):
        main(["run", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "out")])
    said = capsys.readouterr()
    return " ".join((said.out + said.err).split())


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ("{scale: 5}", ["floor: it comes 4.9", "times as far as 'wheels'", "metres_per_pixel"]),
        ("{yaw_deg: 180}", ["against what other motions say", "mounted the other way round (mounting: yaw_deg)"]),
        pytest.param("{scale: 1000}", ["times as far as 'wheels'", "metres_per_pixel"], marks=pytest.mark.long),
    ],
)
def test_what_is_wrong_with_the_camera_is_said_against_the_wheels(tmp_path, capsys, wrong, expected):
    said = said_by_a_run(tmp_path, capsys, wrong)

    assert [words for words in expected if words not in said] == []


@pytest.mark.long
def test_of_a_camera_that_is_right_nothing_is_said(tmp_path, capsys):
    said = said_by_a_run(tmp_path, capsys, "{}")

    assert "times as far as" not in said
    assert "mounting" not in said
