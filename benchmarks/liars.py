"""Localizers that lie: how far the Kalman estimator follows them, beside an oracle that never hears them.

A drive on a winding way with noise as it is stated; one localizer (or two) lies from 8 s to 20 s of 25 s. For each lie,
mix and speed the worst over the seeds of: rms of the belief from the beginning of the lie over that of the oracle
(floor 5 mm), the 95th percentile of error / sigma of the position, when the liar was named in the health, and which
honest localizer was. Where nothing can decide who lies (two motions, or one motion and fixes of one sensor) only
error / sigma counts.

    python benchmarks/liars.py [--seeds 5] [--lies freeze scale ...] [--mixes all ...] [--markdown | --json]
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from multiprocessing import Pool

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Estimate, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

DT_S, N = 0.05, 500
LIE = (8.0, 20.0)
SPEEDS_MPS = (0.1, 0.5, 2.0)
MIXES = {"all": ("wheels", "camera", "laser"), "motions": ("wheels", "camera"), "camera+fixes": ("camera", "laser")}
SIGMAS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4), "laser": (0.02, 0.02, 0.01)}
FIX_EVERY = 5
TRACK_M = 0.4
FLOOR_M = 0.005
NAMED_WITHIN_S = 2.0
HEAD = (
    "| lie | mix | m/s | rms / oracle [mm] | ratio | error/sigma, p95 | named after | honest named | |\n"
    "|---|---|---|---|---|---|---|---|---|\n"
)


@dataclass(frozen=True)
class Lie:
    """Who lies, and where that can be found out."""

    liars: tuple[str, ...]
    decidable: tuple[str, ...]
    what: str
    is_harmless: bool = False
    """Whether the liar need not be named: it is enough that the belief is not worse."""


LIES = {
    "freeze": Lie(("camera",), ("all", "camera+fixes"), "the camera says 0 m, sure"),
    "stuck encoder": Lie(("wheels",), ("all",), "the wheels say 0 m"),
    "scale 1.3": Lie(("camera",), ("all", "camera+fixes"), "the camera says 1.3 x the way"),
    "slip": Lie(("wheels",), ("all",), "one wheel turns half as fast again"),
    "gyro bias": Lie(("camera",), ("all", "camera+fixes"), "the camera turns by 5 deg/s more"),
    "jump": Lie(("camera",), ("all", "camera+fixes"), "the camera says 1 m to the side once a second"),
    "replay": Lie(("camera",), ("all", "camera+fixes"), "the camera says what it said 6 s ago", is_harmless=True),
    "motion x 1e12": Lie(("camera",), ("all", "motions", "camera+fixes"), "the camera says 1e12 x the way"),
    "motion sure x 1e4": Lie(("camera",), ("all", "camera+fixes"), "the camera states 1e-4 x its sigma", True),
    "motion 200 ms late": Lie(("camera",), ("all", "camera+fixes"), "stamps of the camera are 0.2 s late", True),
    "two agree": Lie(("wheels", "camera"), ("all",), "wheels and camera both say 0 m"),
    "fix jump": Lie(("laser",), ("all",), "the laser is 1 m to the side"),
    "fix x 1e12": Lie(("laser",), ("all", "camera+fixes"), "the laser says 1e12 x the pose"),
    "fix sure x 1e4": Lie(("laser",), ("all", "camera+fixes"), "the laser states 1e-4 x its sigma"),
    "fix five times": Lie(("laser",), (), "the laser says all five times, 1 ns apart"),
    "fix 200 ms late": Lie(("laser",), ("all",), "stamps of the laser are 0.2 s late"),
}


@dataclass(frozen=True)
class Row:
    """The worst over the seeds; times in s, `named_s` after the lie began, inf for never."""

    lie: str
    mix: str
    speed_mps: float
    decidable: bool
    rms_m: float
    oracle_m: float
    ratio: float
    p95_sigmas: float
    named_s: float
    honest_named: str

    @property
    def is_met(self) -> bool:
        """Whether all that is asked of this case holds."""
        lie = LIES[self.lie]
        if self.p95_sigmas > 4.0:
            return False
        if not self.decidable:
            return True
        is_named = self.named_s <= NAMED_WITHIN_S or lie.is_harmless
        return self.ratio <= 1.3 and is_named and not self.honest_named


def way(speed_mps: float) -> tuple[list[Pose2], list[Pose2]]:
    """Return the true poses and the steps between them."""
    poses, steps = [Pose2()], []
    for i in range(N + 12):
        t = i * DT_S
        speed = speed_mps * (1.0 + 0.3 * math.sin(2.0 * math.pi * t / 7.0))
        step = Pose2.exp(speed * DT_S, 0.0, 0.4 * math.sin(2.0 * math.pi * t / 11.0) * DT_S)
        steps.append(step)
        poses.append(poses[-1] @ step)
    return poses, steps


def estimates(lie: str, mix: str, speed_mps: float, seed: int) -> Iterator[tuple[int, str, Estimate]]:
    """Yield what the localizers of a mix say, one of them lying: index of the instant, name, estimate."""
    rng = np.random.default_rng([seed, sum(map(ord, lie))])
    poses, steps = way(speed_mps)
    noise = {name: rng.normal(size=(N + 1, 3)) * SIGMAS[name] for name in SIGMAS}
    said: dict[str, list[Pose2]] = {"wheels": [], "camera": []}
    for i in range(1, N + 1):
        t, lies = i * DT_S, LIE[0] < i * DT_S <= LIE[1]
        for name in ("wheels", "camera"):
            step = _noisy(steps[i - 1], noise[name][i])
            said[name].append(step)
            if name not in MIXES[mix]:
                continue
            if lies and name in LIES[lie].liars:
                yield i, name, _lying_motion(lie, t, i, step, steps, said[name], noise[name][i])
            else:
                yield i, name, Motion(t - DT_S, t, step, information_from_sigmas(*SIGMAS[name]))
        if i % FIX_EVERY == 0 and "laser" in MIXES[mix]:
            true = poses[i]
            dx, dy, turn = noise["laser"][i]
            pose = Pose2(true.x + dx, true.y + dy, true.theta + turn)
            if lies and "laser" in LIES[lie].liars:
                for fix in _lying_fixes(lie, t, i, pose, poses, noise["laser"][i]):
                    yield i, "laser", fix
            else:
                yield i, "laser", Fix(t, pose, information_from_sigmas(*SIGMAS["laser"]))


def _noisy(step: Pose2, noise: Floats) -> Pose2:
    return Pose2(step.x + noise[0], step.y + noise[1], step.theta + noise[2])


def _lying_motion(
    lie: str, t: float, i: int, step: Pose2, steps: Sequence[Pose2], said: Sequence[Pose2], noise: Floats
) -> Motion:
    sigmas = SIGMAS["camera"] if lie not in ("stuck encoder", "slip") else SIGMAS["wheels"]
    if lie in ("freeze", "two agree"):
        step = _noisy(Pose2(), noise)
    elif lie == "stuck encoder":
        step = Pose2()
    elif lie == "scale 1.3":
        step = Pose2(1.3 * step.x, 1.3 * step.y, step.theta)
    elif lie == "slip":
        extra = 0.5 * (step.x - step.theta * TRACK_M / 2.0)
        step = Pose2(step.x + extra / 2.0, step.y, step.theta - extra / TRACK_M)
    elif lie == "gyro bias":
        step = Pose2(step.x, step.y, step.theta + math.radians(5.0) * DT_S)
    elif lie == "jump":
        step = Pose2(step.x, step.y + (1.0 if i % 20 == 1 else 0.0), step.theta)
    elif lie == "replay":
        step = said[len(said) - 121]
    elif lie == "motion x 1e12":
        step = Pose2(1e12 * step.x, 1e12 * step.y, step.theta)
    elif lie == "motion sure x 1e4":
        sigmas = (1e-4 * sigmas[0], 1e-4 * sigmas[1], 1e-4 * sigmas[2])
    elif lie == "motion 200 ms late":
        step = _noisy(steps[i - 5], noise)
    return Motion(t - DT_S, t, step, information_from_sigmas(*sigmas))


def _lying_fixes(lie: str, t: float, i: int, pose: Pose2, poses: Sequence[Pose2], noise: Floats) -> Iterator[Fix]:
    sigmas = SIGMAS["laser"]
    if lie == "fix jump":
        pose = Pose2(pose.x, pose.y + 1.0, pose.theta)
    elif lie == "fix x 1e12":
        pose = Pose2(1e12 * pose.x, 1e12 * pose.y, pose.theta)
    elif lie == "fix sure x 1e4":
        sigmas = (1e-4 * sigmas[0], 1e-4 * sigmas[1], 1e-4 * sigmas[2])
    elif lie == "fix 200 ms late":
        true = poses[i - 4]
        pose = Pose2(true.x + noise[0], true.y + noise[1], true.theta + noise[2])
    for k in range(5 if lie == "fix five times" else 1):
        yield Fix(t + k * 1e-9, pose, information_from_sigmas(*sigmas))


@dataclass(frozen=True)
class Run:
    """One run: errors and sigmas from the beginning of the lie, and who was named when."""

    errors_m: Floats
    sigmas_m: Floats
    named_s: dict[str, float]


def run(lie: str, mix: str, speed_mps: float, seed: int, *, deaf_to: Sequence[str] = ()) -> Run:
    """Return what became of one drive."""
    estimator = Kalman(KalmanConfig())
    estimator.start(Session(start_pose=Pose2()))
    poses, _ = way(speed_mps)
    errors, sigmas, named = [], [], {}
    last = 0
    for i, name, estimate in [*estimates(lie, mix, speed_mps, seed), (N + 1, "", None)]:
        if i != last and last * DT_S > LIE[0]:
            belief = estimator.belief(last * DT_S)
            assert belief.pose_map_base is not None
            assert belief.covariance is not None
            dx, dy = belief.pose_map_base.x - poses[last].x, belief.pose_map_base.y - poses[last].y
            errors.append(math.hypot(dx, dy))
            sigmas.append(math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2.0))
            for source in belief.health:
                named.setdefault(source, last * DT_S - LIE[0])
        last = i
        if estimate is not None and name not in deaf_to:
            estimator.apply(name, estimate)
    return Run(np.array(errors), np.array(sigmas), named)


def measured(case: tuple[str, str, float, int]) -> Row:
    """Return the worst over the seeds of one lie in one mix at one speed."""
    lie, mix, speed_mps, n_seeds = case
    liars = set(LIES[lie].liars) & set(MIXES[mix])
    rms, oracles, ratios, p95s, named, honest = [], [], [], [], [], set()
    for seed in range(n_seeds):
        heard = run(lie, mix, speed_mps, seed)
        oracle = run(lie, mix, speed_mps, seed, deaf_to=sorted(liars))
        rms.append(_rms(heard.errors_m))
        oracles.append(_rms(oracle.errors_m))
        ratios.append(rms[-1] / max(oracles[-1], FLOOR_M))
        p95s.append(float(np.quantile(heard.errors_m / heard.sigmas_m, 0.95)))
        named.append(max((heard.named_s.get(liar, math.inf) for liar in liars), default=math.inf))
        honest |= set(heard.named_s) - liars
    worst = int(np.argmax(ratios))
    return Row(
        lie=lie,
        mix=mix,
        speed_mps=speed_mps,
        decidable=mix in LIES[lie].decidable,
        rms_m=rms[worst],
        oracle_m=oracles[worst],
        ratio=max(ratios),
        p95_sigmas=max(p95s),
        named_s=max(named),
        honest_named=", ".join(sorted(honest)),
    )


def _rms(errors_m: Floats) -> float:
    return float(np.sqrt(np.mean(errors_m * errors_m)))


def main() -> None:
    """Print a table, or rows of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--lies", nargs="+", choices=LIES, default=list(LIES))
    parser.add_argument("--mixes", nargs="+", choices=MIXES, default=list(MIXES))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true", help="the verdict and the tables of the page")
    options = parser.parse_args()
    cases = [
        (lie, mix, speed, options.seeds)
        for lie in options.lies
        for mix in options.mixes
        if set(LIES[lie].liars) & set(MIXES[mix]) and not set(MIXES[mix]) <= set(LIES[lie].liars)
        for speed in SPEEDS_MPS
    ]
    rows = []
    with Pool(options.workers) as pool:
        for row in pool.imap(measured, cases):
            rows.append(row)
            if not options.markdown:
                print(json.dumps(asdict(row)) if options.json else _line(row, False), flush=True)
    if options.markdown:
        print(markdown(rows, options.seeds))
        return
    n_met = sum(row.is_met for row in rows)
    print(f"{n_met} of {len(rows)} cases as asked", file=sys.stderr if options.json else sys.stdout)


def markdown(rows: Sequence[Row], n_seeds: int) -> str:
    """Return how far what was asked is met, who lies how, and each case."""
    n_silent, worst = sum(row.p95_sigmas > 4.0 for row in rows), max(row.p95_sigmas for row in rows)
    verdict = (
        f"**{sum(row.is_met for row in rows)} of {len(rows)} cases are met. In {n_silent} the belief is too certain**"
        f" (error / sigma beyond 4); the worst is {worst:.1f}. Each row is the worst of {n_seeds} seeds."
    )
    said = [f"| {name} | {lie.what} |" for name, lie in LIES.items() if any(row.lie == name for row in rows)]
    cases = HEAD + "\n".join(_line(row, True) for row in rows)
    return "\n".join([verdict, "", "| lie | what is said |", "|---|---|", *said, "", cases])


def _line(row: Row, is_markdown: bool) -> str:
    named = "-" if row.named_s == math.inf else f"{row.named_s:.2f} s"
    ratio = f"{row.ratio:.2f}" if row.decidable else f"({row.ratio:.2f})"
    verdict = "ok" if row.is_met else "**missed**"
    rms = f"{1e3 * row.rms_m:.1f} / {1e3 * row.oracle_m:.1f}"
    cells = [
        row.lie,
        row.mix,
        f"{row.speed_mps:g}",
        rms,
        ratio,
        f"{row.p95_sigmas:.1f}",
        named,
        row.honest_named,
        verdict,
    ]
    if is_markdown:
        return f"| {' | '.join(cells)} |"
    return "{:20}{:14}{:5}{:>24}{:>9}{:>8}{:>9}  {:16}{}".format(*cells)


if __name__ == "__main__":
    main()
