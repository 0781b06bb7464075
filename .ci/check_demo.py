"""The figures of the demo, held to what its pictures promise."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

FOLDER = Path("runs/demo/replay")


def main() -> None:
    """Leave with exit code 1 and a line for every figure that is wrong."""
    metrics = json.loads((FOLDER / "metrics.json").read_text(encoding="utf-8"))
    run = json.loads((FOLDER / "run.json").read_text(encoding="utf-8"))
    truth = metrics["trajectories"]["groundtruth"]["metrics"]
    lateral = {name.partition("[")[0]: value for name, value in truth.items() if name.startswith("lateral_")}
    verdicts = {name: source["nees"]["verdict"] for name, source in metrics["sources"].items() if source["nees"]}
    errors_m = {name: rmse_m(metrics, name) for name in ("fused", "floor", "wheels")}
    checks = {
        "the replay reaches its end": run["status"] == "done" and "end of the path" in run["reason"],
        "no gate is touched": run["counters"].get("source.robot.collisions") == 0,
        "the robot stays within 4.4 mm of the path on average": lateral["lateral_mean_m"] <= 0.0044,
        "and within 20.3 mm always": lateral["lateral_max_m"] <= 0.0203,
        "though the camera fails, it knows where it is to 5 mm rms": errors_m["fused"] <= 0.005,
        "better than camera and wheels alone": errors_m["fused"] < min(errors_m["floor"], errors_m["wheels"]),
        "no localizer is called too certain, for none is": len(verdicts) >= 3
        and "overconfident" not in verdicts.values(),
        "a newcomer does not wait for more than 2000 frames": run["counters"]["frames"] <= 2000,
        "the report is there": (FOLDER / "report.html").stat().st_size > 50_000,
    }
    for name, is_met in checks.items():
        print(f"{'ok  ' if is_met else 'FAIL'} {name}")
    print({name: round(value, 5) for name, value in lateral.items()})
    sys.exit(0 if all(checks.values()) else 1)


def rmse_m(metrics: dict[str, Any], name: str) -> float:
    """Return the root mean square position error of a trajectory [m]."""
    found = metrics["trajectories"][name]["metrics"]
    return next(value for key, value in found.items() if key.startswith("ate_rmse_m"))


if __name__ == "__main__":
    main()
