"""The downward camera where the light is not ours: ours beside klt, orb and phase_correlation, on the same pictures.

    python benchmarks/ground_conditions.py [--floors wood_floor ...] [--conditions nominal ...] [--methods refined ...]
                                           [--seeds 0 1 2] [--frames 160] [--label NAME] [--jobs 2] [--minutes 25]
                                           [--out FOLDER] [--json | --markdown]

Run by the interpreter of an older checkout, with `--label before`, it adds that code's rows to the same folder. Begun
again with the same `--out` it goes on where it was ended; delete the folder after a change of the code, unless
``results.py`` does. What is printed as Markdown is of all rows in the folder.

A winding drive (up to 20 px and 1.5 deg a picture, from rest) over each floor, every condition laid over the same clean
pictures. Parameters of ground_vo were chosen on `CHOSEN_ON`.

* error: mean error over pieces of 1 m, of the way that was told, in % (a picture without an answer adds no way);
* answered: share of the pictures but the first that got a motion;
* silent: share of the motions with an error of more than 5 of their own sigmas and more than 0.5 mm or 0.05 deg; over
  pieces of 1 m and of 1 s that have no gap, the share of pieces that are wrong in the same way.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ground_jobs import in_turn
from ground_scenes import PHOTOGRAPHS, data_folder, photographs

from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame, GroundPlane, Image, SensorInfo
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark.interfaces import Localizer, Session
from trailmark.testing.ground import GroundCamera
from trailmark_baselines.ground.config import KLTConfig, ORBConfig, PhaseCorrelationConfig
from trailmark_baselines.ground.klt import KLT
from trailmark_baselines.ground.orb import ORB
from trailmark_baselines.ground.phase import PhaseCorrelation
from trailmark_faults.lens import GlintsConfig, draw_glints
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO

try:
    from trailmark.arrays import Floats, Grey8, GreyF
    from trailmark.testing.ground import MirroredFloor
except ImportError:  # an older checkout, whose interpreter runs this script
    from trailmark.testing.ground import Ground as MirroredFloor

    Floats = Grey8 = GreyF = np.ndarray

#: Floors that parameters were chosen on; the others, and those that are made here, are what is reported.
CHOSEN_ON = ("wood_floor", "asphalt_cracked_1k", "tiles_1k", "wood_dark", "pavers")
#: Floors that are made: streaks like those of wood, finer and fainter ones of brushed metal, and a weave.
MADE = ("made:grain", "made:brushed", "made:weave")
REPORTED = (*(name for name in PHOTOGRAPHS if name not in CHOSEN_ON), *MADE)
METHODS = ("refined", "klt", "orb", "phase_correlation")
SIZE, SCALE_M, RATE_HZ = (512, 480), 3.9e-4, 70.0
STEP_PX = 20.0
#: What counts as silently wrong: beyond this many own sigmas, and beyond either of these.
SIGMAS, FLOOR_M, FLOOR_RAD = 5.0, 5e-4, math.radians(0.05)


@dataclass(frozen=True)
class Scene:
    """Clean pictures of a drive, and where they were taken."""

    floor: str
    pictures: Sequence[GreyF]
    poses: Sequence[Pose2]


@dataclass
class Weather:
    """What a condition may ask: the picture's number, its time, and numbers drawn at random."""

    index: int
    n_frames: int
    rng: np.random.Generator
    fixed: np.random.Generator
    pose: Pose2
    step_px: float
    memory: dict[str, Any] = field(default_factory=dict)


#: A condition changes the light that falls on the sensor, (H, W) float32; None: the picture is lost.
Condition = Callable[[GreyF, Weather], GreyF | None]


def render(floor: str, seed: int, n_frames: int, *, step_px: float = STEP_PX, turn_deg: float = 1.5,
           rest: range = range(0)) -> Scene:  # fmt: skip
    """Drive over a photograph, mirrored at its edges, with the paper's camera; stand still in `rest`."""
    ends = (rest.start, rest.stop) if rest else (10**9, 10**9)
    ground, camera = MirroredFloor(texture_of(floor), SCALE_M), GroundCamera(SIZE, (SCALE_M, SCALE_M))
    rng = np.random.default_rng([3, seed])
    pose = Pose2(*rng.uniform(0.0, 1.0, 2).tolist(), float(rng.uniform(-math.pi, math.pi)))
    poses, pictures = [], []
    for index in range(n_frames):
        stands = bool(poses) and pose == poses[-1]
        poses.append(pose)
        pictures.append(pictures[-1] if stands else camera.view(ground, pose))
        ease = max(0.0, min(1.0, index / 30, (ends[0] - index) / 10))
        ease = min(1.0, (index - ends[1]) / 30) if index >= ends[1] else ease
        turn = math.radians(turn_deg) * math.sin(2 * math.pi * index / 160)
        pose = pose @ Pose2.exp(ease * step_px * SCALE_M, 0.0, ease * turn)
    return Scene(floor, pictures, poses)


def texture_of(floor: str, side_px: int = 1024, seed: int = 0) -> Grey8:
    """Return the photograph of a floor, or one that is made, of this size and with this seed, (H, W) uint8."""
    if floor not in MADE:
        return np.asarray(cv2.imread(str(data_folder() / f"{floor}.jpg"), cv2.IMREAD_GRAYSCALE), np.uint8)
    rng = np.random.default_rng([9, MADE.index(floor), *([seed] if seed else [])])
    # lengths and widths of the streaks [px], and their standard deviations [grey levels]
    streaks = {
        "made:grain": ((40.0, 1.5, 6.0), (12.0, 3.0, 3.0), (1.0, 1.0, 1.5)),
        "made:brushed": ((150.0, 0.8, 4.0), (2.0, 2.0, 1.0)),
        "made:weave": ((12.0, 1.2, 7.0), (1.2, 12.0, 7.0)),
    }[floor]
    out = np.full((side_px, side_px), 115.0, np.float32)
    for along, across, sigma in streaks:
        noise = rng.standard_normal(out.shape, dtype=np.float32)
        noise = cv2.GaussianBlur(noise, (0, 0), sigmaX=along, sigmaY=across)
        out += sigma * noise / noise.std()
    return np.asarray(np.clip(np.rint(out), 0, 255), np.uint8)


# --- conditions --------------------------------------------------------------------------------------------------


def vignette(strength: float) -> GreyF:
    """Return the light of each pixel, less in the corners."""
    u, v = (np.linspace(-1, 1, n, dtype=np.float32) for n in SIZE)
    return np.asarray(1.0 - strength * (u[None, :] ** 2 + v[:, None] ** 2) / 2, np.float32)


def blobs(rng: np.random.Generator, share: float, radii: tuple[float, float]) -> GreyF:
    """Return soft round spots that cover a share of the picture, 0 to 1."""
    out, covered = np.zeros((SIZE[1], SIZE[0]), np.float32), 0.0
    while covered < share:
        radius = rng.uniform(*radii)
        centre = (round(rng.uniform(0, SIZE[0]) * 8), round(rng.uniform(0, SIZE[1]) * 8))
        cv2.circle(out, centre, round(radius * 8), 1.0, -1, cv2.LINE_AA, 3)
        covered = float(out.mean())
    return np.asarray(cv2.GaussianBlur(out, (0, 0), 0.7), np.float32)


def nominal(light: GreyF, at: Weather) -> GreyF:
    """Return what a good camera sees: a vignette of 12 %."""
    return light * vignette(0.12)


def low_light(light: GreyF, at: Weather) -> GreyF:
    """Return a third of the light."""
    return 0.35 * nominal(light, at)


def flicker(sigma: float) -> Condition:
    """Return light that is another in each picture, log-normal."""
    return lambda light, at: nominal(light, at) * np.float32(math.exp(sigma * at.rng.standard_normal()))


def mains(light: GreyF, at: Weather) -> GreyF:
    """Return lamps on 50 Hz mains under a rolling shutter that reads out in 10 ms."""
    row_s = at.index / RATE_HZ + np.linspace(-0.005, 0.005, SIZE[1], dtype=np.float32)[:, None]
    return nominal(light, at) * np.asarray(1.0 + 0.3 * np.sin(2 * np.pi * 100.3 * row_s), np.float32)


def shadow_edge(light: GreyF, at: Weather) -> GreyF:
    """Return half the light beyond an edge that swings through the picture."""
    turn = 0.6 + 0.3 * math.sin(at.index / 23.0)
    u, v = np.meshgrid(*(np.arange(n, dtype=np.float32) - n / 2 for n in SIZE))
    distance = math.cos(turn) * u + math.sin(turn) * v - 120.0 * math.sin(at.index / 11.0)
    return nominal(light, at) * np.asarray(0.75 - 0.25 * np.tanh(distance / 4.0), np.float32)


def marks(share: float, grey: float = 250.0, dim: float = 0.12) -> Condition:
    """Return spots that stay where they are on the lens."""

    def change(light: GreyF, at: Weather) -> GreyF:
        if "spots" not in at.memory:
            at.memory["spots"] = blobs(at.fixed, share, (2.0, 7.0))
        spots = at.memory["spots"]
        return np.asarray(light * vignette(dim) * (1 - spots) + grey * spots, np.float32)

    return change


def ring_light(light: GreyF, at: Weather) -> GreyF:
    """Return the reflections of eight lamps around the lens, each with a veil through which the ground is seen."""
    if "ring" not in at.memory:
        at.memory["ring"] = draw_glints(light.shape, GlintsConfig(), at.fixed).sum(axis=0)
    return np.asarray(nominal(light, at) + at.memory["ring"], np.float32)


def wet_patch(light: GreyF, at: Weather) -> GreyF:
    """Return a wet third of the way: 0.6 of the light, half the contrast, and glints that slide at another speed."""
    if "glints" not in at.memory:
        at.memory["glints"] = np.tile(blobs(at.fixed, 0.02, (2.0, 6.0)), (1, 2))
    across = np.arange(SIZE[0], dtype=np.float32)[None, :]
    begins, ends = (at.step_px * (at.index - at.n_frames * third // 3) for third in (1, 2))  # how far it has come in
    inside = np.clip((begins - across) / 8.0, 0.0, 1.0) - np.clip((ends - across) / 8.0, 0.0, 1.0)
    wet = light * (1 - inside) + 0.6 * (0.5 * light + 0.5 * cv2.blur(light, (61, 61))) * inside
    slid = np.roll(at.memory["glints"], round(0.4 * at.step_px * at.index), axis=1)[:, : SIZE[0]] * inside
    return np.asarray(nominal(wet * (1 - slid) + 245.0 * slid, at), np.float32)


def specks(light: GreyF, at: Weather) -> GreyF:
    """Return dust and drops on 3 % of the picture, others in each one."""
    spots = blobs(at.rng, 0.03, (1.5, 6.0))
    return nominal(np.asarray(light * (1 - spots) + 230.0 * spots, np.float32), at)


def occluders(light: GreyF, at: Weather) -> GreyF:
    """Return a picture through which things of a fifth of its width pass, each with a look and a way of its own."""
    out = light.copy()
    for n in range(2):
        span, u_from = 50, n * 260
        phase = (at.index + n * span // 2) % span / span
        u, v = round(-120 + phase * 760 - u_from % 100), round(120 + 200 * n + 40 * math.sin(6 * phase))
        cv2.rectangle(out, (u, v - 50), (u + 100, v + 50), 60.0 + 120.0 * n, -1)
        for stripe in range(0, 100, 12):
            cv2.line(out, (u + stripe, v - 50), (u + stripe, v + 50), 110.0, 2)
    return nominal(out, at)


def lost_frames(light: GreyF, at: Weather) -> GreyF | None:
    """Return nothing one time in five."""
    return None if at.index > 3 and at.rng.uniform() < 0.2 else nominal(light, at)


def blur_8(light: GreyF, at: Weather) -> GreyF:
    """Return a picture smeared over 8 px along the drive."""
    return nominal(np.asarray(cv2.blur(light, (8, 1)), np.float32), at)


def covered(light: GreyF, at: Weather) -> GreyF:
    """Return a picture that is covered, from the half on, by something with a look of its own."""
    if "cover" not in at.memory:
        noise = at.fixed.standard_normal((SIZE[1], SIZE[0])).astype(np.float32)
        noise = cv2.GaussianBlur(noise, (0, 0), 3.0)
        at.memory["cover"] = np.asarray(110.0 + 18.0 * noise / noise.std(), np.float32)
    return nominal(at.memory["cover"] if at.index >= at.n_frames // 2 else light, at)


@dataclass(frozen=True)
class Case:
    """A condition with the noise of its camera, and what is peculiar to its drive."""

    change: Condition
    noise: float = 3.0
    drive: Mapping[str, Any] = field(default_factory=dict)
    has_wheels: bool = False


CASES: Mapping[str, Case] = {
    "nominal": Case(nominal),
    "noise_12": Case(nominal, 12.0),
    "low_light": Case(low_light, 8.0),
    "flicker_5": Case(flicker(0.05)),
    "flicker_15": Case(flicker(0.15)),
    "mains": Case(mains),
    "shadow_edge": Case(shadow_edge),
    "marks_1": Case(marks(0.01)),
    "marks_5": Case(marks(0.05)),
    "marks_5_dark": Case(marks(0.05, 25.0)),
    "marks_5_vignette_40": Case(marks(0.05, dim=0.4)),
    "ring_light": Case(ring_light),
    "wet_patch": Case(wet_patch),
    "specks": Case(specks),
    "occluders": Case(occluders),
    "lost_frames": Case(lost_frames),
    "blur_8": Case(blur_8),
    "fast": Case(nominal, drive={"step_px": 73.0, "turn_deg": 0.5}),
    "rest": Case(nominal, drive={"rest": range(60, 760)}),
    "covered": Case(covered, has_wheels=True),
}


def seen(scene: Scene, case: Case, seed: int) -> Iterator[tuple[int, Frame, Twist2]]:
    """Yield the pictures of a drive under a condition, with their numbers and what wheels would say."""
    n, step_px = len(scene.pictures), case.drive.get("step_px", STEP_PX)
    rng, fixed, memory = np.random.default_rng([4, seed]), np.random.default_rng([5, seed]), {}
    for index, light in enumerate(scene.pictures):
        at = Weather(index, n, rng, fixed, scene.poses[index], step_px, memory)
        changed = case.change(light, at)
        if changed is None:
            continue
        noisy = changed + np.float32(case.noise) * rng.standard_normal(changed.shape, dtype=np.float32)
        pixels = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        step = scene.poses[max(0, index - 1)].between(scene.poses[index])
        yield index, Frame("floor", index / RATE_HZ, Image(pixels)), Twist2(*(RATE_HZ * part for part in step.log()))


# --- what the methods say ----------------------------------------------------------------------------------------


def sensor() -> SensorInfo:
    """Return the camera: scale known, light not."""
    return SensorInfo("floor", "image", SIZE, RATE_HZ, Pose3(yaw=-math.pi), GroundPlane((SCALE_M, SCALE_M)))


def make(method: str) -> Localizer:
    """Return a localizer with its defaults, started."""
    camera = {"camera": "floor"}
    made: dict[str, Callable[[], Localizer]] = {
        "klt": lambda: KLT(KLTConfig.model_validate(camera)),
        "orb": lambda: ORB(ORBConfig.model_validate(camera)),
        "phase_correlation": lambda: PhaseCorrelation(PhaseCorrelationConfig.model_validate(camera)),
        "refined": lambda: GroundVO(GroundVOConfig.model_validate(camera)),
    }
    localizer = made[method]()
    localizer.start(Session(name=method, sensors={"floor": sensor()}))
    return localizer


@dataclass
class Told:
    """What a method said on a drive."""

    motions: list[tuple[int, int, Motion]] = field(default_factory=list)
    lost: list[tuple[int, str]] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)
    asked: list[int] = field(default_factory=list)


def follow(scene: Scene, case: Case, methods: Sequence[str], seed: int) -> dict[str, Told]:
    """Give every picture to every method."""
    localizers, told = {method: make(method) for method in methods}, {method: Told() for method in methods}
    for index, frame, twist in seen(scene, case, seed):
        belief = Belief(frame.stamp_s, twist=twist, motion_age_s=0.0) if case.has_wheels else Belief(frame.stamp_s)
        for method, localizer in localizers.items():
            began = time.thread_time()
            said = localizer.observe(frame, belief)
            told[method].times_ms.append(1e3 * (time.thread_time() - began))
            told[method].asked.append(index)
            for estimate in said:
                if isinstance(estimate, Motion):
                    since = round(estimate.since_s * RATE_HZ)
                    told[method].motions.append((since, index, estimate))
                elif isinstance(estimate, Lost):
                    told[method].lost.append((index, estimate.reason))
    return told


def is_silently_wrong(error: Floats, covariance: Floats) -> bool:
    """Return whether an error (x, y, theta) is beyond what was claimed, and beyond what nobody minds."""
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shift, turn = math.hypot(error[0], error[1]), abs(float(error[2]))
    too_far = shift > FLOOR_M and shift > SIGMAS * math.hypot(sigmas[0], sigmas[1])
    return bool(too_far or (turn > FLOOR_RAD and turn > SIGMAS * sigmas[2]))


def judged(scene: Scene, told: Told) -> dict[str, float]:
    """Return error, answered and silent of a drive."""
    n, truth = len(scene.poses), scene.poses
    pose, poses = Pose2(), [Pose2()] * n
    by_end = {end: (start, motion) for start, end, motion in told.motions}
    covariances = {end: np.asarray(np.linalg.pinv(m.information), np.float64) for _, end, m in told.motions}
    for index in range(1, n):
        if index in by_end:
            pose = pose @ by_end[index][1].pose_since_now
        poses[index] = pose
    way = np.concatenate([[0.0], np.cumsum([a.distance_to(b) for a, b in pairwise(truth)])])
    errors = []
    asked = np.array(told.asked)
    for first in told.asked[::4]:  # places of pictures that were lost are not asked for
        ends = asked[way[asked] >= way[first] + 1.0]
        if not len(ends):
            break
        last = int(ends[0])
        wrong = truth[first].between(truth[last]).between(poses[first].between(poses[last]))
        errors.append((100.0 * math.hypot(wrong.x, wrong.y), math.degrees(abs(wrong.theta))))
    single = [
        is_silently_wrong(truth[start].between(truth[end]).between(m.pose_since_now).array(), covariances[end])
        for start, end, m in told.motions
    ]
    chained = [_is_chain_wrong(truth, by_end, covariances, first, way) for first in range(0, n, 3)]
    chains = [wrong for wrong in chained if wrong is not None]
    return {
        "error": float(np.mean([e[0] for e in errors])) if errors else math.nan,
        "n_pieces": len(errors),
        "error_deg": float(np.mean([e[1] for e in errors])) if errors else math.nan,
        "answered": 100.0 * len(told.motions) / max(1, len(told.asked) - 1),
        "silent": 100.0 * float(np.mean(single)) if single else 0.0,
        "chains": 100.0 * float(np.mean(chains)) if chains else 0.0,
        "n_motions": len(single),
        "n_silent": int(np.sum(single)),
        "n_chains": len(chains),
        "n_chains_wrong": int(np.sum(chains)),
        "ms": float(np.median(told.times_ms)),
    }


def _is_chain_wrong(truth: Sequence[Pose2], by_end: Mapping[int, tuple[int, Motion]],
                    covariances: Mapping[int, Floats], first: int, way: Floats) -> bool | None:  # fmt: skip
    """Return whether motions chained from a picture on are wrong after 1 m or after 1 s; None where a gap is."""
    ends = {start: end for end, (start, _) in by_end.items()}
    at, pose, covariance, verdicts = first, Pose2(), np.zeros((3, 3)), []
    marks_at = [min(int(np.searchsorted(way, way[first] + 1.0)), first + 10**6), first + round(RATE_HZ)]
    while at in ends and len(verdicts) < 2:
        end = ends[at]
        step = by_end[end][1].pose_since_now
        carried, far = np.eye(3), Pose2(0.0, 0.0, pose.theta) @ step
        carried[:2, 2] = -far.y, far.x
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(pose.theta), -math.sin(pose.theta)], [math.sin(pose.theta), math.cos(pose.theta)]]
        covariance = carried @ covariance @ carried.T + turn @ covariances[end] @ turn.T
        pose = pose @ step
        for mark in [mark for mark in marks_at if at < mark <= end]:
            wrong = truth[first].between(truth[end]).between(pose).array()
            verdicts.append(is_silently_wrong(wrong, covariance))
            marks_at.remove(mark)
        at = end
    return any(verdicts) if verdicts else None


def measured(floor: str, seed: int, n_frames: int, wanted: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Any]]:
    """Yield a row for every condition and method on one floor; `wanted` has the methods of each condition."""
    scenes: dict[str, Scene] = {}
    for condition, methods in wanted.items():
        case = CASES[condition]
        key = repr(sorted(case.drive.items()))
        if key not in scenes:
            scenes.clear()  # a scene is 160 MB
            scenes[key] = render(floor, seed, n_frames + len(case.drive.get("rest", ())), **case.drive)
        for method, told in follow(scenes[key], case, methods, seed).items():
            row = {"floor": floor, "condition": condition, "seed": seed, "method": method, "frames": n_frames}
            if condition == "rest":
                row |= {"rest_mm": _drift_mm(told, case.drive["rest"])}
            reasons = sorted({reason.split(":")[0] for _, reason in told.lost})
            row |= judged(scenes[key], told) | {"reasons": reasons}
            if condition == "covered":
                first = next((i for i, _ in told.lost if i >= n_frames // 2), None)
                late = [end for _, end, _ in told.motions if end >= n_frames // 2]
                row |= {"lost_after_s": math.nan if first is None else (first - n_frames // 2) / RATE_HZ,
                        "told_when_covered": len(late)}  # fmt: skip
            yield row


def _drift_mm(told: Told, rest: range) -> float:
    """Return how far a method says that the robot has moved while it stood still."""
    pose = Pose2()
    for start, end, motion in told.motions:
        if start >= rest.start + 1 and end <= rest.stop:
            pose = pose @ motion.pose_since_now
    return 1e3 * math.hypot(pose.x, pose.y)


def _line(row: Mapping[str, Any]) -> str:
    figures = (f"{row['error']:8.3f} % {row['error_deg']:7.3f} deg {row['answered']:6.1f} % answered"
               f" {row['silent']:6.2f} % silent {row['chains']:6.2f} % chains {row['ms']:6.2f} ms")  # fmt: skip
    return f"{row['floor']:22}{row['condition']:20}{row['method']:18}{figures}  {'; '.join(row['reasons'])[:60]}"


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table for floors not chosen on, for made ones, and for those chosen on."""
    lines: list[str] = []
    for is_in in (
        lambda floor: floor not in (*CHOSEN_ON, *MADE),
        lambda floor: floor in MADE,
        lambda floor: floor in CHOSEN_ON,
    ):
        of = [row for row in rows if is_in(row["floor"])]
        if of:
            lines += [", ".join(sorted({row["floor"] for row in of})), "", *_table(of), ""]
    return "\n".join(lines)


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    methods = sorted({row["method"] for row in rows}, key=lambda name: (name != "refined", name))
    lines = ["| condition | n | " + " | ".join(methods) + " | bar |", "|---" * (len(methods) + 3) + "|"]
    for condition in CASES:
        of = {name: [r for r in rows if r["condition"] == condition and r["method"] == name] for name in methods}
        if of[methods[0]]:
            n = f"{len(of[methods[0]])}, {sum(row['n_pieces'] for row in of[methods[0]])}"
            cells = [_cell(of[name]) for name in methods]
            lines.append(f"| {condition} | {n} | " + " | ".join(cells) + f" | {_verdict(condition, of)} |")
    return lines


def _figures(rows: Sequence[Mapping[str, Any]]) -> tuple[float, float, float, float, float]:
    """Return median and worst error, answered, silent motions and silent pieces [%]."""
    errors = [row["error"] for row in rows if not math.isnan(row["error"])] or [math.nan]
    motions, chains = sum(row["n_motions"] for row in rows), sum(row["n_chains"] for row in rows)
    silent = 100.0 * sum(row["n_silent"] for row in rows) / max(1, motions)
    wrong = 100.0 * sum(row["n_chains_wrong"] for row in rows) / max(1, chains)
    return float(np.median(errors)), max(errors), float(np.mean([row["answered"] for row in rows])), silent, wrong


def _cell(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return "not run"
    error, worst, answered, silent, wrong = _figures(rows)
    return f"{error:.3f} / {worst:.3f}; {answered:.1f}; {silent:.2f} / {wrong:.2f}"


def _verdict(condition: str, of: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return which bars the first method misses."""
    first, *others = of
    if condition == "covered":
        late = [row for row in of[first] if not row["lost_after_s"] <= 0.2 or row["told_when_covered"]]
        return f"`Lost` within 0.2 s and nothing told: {len(of[first]) - len(late)} of {len(of[first])}"
    error, _, answered, silent, wrong = _figures(of[first])
    best = min((_figures(of[name])[0] for name in others if of[name] and "before" not in name), default=0.0)
    missed = ["error"] * (error > max(best, 0.1)) + ["answered"] * (answered < 95.0)
    missed += ["silent"] * (silent > 0.1) + ["silent pieces"] * (wrong > 0.1)
    said = ", ".join(missed) or "met"
    if condition == "rest":
        said += f"; drift at most {max(row['rest_mm'] for row in of[first]):.3f} mm in 10 s"
    return said


@dataclass
class Rows:
    """The rows so far, kept in a folder where there is one.

    Attributes
    ----------
    folder : Path or None
        Of ground_conditions.jsonl.
    """

    folder: Path | None
    by_key: dict[tuple[Any, ...], dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._file.touch()
            for line in self._file.read_text(encoding="utf-8").splitlines():
                self._take(json.loads(line))

    @property
    def _file(self) -> Path:
        assert self.folder is not None
        return self.folder / "ground_conditions.jsonl"

    def _take(self, row: dict[str, Any]) -> None:
        self.by_key[tuple(row[name] for name in ("floor", "condition", "seed", "method", "frames"))] = row

    def add(self, row: dict[str, Any]) -> None:
        """Keep a row."""
        self._take(row)
        if self.folder is not None:
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")


def _named(method: str, label: str) -> str:
    return f"{method} {label}".strip()


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--floors", nargs="+", default=list(REPORTED))
    parser.add_argument("--conditions", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--frames", type=int, default=160)
    parser.add_argument("--label", default="", help="added to the methods' names: which code this is")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once, a floor and seed each")
    parser.add_argument("--minutes", type=float, default=math.inf, help="end after so long")
    parser.add_argument("--out", type=Path, help="folder of ground_conditions.jsonl; goes on where it ended")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    parser.add_argument("--markdown", action="store_true", help="the tables of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows, until_s = Rows(options.out), time.monotonic() + 60.0 * options.minutes
    floors = [floor for floor in options.floors if floor in (*photographs(), *MADE)]
    jobs = []
    for seed, floor in product(options.seeds, floors):  # all floors once, then again
        missing = {
            condition: [
                method
                for method in options.methods
                if (floor, condition, seed, _named(method, options.label), options.frames) not in rows.by_key
            ]
            for condition in options.conditions
        }
        if wanted := {condition: methods for condition, methods in missing.items() if methods}:
            jobs.append((floor, seed, options.frames, wanted))
    for row in in_turn(measured, jobs, options.jobs):
        row["method"] = _named(row["method"], options.label)
        rows.add(row)
        if not (options.json or options.markdown):
            print(_line(row), flush=True)
        if time.monotonic() > until_s:
            break
    if options.json:
        print(json.dumps(list(rows.by_key.values()), indent=2))
    if options.markdown:
        print(markdown(list(rows.by_key.values())))


if __name__ == "__main__":
    main()
