"""Speed and exactness of the simulated ground camera, 512 x 480 at 70 Hz.

Speed: 2.6 m driven at 0.26 m/s over every floor, first over new ground (tiles are painted), then over the same ground
again (tiles are there); the bars are 4 and 15 times real time with two threads on two idle cores. Exactness: a picture
seen eight times finer is warped by the closed-form motion onto a picture taken elsewhere, without noise, light and
smear; the bars are 0.3 grey levels rms and 0.01 px.

    python benchmarks/sim_ground.py [--threads 2] [--frames 700] [--floor wood] [--json]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np

from trailmark.geometry import Pose2, Twist2
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.vehicles import VehicleState

RATE_HZ, SPEED_MPS = 70.0, 0.26
BARS = {"first pass": 4.0, "cached": 15.0}
PLAIN = Optics(vignette=0.0, read_noise=0.0, shot_noise=0.0, exposure_s=0.0, height_jitter=0.0, tilt_jitter_rad=0.0)
SMALL = GroundRig(width=160, height=120, field_m=(160 * 0.2 / 512, 120 * 0.188 / 480))


def driven(k: int) -> VehicleState:
    """Return the state at picture `k` of a gentle curve."""
    step_m = SPEED_MPS / RATE_HZ
    return VehicleState(Pose2(k * step_m, 0.02 * k * step_m, 0.1), Twist2(SPEED_MPS), travelled_m=k * step_m)


def speed(floor: str, threads: int, n_frames: int) -> list[dict[str, Any]]:
    """Return a row for the first pass and one for the second."""
    camera = GroundCameraSensor(
        "floor", GroundTexture([Zone(Floor(floor))], 1), GroundRig(), Optics(), 7, threads=threads
    )
    camera.render(0, 0.0, VehicleState(Pose2(-50.0)))  # compile
    rows = []
    for item, bar in BARS.items():
        began, cpu_began = perf_counter(), process_time()
        for k in range(n_frames):
            camera.render(k, k / RATE_HZ, driven(k))
        wall_s, cpu_s = perf_counter() - began, process_time() - cpu_began
        figures = {"wall_ms": 1e3 * wall_s / n_frames, "cpu_ms": 1e3 * cpu_s / n_frames}
        factor = n_frames / RATE_HZ / wall_s
        figures |= {"real_time": factor, "real_time_per_core": n_frames / RATE_HZ / cpu_s}
        rows.append({"floor": floor, "item": item, **figures, "bar": bar, "met": factor >= bar})
    return rows


def exactness(floor: str) -> dict[str, Any]:
    """Return the rms difference [grey levels] and the residual shift [px] of two pictures 16 mm and 1 deg apart."""
    ground = GroundTexture([Zone(Floor(floor))], 1)
    coarse = GroundCameraSensor("floor", ground, SMALL, PLAIN, 7)
    finer = replace(SMALL, width=8 * SMALL.width, height=8 * SMALL.height)
    fine = GroundCameraSensor("floor", ground, finer, replace(PLAIN, psf_px=8 * PLAIN.psf_px), 7)
    first, second = VehicleState(Pose2(5.0, 3.0, 0.7)), VehicleState(Pose2(5.0137, 2.9921, 0.72))
    seen = coarse.radiance(second)
    u, v = np.meshgrid(np.arange(SMALL.width), np.arange(SMALL.height))
    fine_coarse = np.linalg.inv(fine.ground_pixel(first)) @ coarse.ground_pixel(second)
    at = fine_coarse @ np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    x, y = ((axis / at[2]).reshape(u.shape).astype(np.float32) for axis in at[:2])
    known = (x > 2) & (x < finer.width - 3) & (y > 2) & (y < finer.height - 3)
    error = (cv2.remap(fine.radiance(first), x, y, cv2.INTER_LINEAR) - seen)[known]
    slopes = [cv2.Sobel(seen, cv2.CV_32F, *order, scale=0.125)[known] for order in ((1, 0), (0, 1))]
    shift = np.linalg.lstsq(np.stack(slopes, axis=1), error, rcond=None)[0]
    rms, residual_px = float(np.sqrt((error**2).mean())), float(np.hypot(*shift))
    return {"floor": floor, "rms_grey": rms, "residual_px": residual_px, "met": rms < 0.3 and residual_px < 0.01}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--frames", type=int, default=700)
    parser.add_argument("--floor", choices=sorted(FLOORS), action="append")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    floors = given.floor or sorted(FLOORS)
    speeds = [row for floor in floors for row in speed(floor, given.threads, given.frames)]
    exact = [exactness(floor) for floor in floors]
    if given.json:
        print(json.dumps({"threads": given.threads, "speed": speeds, "exactness": exact}, indent=1))
        return
    print(f"{'floor':<10}{'':<12}{'wall ms':>8}{'cpu ms':>8}{'x real time':>13}{'per core':>10}{'bar':>6}")
    for row in speeds:
        numbers = f"{row['wall_ms']:8.2f}{row['cpu_ms']:8.2f}{row['real_time']:13.1f}"
        numbers += f"{row['real_time_per_core']:10.1f}{row['bar']:6.0f}"
        print(f"{row['floor']:<10}{row['item']:<12}{numbers}{'' if row['met'] else '  not met'}")
    print(f"\n{'floor':<10}{'rms grey':>9}{'residual px':>13}")
    for row in exact:
        print(f"{row['floor']:<10}{row['rms_grey']:9.3f}{row['residual_px']:13.5f}{'' if row['met'] else '  not met'}")


if __name__ == "__main__":
    main()
