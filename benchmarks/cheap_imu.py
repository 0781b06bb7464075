"""What a cheap gyro is worth beside wheels: heading after 60 s, with its bias estimated, at its word, or without it.

Five drives of a simulated robot, three seeds each. Wheels at 25 Hz: random walks as `odometry` states them by default,
a track that is off by 3 % (one standard deviation), nothing at rest: encoders that do not turn count nothing. A gyro at
50 Hz, stated as `imu` does by default: white noise of 0.05 deg per root second, a bias of 0.5 deg/s (one standard
deviation) that wanders by 0.01 deg/s per root second. No fixes: only what wheels and gyro say of each other.

    python benchmarks/cheap_imu.py [--drives slalom] [--seeds 3] [--rest-deg 0.05] [--markdown]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session

DT_S, DURATION_S = 0.02, 60.0
TRACK, BIAS, WALK, WHITE = 0.03, math.radians(0.5), math.radians(0.01), math.radians(0.05)
GYRO = information_from_sigmas(math.inf, math.inf, math.radians(0.2) * math.sqrt(DT_S))
BIASED: dict[str, Any] = {"sources": {"gyro": {"errors": "gyro_bias"}}}
#: Name, whether the gyro is told, and the config.
VARIANTS: dict[str, tuple[bool, dict[str, Any]]] = {
    "wheels alone": (False, {}),
    "gyro at its word": (True, {}),
    "bias as before": (True, BIASED | {"standstill": "off", "gyro_bias_walk_deg_per_s": 1.0 / math.sqrt(600.0)}),
    "bias, no standstill": (True, BIASED | {"standstill": "off"}),
    "bias and standstill": (True, BIASED | {"standstill": "use"}),
}


def main() -> None:
    """Print a table: root mean square of the heading's error over the seeds [deg], NEES of all headings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", nargs="+", default=list(DRIVES), choices=list(DRIVES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--rest-deg", type=float, default=0.05, help="what wheels allow for at rest [deg per root s]")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    bar, end = ("| ", " |") if arguments.markdown else ("", "")
    print(bar + " | ".join(["drive", *VARIANTS]) + end)
    if bar:
        print("|---" * (1 + len(VARIANTS)) + "|")
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in VARIANTS}
    for drive in arguments.drives:
        cells = [drive]
        for name, (has_gyro, keys) in VARIANTS.items():
            errors = [
                heading_error(drive, (seed, arguments.rest_deg), has_gyro, keys) for seed in range(arguments.seeds)
            ]
            found[name] += errors
            cells.append(f"{_rms(errors):.2f}")
        print(bar + " | ".join(cells) + end, flush=True)
    print(bar + " | ".join(["all", *(f"{_rms(errors):.2f}" for errors in found.values())]) + end)
    print(
        bar + " | ".join(["NEES", *(f"{np.mean([nees for _, nees in errors]):.2f}" for errors in found.values())]) + end
    )


def heading_error(drive: str, of: tuple[int, float], has_gyro: bool, keys: dict[str, Any]) -> tuple[float, float]:
    """Return how far the heading is off at the end [deg], and its NEES; `of` is seed and `--rest-deg`."""
    kalman = Kalman(KalmanConfig.model_validate(keys))
    kalman.start(Session("estimator", start_pose=Pose2()))
    for source, motion in motions(drive, np.random.default_rng(of[0]), of[1]):
        if source == "wheels" or has_gyro:
            kalman.apply(source, motion)
    belief = kalman.belief()
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    speeds = DRIVES[drive]
    error = wrap_angle(belief.pose_map_base.theta - float(speeds[:, 1].sum()) * DT_S)
    return math.degrees(error), error**2 / float(belief.covariance[2, 2])


def motions(drive: str, rng: np.random.Generator, rest_deg: float) -> Iterator[tuple[str, Motion]]:
    """Yield what wheels and gyro say, in order."""
    speeds = DRIVES[drive]
    track, bias = 1.0 + rng.normal(0.0, TRACK), rng.normal(0.0, BIAS)
    for k, rate_radps in enumerate(speeds[:, 1].tolist()):
        stamp_s = k * DT_S
        bias += rng.normal(0.0, WALK * math.sqrt(DT_S))
        turn = (rate_radps + bias) * DT_S + rng.normal(0.0, WHITE * math.sqrt(DT_S))
        yield "gyro", Motion(stamp_s, stamp_s + DT_S, Pose2(0.0, 0.0, turn), GYRO)
        if k % 2:
            way, turned = speeds[k - 1 : k + 1].sum(axis=0).tolist()
            yield "wheels", _wheels(stamp_s - DT_S, way * DT_S, turned * track * DT_S, rng, rest_deg)


def _wheels(since_s: float, way_m: float, turn_rad: float, rng: np.random.Generator, rest_deg: float) -> Motion:
    way_root, turn_root, time_root = math.sqrt(abs(way_m)), math.sqrt(abs(turn_rad)), math.sqrt(2.0 * DT_S)
    slip = 0.02 * way_root, 0.01 * way_root, math.hypot(math.radians(1.0) * way_root, math.radians(2.0) * turn_root)
    rest = 0.001 * time_root, 0.001 * time_root, math.radians(rest_deg) * time_root
    sigmas = np.hypot(slip, rest).tolist()
    noise = rng.normal(0.0, 1.0, 3) * slip
    pose = Pose2.exp(way_m + noise[0], noise[1], turn_rad + noise[2])
    return Motion(since_s, since_s + 2.0 * DT_S, pose, information_from_sigmas(*sigmas))


def _drive(*pieces: tuple[float, float, float]) -> Floats:
    """Return speed and yaw rate at every step, repeated over the drive, of (seconds, m/s, deg/s)."""
    once = np.concatenate([np.tile([v, math.radians(w)], (round(s / DT_S), 1)) for s, v, w in pieces])
    n = round(DURATION_S / DT_S)
    return np.tile(once, (n // len(once) + 1, 1))[:n]


def _rms(errors: list[tuple[float, float]]) -> float:
    return math.sqrt(float(np.mean([error**2 for error, _ in errors])))


DRIVES = {
    "stands first": _drive((5.0, 0.0, 0.0), (30.0, 0.5, 10.0), (25.0, 0.5, -20.0)),
    "stop and go": _drive((3.0, 0.0, 0.0), (9.0, 0.6, 15.0)),
    "turns on the spot": _drive((3.0, 0.0, 0.0), (6.0, 0.0, 60.0), (6.0, 0.4, 0.0)),
    "slalom": _drive((2.0, 0.0, 0.0), (6.0, 0.5, 30.0), (6.0, 0.5, -30.0), (1.0, 0.5, 0.0)),
    "never stands": _drive((10.0, 0.5, 20.0), (10.0, 0.5, 5.0)),
}


if __name__ == "__main__":
    main()
