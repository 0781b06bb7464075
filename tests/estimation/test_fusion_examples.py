"""The fusion examples run as they are, for a few seconds: taught, driven again, and better than without a fix."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark import Pipeline
from trailmark.evaluation import Protocol, evaluate

EXAMPLES = Path(__file__).parents[2] / "examples" / "fusion"
SHORT = ("sources.robot.duration_s=4", "sources.robot.threads=1")


def test_there_is_an_example_for_each_combination() -> None:
    assert sorted(path.stem for path in EXAMPLES.glob("*.yaml")) == [
        "all_four",
        "all_four_driven",
        "all_four_street",
        "ground_divs",
        "ground_omni",
        "wheels_kinect",
    ]


@pytest.mark.long
@pytest.mark.parametrize("name", ["ground_omni", "ground_divs", "all_four"])
def test_a_taught_way_is_driven_again(name: str, tmp_path: Path) -> None:
    example, store = EXAMPLES / f"{name}.yaml", tmp_path / "place.trail"

    driven(example, mode="teach", store=store)
    counters = driven(example, mode="replay", store=store)

    spoke = {key.split(".")[1] for key, n in counters.items() if key.endswith(".accepted") and n > 0}
    assert spoke >= {"floor", {"ground_omni": "omni", "ground_divs": "streams", "all_four": "laser"}[name]}


@pytest.mark.long
def test_wheels_and_landmarks_need_no_teaching() -> None:
    counters = driven(EXAMPLES / "wheels_kinect.yaml")

    assert counters["localizer.wheels.accepted"] > 100
    assert counters["localizer.kinect.accepted"] > 5


def driven(example: Path, **options: object) -> dict[str, int]:
    with Pipeline(example, overrides=SHORT, **options) as pipeline:  # type: ignore[arg-type]
        for _ in pipeline:
            pass
        result = pipeline.result
    assert result.status == "done"
    assert result.ground_truth is not None
    found = evaluate(result.trajectories["fused"], result.ground_truth, Protocol(align="none")).document()
    ate_m = next(value for key, value in found["metrics"].items() if key.startswith("ate_rmse_m"))
    assert ate_m < 0.05
    return dict(result.counters)
