"""``trailmark calibrate ground``. What is heavy is imported on use."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.errors import ConfigError, DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from trailmark.frames import GroundPlane, SensorInfo
    from trailmark.geometry import Pose3
    from trailmark_ground_vo.calibration import Calibrated

__all__ = ["ground"]

_GUIDE = """\
Calibrating a camera that looks at the ground. The robot must
  1. stand still,
  2. drive straight, as far as --distance says (measure it with a tape), and stand still,
  3. turn in place, a whole turn at best, and stand still.
One second of standing still is enough. More straight moves: give --distance for each, in the order of driving; moves
to the side, with --sideways, tell the scale across. Without 3 the place of the camera stays as it is."""


#: A heading so far from the config's is more often a move in another direction than a camera that was turned.
_DOUBTFUL_DEG = 30.0


@click.command("ground")
@click.argument("config", metavar="CONFIG|RECORDING|camera")
@click.option(
    "--distance", "distances", type=float, multiple=True, required=True, help="Length of a straight move [m]."
)
@click.option("--sideways", type=float, multiple=True, help="Length of a straight move across the robot [m].")
@click.option("--distance-sigma", default=0.001, show_default=True, help="How well a length is known [m].")
@click.option("--backward", is_flag=True, help="The robot drove backwards.")
@click.option("--drive", "is_driven", is_flag=True, help="Drive the robot, or the simulated one, by commands.")
@click.option("--turn", "turn_deg", type=float, help="With --drive: turn in place [deg].  [default: 360]")
@click.option("--camera", help="Which camera; default: the only one.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="File to write [NAME.calib.yaml].")
@click.option("--overwrite", is_flag=True, help="Replace the file that is there.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@click.pass_context
def ground(context: click.Context, /, config: str, **options: Any) -> None:
    """Scale, heading and place of a camera that looks at the ground: drive a known distance, turn in place.

    CONFIG is a config, a recording or `camera`. Every figure comes with its uncertainty (95 %). Writes the scale as a
    file that `sensors:` takes, and prints the mounting beside it.
    """
    request = _GroundRequest(**options)
    _check(request)
    from trailmark.cli.errors import say
    from trailmark.cli.guess import read_target
    from trailmark.cli.in_config import path_in_config
    from trailmark.cli.root import plugins_of
    from trailmark_ground_vo.calibration import Known, calibrate
    from trailmark_ground_vo.calibration_drive import Speeds, observe_drive

    run_config = read_target(config, plugins_of(context), request.overrides)

    def begin(camera: SensorInfo) -> None:
        _refuse_what_is_there(request, camera)
        if not request.as_json:
            say(_GUIDE)

    sign = -1.0 if request.backward else 1.0
    turn_deg = 360.0 if request.turn_deg is None else request.turn_deg
    drive = Speeds(sign * request.distances[0], math.radians(turn_deg)) if request.is_driven else None
    seen = observe_drive(run_config, request.camera, drive, say, begin)
    known = Known(request.distances, request.sideways, request.distance_sigma, request.backward)
    try:
        found = calibrate(seen.steps, known, seen.assumed)
    except DataError as error:
        if not seen.lost:
            raise
        reason, count = next(iter(seen.lost.items()))
        raise DataError(f"{error}; {count} of {seen.n_pictures} pictures were lost: {reason}") from error
    file = _file_of(request, seen.sensor)
    lines = _lines(found, seen.sensor, path_in_config(file, run_config.base_dir), bool(request.sideways))
    _write(file, found, seen.sensor, lines)
    if request.as_json:
        n_lost = sum(seen.lost.values())
        click.echo(json.dumps(_document(found, seen.sensor.name, seen.n_pictures, n_lost) | {"file": str(file)}))
        return
    for line in lines:
        click.echo(line)


@dataclass(frozen=True, slots=True)
class _GroundRequest:
    """The options of the command."""

    distances: tuple[float, ...]
    sideways: tuple[float, ...]
    distance_sigma: float
    backward: bool
    is_driven: bool
    turn_deg: float | None
    camera: str | None
    out: Path | None
    overwrite: bool
    overrides: tuple[str, ...]
    as_json: bool


def _check(request: _GroundRequest) -> None:
    lengths = (*request.distances, *request.sideways, request.distance_sigma)
    if any(not length > 0.0 or not math.isfinite(length) for length in lengths):
        raise ConfigError("--distance, --sideways and --distance-sigma are lengths in metres, greater than 0")
    if request.is_driven and len(request.distances) + len(request.sideways) > 1:
        raise ConfigError("--drive drives one straight move: give one --distance and no --sideways")
    if request.turn_deg is not None and not request.is_driven:
        raise ConfigError(
            "--turn says how far --drive turns the robot; without --drive it turns as far as you drive it"
        )
    if request.out is not None and not request.out.parent.is_dir():
        raise ConfigError(f"--out {request.out}: there is no folder {request.out.parent}; make it before the drive")


def _file_of(request: _GroundRequest, camera: SensorInfo) -> Path:
    return request.out or Path(f"{camera.name}.calib.yaml")


def _flat_field_of(file: Path) -> Path:
    return file.with_suffix(".flat.npy")


def _refuse_what_is_there(request: _GroundRequest, camera: SensorInfo) -> None:
    file = _file_of(request, camera)
    for one in (file, _flat_field_of(file)):
        if one.exists() and not request.overwrite:
            raise ConfigError(f"{one} is there already; choose another --out, or --overwrite")


def _write(file: Path, found: Calibrated, sensor: SensorInfo, lines: Sequence[str]) -> None:
    """Write the calibration; a flat field goes into a file of its own beside it."""
    import numpy as np

    from trailmark.config.yaml_text import dump_yaml
    from trailmark.frames.documents import calibration_to_document

    document: dict[str, Any] = {"metres_per_pixel": [float(f"{scale:.7g}") for scale in found.metres_per_pixel]}
    calibration: Any = sensor.calibration
    plane: GroundPlane | None = calibration
    try:
        if plane is not None and plane.lens is not None:
            document["lens"] = calibration_to_document(plane.lens)
        if plane is not None and plane.flat_field is not None:
            flat = _flat_field_of(file)
            np.save(flat, plane.flat_field)
            document["flat_field"] = flat.name
        comment = "\n".join(f"# {line}".rstrip() for line in lines)
        file.write_text(f"{comment}\n{dump_yaml(document)}", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {file}: {error}") from error


def _lines(found: Calibrated, sensor: SensorInfo, file: str, has_sideways: bool = False) -> list[str]:
    """Return what is told; `file` as the config names it."""
    (along_u, along_v), sigmas = found.metres_per_pixel, found.metres_per_pixel_sigma
    lines = [f"scale along u   {1e3 * along_u:.5f} +- {2e3 * sigmas[0]:.5f} mm/px (95 %)"]
    ratio = "" if found.has_both_scales else ": not measured, ratio to u as before (--sideways measures it)"
    lines.append(f"scale along v   {1e3 * along_v:.5f} +- {2e3 * sigmas[1]:.5f} mm/px{ratio}")
    lines.append(
        f"heading         {math.degrees(found.yaw_rad):.3f} +- {math.degrees(2 * found.yaw_sigma_rad):.3f} deg"
        f"{_doubt(found.yaw_rad, sensor.pose_base_sensor.yaw, has_sideways)}"
    )
    if found.lever_m is None or found.lever_sigma_m is None:
        lines.append("place           not measured: no turn in place")
    else:
        for axis, value, sigma in zip(("forward", "left"), found.lever_m, found.lever_sigma_m):
            lines.append(f"{axis:16}{1e3 * value:.2f} +- {2e3 * sigma:.2f} mm")
    mounting = _mounting_in_words(found, sensor.pose_base_sensor)
    lines += ["for the config:", "sensors:", f"  {sensor.name}: {{mounting: {{{mounting}}}, calibration: {file}}}"]
    return lines


def _doubt(yaw_rad: float, believed_rad: float, has_sideways: bool) -> str:
    """Return what to think of a heading: moves in another order, or backwards, would tell another one."""
    off_deg = abs(math.degrees(math.remainder(yaw_rad - believed_rad, 2.0 * math.pi)))
    if believed_rad and off_deg > _DOUBTFUL_DEG:
        return (
            f": {off_deg:.0f} deg from the config's; did the robot drive forward (else --backward), and the moves in"
            " the order that was given?"
        )
    if not believed_rad and has_sideways:
        return ": if the first moves were those along the robot; else it is 90 deg off, and the scales are wrong"
    return ""


def _mounting_in_words(found: Calibrated, known: Pose3) -> str:
    """Return the whole mounting: what was measured, and what was known of the rest, which the line must not lose."""
    x, y = (known.x, known.y) if found.lever_m is None else found.lever_m
    roll_deg, pitch_deg = math.degrees(known.roll), math.degrees(known.pitch)
    rest = {"x": x, "y": y, "z": known.z, "roll_deg": roll_deg, "pitch_deg": pitch_deg}
    told = [f"{name}: {round(value, 5):g}" for name, value in rest.items() if round(value, 5)]
    return ", ".join([*told, f"yaw_deg: {math.degrees(found.yaw_rad):.3f}"])


def _document(found: Calibrated, name: str, n_pictures: int, n_lost: int) -> dict[str, Any]:
    lever, lever_sigma = found.lever_m, found.lever_sigma_m
    return {
        "sensor": name,
        "metres_per_pixel": list(found.metres_per_pixel),
        "metres_per_pixel_sigma": list(found.metres_per_pixel_sigma),
        "has_both_scales": found.has_both_scales,
        "yaw_deg": math.degrees(found.yaw_rad),
        "yaw_sigma_deg": math.degrees(found.yaw_sigma_rad),
        "x_m": lever and lever[0],
        "y_m": lever and lever[1],
        "x_sigma_m": lever_sigma and lever_sigma[0],
        "y_sigma_m": lever_sigma and lever_sigma[1],
        "turned_deg": math.degrees(found.turned_rad),
        "pictures": n_pictures,
        "lost": n_lost,
    }
