"""Noise of localizers, measured against the truth, as lines of a config."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from trailmark.cli.evaluate import evaluate_command
from trailmark.errors import DataError
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.measured_noise import config_lines, measured_noise
from trailmark.geometry import Pose2, Trajectory, write_tum
from trailmark.paths import Path, Waypoint

N, DT_S = 2000, 0.1


def true_way() -> Trajectory:
    poses = [Pose2(1.0, 2.0, 0.3)]
    for i in range(N):
        poses.append(poses[-1] @ Pose2(0.05, 0.0, 0.01 * math.cos(0.02 * i)))
    return Trajectory.from_poses((DT_S * i, pose) for i, pose in enumerate(poses))


def table(kind: str, sigmas: tuple[float, float, float], stated: tuple[float, float, float], **more) -> EstimateTable:
    """What a localizer says that errs by `sigmas`, and states others."""
    rng, truth = np.random.default_rng(4), true_way()
    rows = []
    for i in range(1, N + 1):
        noise = rng.normal(size=3) * sigmas
        pose = truth[i][1]
        if kind == "motion":
            numbers = truth[i - 1][1].between(pose).array() + noise
        elif kind == "fix":
            numbers = pose.array() + noise
        else:
            on_path = more["path"].locate(pose)
            numbers = np.array([on_path.station_m, on_path.lateral_m, on_path.heading_rad]) + noise
        rows.append(numbers)
    stamps = DT_S * np.arange(1, N + 1)
    information = np.diag([0.0 if math.isinf(sigma) else sigma**-2 for sigma in stated])
    words = {name: np.array([value] * N) for name, value in (("source", "one"), ("kind", kind), ("reason", ""))}
    return EstimateTable(
        arrived_s=stamps,
        since_s=stamps - DT_S if kind == "motion" else np.full(N, np.nan),
        stamp_s=stamps,
        outcome=np.array(["accepted"] * N),
        numbers=np.array(rows),
        information=np.repeat(information[None], N, axis=0),
        nis=np.full(N, np.nan),
        dof=np.full(N, np.nan),
        **words,
    )


def test_fixes_are_measured_by_their_root_mean_square_and_against_what_they_state() -> None:
    found = measured_noise(table("fix", (0.03, 0.02, 0.01), (0.01, 0.02 / 3, 0.01 / 3)), true_way())["one"]

    assert found.n == N
    np.testing.assert_allclose(found.rms, (0.03, 0.02, 0.01), rtol=0.1)
    assert found.sigma_scale == pytest.approx(3.0, rel=0.1)


def test_motion_is_compared_over_a_second_whatever_the_rate() -> None:
    sigmas = (2e-3, 1e-3, 3e-3)

    found = measured_noise(table("motion", sigmas, tuple(sigma / 2 for sigma in sigmas)), true_way())["one"]

    assert found.n == N // 10
    assert found.sigma_scale == pytest.approx(2.0, rel=0.2)
    assert found.rms[2] == pytest.approx(3e-3 * math.sqrt(10), rel=0.25)


def test_what_was_not_measured_is_not_judged() -> None:
    found = measured_noise(table("motion", (9.0, 9.0, 1e-3), (math.inf, math.inf, 1e-3)), true_way())["one"]

    assert math.isnan(found.rms[0])
    assert found.sigma_scale == pytest.approx(1.0, rel=0.25)


def test_path_offsets_need_the_path() -> None:
    path = Path(Waypoint(i, 0.05 * i, pose) for i, (_, pose) in enumerate(true_way()))
    offsets = table("pathoffset", (0.0, 0.02, 0.01), (math.inf, 0.02, 0.01), path=path)

    found = measured_noise(offsets, true_way(), path)["one"]

    np.testing.assert_allclose(found.rms[1:], (0.02, 0.01), rtol=0.15)
    with pytest.raises(DataError, match="path offsets: their errors need the path"):
        measured_noise(offsets, true_way())


def test_the_lines_are_a_config_that_the_estimator_takes() -> None:
    noise = measured_noise(table("fix", (0.03, 0.02, 0.01), (0.01, 0.01, 0.01)), true_way())

    document = YAML(typ="safe", pure=True).load(config_lines(noise))["estimator"]

    assert document.pop("plugin") == "kalman"
    treatment = KalmanConfig.model_validate(document).sources["one"]
    assert treatment.floor_m == pytest.approx(0.0255, rel=0.1)
    assert treatment.floor_deg == pytest.approx(math.degrees(0.01), rel=0.1)


def test_the_command_prints_them_and_says_what_it_needs(tmp_path) -> None:
    truth, said = tmp_path / "truth.tum", tmp_path / "estimates.csv"
    write_tum(truth, true_way())
    header = "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,"
    lines = [header + "status,nis,dof,reason"]
    lines += [
        f"{at},camera,fix,,{at},{pose.x + 0.01},{pose.y},{pose.theta},1e4,0,0,1e4,0,1e4,accepted,,,"
        for at, pose in list(true_way())[1:50]
    ]
    said.write_text("\n".join(lines) + "\n")

    printed = CliRunner().invoke(evaluate_command, [str(truth), str(said), "--noise"], catch_exceptions=False)
    as_json = CliRunner().invoke(evaluate_command, [str(truth), str(said), "--noise", "--json"])

    assert printed.exit_code == as_json.exit_code == 0
    assert "camera: {floor_m: 0.00707, floor_deg: 0.0001}" in printed.output
    assert '"sigma_scale"' in as_json.output
