"""Known landmarks on recordings: bearings of infrared beacons, range and bearing of barcodes, ranges of radios.

Three sets, none of them ours (``TRAILMARK_DATA``), default config throughout but for what is said:

- ``bearing``: Roh 2010, four beacons, nine places with 200 sets of bearings each, nothing believed before; beside
  `trailmark_omni_surf.locate` with its defaults on the same numbers. Every place is a sample.
- ``mrclam``: five robots of UTIAS MRCLAM data set 6, wheels and landmarks fused by ``kalman``; beside ``range_bearing``
  of ``examples/third_party_plugin``, whose noise was set by hand for this set.
- ``plaza``: two drives of 1.9 and 1.4 km among four radios (Djugash, Hamner & Roth 2009), ranges fused with odometry.
  The ranges are 7 % too long by calibration, which the config says.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/landmarks.py [bearing mrclam plaza] [--robots 1 2] [--markdown]
"""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mrclam
import numpy as np
from scipy.io import loadmat

import trailmark
from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix
from trailmark.frames import Arrays, Frame, Record, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.plugins import load_plugins

EXAMPLE = Path(__file__).parents[1] / "examples" / "third_party_plugin" / "src"
BEACONS = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]])
ODOMETRY = {
    "plugin": "odometry",
    "distance_sigma": 0.05,
    "lateral_sigma": 0.02,
    "turning_sigma_deg": 10.0,
    "rest_sigma": 0.012,
    "rest_sigma_deg": 2.5,
    "slip_sigma": 0.0,
    "lag_s": 0.0,  # the page's figures are without; rest_sigma holds it
}
RANGE_SCALE = 1.0 / 1.07
SILENT_SIGMAS, SILENT_M, SILENT_RAD = 5.0, 0.02, math.radians(1.0)


@dataclass(frozen=True, slots=True)
class Row:
    """One drive or place: position error, share answered, NEES per degree of freedom, share silently wrong."""

    set: str
    what: str
    method: str
    n: int
    answered: float
    rms_m: float
    median_m: float
    max_m: float
    nees: float
    silent: float


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", default=[])
    parser.add_argument("--robots", type=int, nargs="+", default=(1, 2, 3, 4, 5))
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not (data / "omni" / "bearing").is_dir():
        sys.exit(f"no recordings at {data}; set TRAILMARK_DATA to their folder")
    chosen = arguments.sets or ["bearing", "mrclam", "plaza"]
    mark = "|" if arguments.markdown else ""
    print(mark + f"{mark} ".join(Row.__dataclass_fields__) + mark)
    if mark:
        print("|" + "---|" * len(Row.__dataclass_fields__))
    for row in _rows(chosen, data, arguments.robots):
        print(mark + f"{mark} ".join(_cell(getattr(row, name)) for name in Row.__dataclass_fields__) + mark, flush=True)


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _rows(sets: list[str], data: Path, robots: list[int]) -> Iterator[Row]:
    if "bearing" in sets:
        yield from bearing_rows(data / "omni" / "bearing")
    for robot in robots if "mrclam" in sets else ():
        yield from mrclam_rows(data / "fusion" / "mrclam_D6", robot)
    for number in (1, 2) if "plaza" in sets else ():
        yield plaza_row(data / "uwb", number)


def bearing_rows(folder: Path) -> Iterator[Row]:
    """Yield two rows a place: ours, and that of `locate`."""
    from trailmark_omni_surf import locate

    for path in sorted(folder.glob("(X*.csv")):
        x, y = (float(number) for number in re.findall(r"[XY](\d+\.\d+)", path.name))
        truth = np.array([x, y, math.pi / 2.0])
        sets = np.radians(np.loadtxt(path, delimiter=","))
        localizer = _started(trailmark.create("localizer", "known_landmarks", sightings="beacons"))
        fixes = [_answer(localizer, index, bearings) for index, bearings in enumerate(sets)]
        told = [(fix.pose_map_base, fix.information) for fix in fixes if fix is not None]
        yield _static_row(path.stem, "known_landmarks", told, len(sets), truth)
        found = [locate(BEACONS, bearings) for bearings in sets]
        told = [(fix.pose_map_base, fix.information) for fix in found if fix is not None]
        yield _static_row(path.stem, "locate", told, len(sets), truth)


def _started(localizer: Localizer) -> Localizer:
    calibration = Arrays({"ids": np.arange(1, 5), "positions_map": BEACONS})
    localizer.start(Session(sensors={"beacons": SensorInfo("beacons", "bearing", calibration=calibration)}))
    return localizer


def _answer(localizer: Localizer, index: int, bearings: Floats) -> Fix | None:
    record = Record({"ids": np.arange(1, 5), "bearings_rad": bearings})
    (estimate,) = localizer.observe(Frame("beacons", float(index), record), Belief(float(index)))
    return estimate if isinstance(estimate, Fix) else None


def _static_row(what: str, method: str, told: list[tuple[Pose2, Floats]], n: int, truth: Floats) -> Row:
    errors = np.array([pose.array() - truth for pose, _ in told]).reshape(-1, 3)
    errors[:, 2] = np.arctan2(np.sin(errors[:, 2]), np.cos(errors[:, 2]))
    information = np.array([matrix for _, matrix in told])
    nees = np.einsum("ni,nij,nj->n", errors, information, errors)
    away = np.hypot(errors[:, 0], errors[:, 1])
    silent = _is_silent(errors, information)
    return Row(
        "bearing", what, method, n, len(told) / n, math.sqrt(float((away**2).mean())), float(np.median(away)),
        float(away.max()), float(nees.mean() / 3.0), float(silent.mean()),
    )  # fmt: skip


def _is_silent(errors: Floats, information: Floats) -> Floats:
    """Return which answers are off by more than 5 of their own sigmas, and by more than 20 mm or 1 deg."""
    sigmas = np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))
    off = np.abs(errors) > np.maximum(SILENT_SIGMAS * sigmas, [SILENT_M, SILENT_M, SILENT_RAD])
    return np.asarray(off.any(axis=1), dtype=np.float64)


def mrclam_rows(folder: Path, robot: int) -> Iterator[Row]:
    """Yield two rows: ours, and that of the example's localizer."""
    ours = mrclam.barcodes(folder, robot)
    example = {"plugin": "mrclam_landmarks", "path": str(folder / f"Robot{robot}_Measurement.dat")}
    for method, sightings in (("known_landmarks", ours), ("range_bearing", example)):
        config = {
            "sources": {"wheels": mrclam.wheels(folder, robot), "landmarks": sightings},
            "localizers": {"wheels": ODOMETRY, "landmarks": {"plugin": method}},
            "estimator": {"plugin": "kalman"},
            "start": mrclam.start(folder, robot),
        }
        yield _run_row("mrclam", f"robot {robot}", method, config)


def plaza_row(folder: Path, number: int) -> Row:
    """Return the row of one drive."""
    tables = loadmat(folder / f"Plaza{number}_.mat")
    truth = tables["GT"].copy()
    truth[:, 3] += math.pi if number == 2 else 0.0  # its heading points backwards
    with tempfile.TemporaryDirectory() as scratch:
        files = Path(scratch)
        np.savetxt(files / "truth.txt", truth)
        np.savetxt(files / "odometry.txt", _driven(tables["DR"]))
        np.savetxt(files / "ranges.txt", tables["TD"][np.argsort(tables["TD"][:, 0], kind="stable")])
        np.savetxt(files / "landmarks.txt", tables["TL"])
        config = {
            "sources": {
                "wheels": {
                    "plugin": "csv_odometry",
                    "path": str(files / "odometry.txt"),
                    "header": ["t", "x", "y", "theta"],
                    "poses": str(files / "truth.txt"),
                    "poses_header": ["t", "x", "y", "theta"],
                },
                "radios": {
                    "plugin": "csv_records",
                    "path": str(files / "ranges.txt"),
                    "header": ["t", "_", "id", "range"],
                    "metres_per_unit": RANGE_SCALE,
                    "landmarks": str(files / "landmarks.txt"),
                    "landmarks_header": ["id", "x", "y"],
                },
            },
            "localizers": {"wheels": {"plugin": "odometry"}, "radios": {"plugin": "known_landmarks"}},
            "estimator": {"plugin": "kalman"},
            "start": [float(truth[0, 1]), float(truth[0, 2]), math.degrees(truth[0, 3])],
        }
        return _run_row("plaza", f"Plaza{number}", "known_landmarks", config)


def _driven(steps: Floats) -> Floats:
    """Return stamps and poses (N, 4) from stamps, ways and turns (N, 3)."""
    pose, rows = Pose2(), []
    for stamp_s, way_m, turn_rad in steps:
        pose = pose @ Pose2.exp(way_m, 0.0, turn_rad)
        rows.append((stamp_s, pose.x, pose.y, pose.theta))
    return np.array(rows)


def _run_row(set_name: str, what: str, method: str, config: dict[str, Any]) -> Row:
    """Run a config and judge its belief against the truth, without alignment."""
    sys.path.insert(0, str(EXAMPLE))
    plugins = load_plugins(files=[EXAMPLE / "trailmark_mrclam" / "plugin.py"])
    believed, covariances, n_seen, n_answered = [], [], 0, 0
    with trailmark.Pipeline(config, plugins=plugins) as pipeline:
        for step in pipeline:
            for record in step.estimates:
                if record.source != "wheels":
                    n_seen += 1
                    n_answered += isinstance(record.estimate, Fix)
            belief = step.belief
            if belief.pose_map_base is not None and belief.covariance is not None:
                believed.append((belief.stamp_s, *belief.pose_map_base.array()))
                covariances.append(belief.covariance)
        truth = pipeline.result.ground_truth
    assert truth is not None
    rows = np.array(believed)
    is_last = np.append(np.diff(rows[:, 0]) > 0.0, True)  # of several frames of one instant
    is_known = is_last & (rows[:, 0] >= truth.stamps_s[0]) & (rows[:, 0] <= truth.stamps_s[-1])
    true = truth.at(rows[is_known, 0])
    errors = rows[is_known, 1:] - np.column_stack([true.positions, true.headings])
    errors[:, 2] = np.arctan2(np.sin(errors[:, 2]), np.cos(errors[:, 2]))
    information = np.linalg.inv(np.array(covariances)[is_known])
    away = np.hypot(errors[:, 0], errors[:, 1])
    nees = np.einsum("ni,nij,nj->n", errors, information, errors)
    silent = float(_is_silent(errors, information).mean())
    return Row(
        set_name, what, method, len(away), n_answered / n_seen, math.sqrt(float((away**2).mean())),
        float(np.median(away)), float(away.max()), float(nees.mean() / 3.0), silent,
    )  # fmt: skip


if __name__ == "__main__":
    main()
