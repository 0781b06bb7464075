"""``trailmark demo``: teach a path, drive it again, say how well, without a robot."""

from __future__ import annotations

import json
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.cli.root import plugins_of
from trailmark.errors import ConfigError
from trailmark.interruption import ending_signal

if TYPE_CHECKING:
    from trailmark.pipeline import RunRequest, RunResult

__all__ = ["demo_command"]

#: While the camera fails in the replay, since its start [s].
_DARK_S = (20, 22)


@click.command("demo")
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/demo"), show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of all random numbers.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
@click.pass_context
def demo_command(context: click.Context, out: Path, seed: int, as_json: bool) -> None:
    """Teach a path to a simulated robot, let it drive the path again, and report. Takes half a minute to a minute.

    An earlier demo in --out is replaced; the config it ran is left there, to be changed and run again.
    """
    from trailmark.cli.init import starters
    from trailmark.pipeline import RunRequest

    began_s = time.monotonic()
    plugins = plugins_of(context)
    texts = starters(plugins)
    if "demo" not in texts:
        raise ConfigError("the demo needs the plugin 'sim', which did not load: run 'trailmark plugins doctor'")
    _clear(out)
    config, store = out / "demo.yaml", out / "place.trail"
    config.write_text(texts["demo"], encoding="utf-8")
    show = _silent if as_json else click.echo
    show("Teaching: somebody drives the robot through four gates, and it remembers the floor.")
    request = RunRequest(config=config, store=store, overrides=[f"seed={seed}"], plugins=plugins)
    # Nothing goes wrong while teaching: its report would cost more time than anybody spends on it.
    taught = _run(replace(request, mode="teach", out=out / "teach"), report=False)
    show("Replaying: the robot is put down a little off the start and drives the path by itself.")
    show(f"  From {_DARK_S[0]} to {_DARK_S[1]} s its camera sees nothing, and the wheels carry on.")
    dark = ["sources.robot.perturb.sensors=[floor]", f"sources.robot.perturb.missing_s={list(_DARK_S)}"]
    replaying = replace(request, mode="replay", out=out / "replay", overrides=[*request.overrides, *dark])
    replayed = _run(replaying, report=True)
    figures = _figures(taught, replayed) | {"wall_s": round(time.monotonic() - began_s, 1)}
    if as_json:
        click.echo(json.dumps(figures, indent=1))
    else:
        _print(figures, out)


def _clear(out: Path) -> None:
    """Make the folder, without what an earlier demo left in it."""
    out.mkdir(parents=True, exist_ok=True)
    for name in ("teach", "replay"):
        shutil.rmtree(out / name, ignore_errors=True)
    for path in out.glob("place.trail*"):
        path.unlink()


def _run(request: RunRequest, *, report: bool) -> RunResult:
    from trailmark.api import run
    from trailmark.cli.progress import RunProgress

    with RunProgress("auto") as on_step:
        result = run(request, report=report, on_step=on_step)
    if result.status == "interrupted":
        raise ending_signal() or KeyboardInterrupt
    return result


def _figures(taught: RunResult, replayed: RunResult) -> dict[str, Any]:
    """Return what the demo shows: how well the robot held the path, and how well it knew where it was."""
    from trailmark.evaluation import collisions_of, find_metric

    truth = replayed.metrics["trajectories"]["groundtruth"]["metrics"]
    lateral = {key: find_metric(truth, f"lateral_{key}_m") for key in ("mean", "max")}
    errors = {
        name: find_metric(found["metrics"], "ate_rmse_m", found.get("alignment", {}).get("used", "se2"))
        for name, found in replayed.metrics["trajectories"].items()
        if name != "groundtruth"
    }
    return {
        "path_m": taught.metrics["trajectories"]["groundtruth"]["length_m"],
        "status": replayed.status,
        "reason": replayed.reason,
        "lateral_mean_mm": None if lateral["mean"] is None else 1e3 * lateral["mean"],
        "lateral_max_mm": None if lateral["max"] is None else 1e3 * lateral["max"],
        "gates_touched": collisions_of(replayed.counters),
        "ate_rmse_mm": {name: None if error is None else 1e3 * error for name, error in errors.items()},
        "frames": taught.timing["frames"] + replayed.timing["frames"],
    }


def _silent(_: str) -> None:
    """Print nothing: the figures are asked for as JSON."""


def _print(figures: dict[str, Any], out: Path) -> None:
    lines = [
        "",
        f"The robot drove {figures['path_m']:.1f} m: {figures['reason'] or figures['status']}.",
        f"  truly off the taught path     {figures['lateral_mean_mm']:6.1f} mm on average,"
        f" {figures['lateral_max_mm']:.1f} mm at most",
        f"  poles of the gates touched    {figures['gates_touched']:6d}",
    ]
    for name, error_mm in figures["ate_rmse_mm"].items():
        if error_mm is not None:
            alone = "" if name == "fused" else " alone"
            lines.append(f"  error of {name + alone:<20} {error_mm:6.1f} mm rms")
    lines += [
        "  (Alone, the camera misses the way that it drove in the dark, and its error is that of all its way.)",
        f"  {figures['frames']} frames in {figures['wall_s']:.0f} s",
        "",
        f"Pictures   {out / 'replay' / 'report.html'}",
        f"Try it     trailmark replay {out / 'demo.yaml'} --store {out / 'place.trail'} --reverse",
    ]
    click.echo("\n".join(lines))
