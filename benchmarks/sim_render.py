"""How fast the simulator renders, in thread CPU time on one core, so that a busy machine does not blur it.

    python benchmarks/sim_render.py [--json]

The bars indoors: 5 million shaded rays and 15 million depth rays a second and core. "x real time" is of one sensor
alone on one core at its usual rate.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from time import thread_time
from typing import Any

from trailmark.geometry import Pose2, Twist2
from trailmark_sim.sensors.camera import CameraSensor
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

#: How the vehicle moves: nothing to a camera without shutter times.
_TWIST = Twist2(0.3, 0.0, 0.2)
SHADED_BAR_MRAYS, DEPTH_BAR_MRAYS = 5.0, 15.0
CASES: tuple[tuple[str, str, float, dict[str, Any], tuple[float, float, float]], ...] = (
    ("ground_course", "floor", 70.0, {}, (0.5, 0.0, 20.0)),
    ("supermarket", "omni", 15.0, {"people": 3}, (1.2, 2.0, 0.0)),
    ("supermarket", "laser", 10.0, {"people": 3}, (1.2, 2.0, 0.0)),
    ("corridor", "front", 20.0, {"people": 2}, (2.0, 0.0, 0.0)),
    ("corridor", "front", 20.0, {"people": 2, "readout_ms": 30}, (2.0, 0.0, 0.0)),
    ("corridor", "front", 20.0, {"people": 2, "exposure_ms": 4}, (2.0, 0.0, 0.0)),
    ("street", "front", 20.0, {"people": 3}, (2.0, 0.0, 0.0)),
    ("lab", "rgbd", 10.0, {"people": 1}, (0.8, 2.6, 0.0)),
    ("hallway", "rgbd", 10.0, {}, (0.5, 0.0, 0.0)),
)


def seconds(work: Callable[[], object], repeat: int) -> float:
    """Return the least thread CPU time of a call."""
    work()
    best = math.inf
    for _ in range(repeat):
        began = thread_time()
        work()
        best = min(best, thread_time() - began)
    return best


def measure(repeat: int) -> list[dict[str, Any]]:
    """Return a row for each world and sensor."""
    rows = []
    for world, name, rate_hz, extra, (x, y, heading_deg) in CASES:
        sensor = build_world(world, WorldOptions(sensors=(name,), extra=extra)).sensors[0]
        state = VehicleState(Pose2(x, y, math.radians(heading_deg)), _TWIST)
        frame_s = seconds(lambda sensor=sensor, state=state: sensor.render(1, 1.0, state), repeat)  # type: ignore[misc]
        shutter = {key: value for key, value in extra.items() if key in ("readout_ms", "exposure_ms")}
        row: dict[str, Any] = {"world": world, "sensor": name, **shutter, "frame_ms": 1e3 * frame_s}
        row["x_real_time"] = 1.0 / (rate_hz * frame_s)
        if isinstance(sensor, CameraSensor) and not shutter:
            view = sensor.view(1.0, state)
            depth_s = seconds(lambda sensor=sensor, state=state: sensor.view(1.0, state), repeat)  # type: ignore[misc]
            shade_s = seconds(view.radiance, repeat)
            row["depth_mrays"] = view.table.n_rays / depth_s / 1e6
            row["shaded_mrays"] = view.table.n_rays / (depth_s + shade_s) / 1e6
        rows.append(row)
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", action="store_true", help="print as JSON")
    parser.add_argument("--repeat", type=int, default=7, help="the best of so many")
    arguments = parser.parse_args()
    rows = measure(arguments.repeat)
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    print(f"{'world':12} {'sensor':7} {'ms/frame':>9} {'x real':>7} {'depth Mray/s':>13} {'shaded Mray/s':>14}")
    for row in rows:
        rays = f"{row['depth_mrays']:13.1f} {row['shaded_mrays']:14.1f}" if "depth_mrays" in row else ""
        shutter = "".join(f" {key} {row[key]}" for key in ("readout_ms", "exposure_ms") if key in row)
        print(f"{row['world']:12} {row['sensor']:7} {row['frame_ms']:9.2f} {row['x_real_time']:7.2f} {rays}{shutter}")
    print(f"bars indoors: {DEPTH_BAR_MRAYS:g} depth, {SHADED_BAR_MRAYS:g} shaded")


if __name__ == "__main__":
    main()
