"""``trailmark calibrate rgbd``; what is heavy is imported on use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from trailmark.frames import DepthCamera, Pinhole
    from trailmark.plugins import Plugins
    from trailmark_kinect_landmarks.calibrating.board import BoardView

__all__ = ["rgbd"]

Size = tuple[int, int]

_USUAL_SIZE = "640x480"
_KINECT_DEG = 57.0  # usual capture angle of the colour camera
#: The axis of a lens is nearer to the middle than this share of the picture, unless that has another size.
_OFF_CENTRE = 0.1
_NUDGE = "move a bright flat rectangle before both cameras, near and far, to all sides, turned this way and that"


@click.command("rgbd")
@click.argument("recording", metavar="[CONFIG|RECORDING|camera]", required=False)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="Calibration to write.")
@click.option("--board", metavar="WxH", help="Sides of the rectangle [m], as 0.60x0.45: lenses and pose, not a crop.")
@click.option("--colour", type=click.Path(path_type=Path), help="Calibration of the colour lens, where it is known.")
@click.option("--sensor", help="The camera; with --depth the colour camera.")
@click.option("--depth", help="The depth camera, where it is another sensor with 16-bit pictures.")
@click.option(
    "--depth-factor", default=1000.0, show_default=True, type=click.FloatRange(1.0), help="Its values a metre."
)
@click.option("--frames", "n_frames", default=300, show_default=True, type=click.IntRange(1), help="Pairs to look at.")
@click.option("--every", default=1, show_default=True, type=click.IntRange(1), help="Look at every n-th pair.")
@click.option("--edges", metavar="LEFT,RIGHT,TOP,BOTTOM", help="Instead of a recording: see above.")
@click.option("--size", metavar="WxH", help="With --edges: colour picture [px].  [default: 640x480]")
@click.option("--depth-size", metavar="WxH", help="With --edges: depth picture [px]; default: as --size.")
@click.option("--overwrite", is_flag=True, help="Replace the file that is there.")
@click.pass_context
def rgbd(context: click.Context, /, recording: str | None, **options: Any) -> None:
    """Tell which depth pixel belongs to which colour pixel (Toth et al. 2015, Eqs. 3-6).

    Move a bright flat rectangle before both cameras, to all sides of the picture, and give the recording: the crop of
    the colour picture and the ratios follow. With the rectangle's size (--board) both lenses and the pose between them
    follow as well, which is right at every distance; a crop is right at that of the rectangle alone.

    By hand, as the paper does: move the rectangle until it touches the left border of the depth picture, note the
    column of that edge in the colour picture, do the same at the other three, and give --edges.
    """
    from trailmark.cli.guess import is_config
    from trailmark.cli.root import plugins_of

    base_dir = Path(recording).parent if recording is not None and is_config(recording) else Path()
    request = _RgbdRequest(**options, base_dir=base_dir)
    if request.out.exists() and not request.overwrite:
        raise ConfigError(f"{request.out} is there already; choose another --out, or --overwrite")
    if recording is not None and request.edges is None:
        _refuse({"--size": request.size, "--depth-size": request.depth_size}, "a recording tells the sizes itself")
        sides = _sides(request.board) if request.board else None
        views, sizes = _views(recording, plugins_of(context), request)
        _from_views(views, sizes, sides, request)
    elif recording is None and request.edges is not None:
        _refuse({"--board": request.board}, "--edges tell a crop alone; the lenses need a recording of the rectangle")
        _by_hand(request.edges, request)
    else:
        raise ConfigError(f"give a recording, or --edges, and not both; for a recording {_NUDGE}")


@dataclass(frozen=True, slots=True)
class _RgbdRequest:
    """The options of the command."""

    out: Path
    board: str | None
    colour: Path | None
    sensor: str | None
    depth: str | None
    depth_factor: float
    n_frames: int
    every: int
    edges: str | None
    size: str | None
    depth_size: str | None
    overwrite: bool
    base_dir: Path


def _refuse(given: Mapping[str, str | None], reason: str) -> None:
    for option, value in given.items():
        if value is not None:
            raise ConfigError(f"{option} has no effect here: {reason}")


def _by_hand(edges: str, request: _RgbdRequest) -> None:
    from trailmark_kinect_landmarks.calibrating.crop_ratios import as_depth_camera
    from trailmark_kinect_landmarks.calibration import Crop

    size = request.size or _USUAL_SIZE
    colour_size = _size(size, "--size")
    depth_size = _size(request.depth_size or size, "--depth-size")
    numbers = _numbers(edges, ",", 4, "--edges takes LEFT,RIGHT,TOP,BOTTOM in colour pixels, as 33,606,25,454")
    left, right, top, bottom = numbers
    if not (0 <= left < right < colour_size[0] and 0 <= top < bottom < colour_size[1]):
        raise ConfigError(
            f"--edges {edges}: left before right, top before bottom, within {colour_size[0]} x {colour_size[1]} px"
        )
    kept = (right - left + 1, bottom - top + 1)
    if 2 * kept[0] < colour_size[0] or 2 * kept[1] < colour_size[1]:  # no two such lenses are sold in one housing
        raise ConfigError(
            f"--edges {edges} leaves {kept[0]:g} x {kept[1]:g} px of {colour_size[0]} x {colour_size[1]}: give the"
            " columns and rows at which the borders appear, not how many are cut off"
        )
    crop = Crop.from_rectangles((left, right, top, bottom), colour_size)
    _say_crop(crop, colour_size, depth_size)
    _write(as_depth_camera(crop, _lens(request.colour, colour_size), colour_size, depth_size), request)


def _views(recording: str, plugins: Plugins, request: _RgbdRequest) -> tuple[list[BoardView], tuple[Size, Size]]:
    """Return all views of the rectangle in a recording, and the sizes of both pictures."""
    from itertools import islice

    from trailmark.cli.errors import say
    from trailmark.cli.guess import read_target
    from trailmark.pipeline import build_sources
    from trailmark_kinect_landmarks.calibrating.board import find_board
    from trailmark_kinect_landmarks.calibrating.recordings import choose_sensors, pairs, start_sources

    sources = build_sources(read_target(recording, plugins))
    views: list[BoardView] = []
    n, sizes = 0, None
    try:
        chosen = choose_sensors(start_sources(sources), request.sensor, request.depth)
        for bgr, depth_m in islice(pairs(sources, chosen, request.depth_factor, request.every), request.n_frames):
            n, sizes = n + 1, ((bgr.shape[1], bgr.shape[0]), (depth_m.shape[1], depth_m.shape[0]))
            view = find_board(bgr, depth_m)
            if view is not None:
                views.append(view)
    finally:
        for source in sources:
            source.close()
    if sizes is None:
        raise ConfigError(f"{recording} gives no pair of a colour and a depth picture")
    say(f"the rectangle is seen whole by both cameras in {len(views)} of {n} pairs")
    return views, sizes


def _from_views(
    views: Sequence[BoardView], sizes: tuple[Size, Size], sides: tuple[float, float] | None, request: _RgbdRequest
) -> None:
    from trailmark_kinect_landmarks.calibrating.crop_ratios import as_depth_camera, fit_crop

    colour_size, depth_size = sizes
    fit = fit_crop(views, colour_size, depth_size)
    if sides is None:
        _say_crop(fit.crop, colour_size, depth_size)
        click.echo(f"borders        +-{fit.sigma_px:.1f} px; corners of the rectangle miss by {fit.rms_px:.1f} px rms")
        _write(as_depth_camera(fit.crop, _lens(request.colour, colour_size), colour_size, depth_size), request)
        return
    import math

    from trailmark_kinect_landmarks.calibrating.lenses import fit_lenses

    known = None if request.colour is None else _lens(request.colour, colour_size)
    found = fit_lenses(views, sides, colour_size, depth_size, known)
    pose = found.camera.pose_colour_depth
    assert found.camera.depth is not None
    for name, lens, sigma in zip(("colour", "depth"), (found.camera.colour, found.camera.depth), found.sigma_focal_px):
        told = "as given" if name == "colour" and known is not None else f"+-{sigma:.1f} px"
        click.echo(f"{name:<15}fx {lens.fx:.1f}, fy {lens.fy:.1f}, cx {lens.cx:.1f}, cy {lens.cy:.1f} px ({told})")
    shift = ", ".join(f"{axis} {1e3 * value:.1f}" for axis, value in zip("xyz", (pose.x, pose.y, pose.z)))
    turn = ", ".join(
        f"{axis} {math.degrees(value):.2f}"
        for axis, value in zip(("roll", "pitch", "yaw"), (pose.roll, pose.pitch, pose.yaw))
    )
    click.echo(f"depth camera   {shift} mm (+-{1e3 * found.sigma_shift_m:.1f}), as seen from colour")
    click.echo(f"               {turn} deg (+-{math.degrees(found.sigma_turn_rad):.2f})")
    click.echo(f"corners        miss by {found.rms_px:.2f} px rms, by crop ratios {fit.rms_px:.2f} px")
    _write(found.camera, request)


def _say_crop(crop: Any, colour_size: Size, depth_size: Size) -> None:
    from trailmark_kinect_landmarks.calibration import ratios

    R_x, R_y = ratios(depth_size, crop.size(colour_size))
    click.echo(f"crop           left {crop.left}, right {crop.right}, top {crop.top}, bottom {crop.bottom} px")
    click.echo(f"Eqs. (3), (4)  R_x {R_x:.4f}, R_y {R_y:.4f}")


def _write(camera: DepthCamera, request: _RgbdRequest) -> None:
    from trailmark.cli.errors import say
    from trailmark.cli.in_config import path_in_config
    from trailmark.config.yaml_text import dump_yaml
    from trailmark.frames.documents import calibration_to_document

    out = request.out
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(dump_yaml(calibration_to_document(camera)), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {out}: {error.strerror}") from error
    line = f"sensors: {{NAME: {{calibration: {path_in_config(out, request.base_dir)}}}}}"
    say(f"wrote {out}; use it as  {line}, beside the sensor's `mounting` if it has one")


def _lens(path: Path | None, size: Size) -> Pinhole:
    """Return the colour lens of a calibration; without one, that of a Kinect."""
    from trailmark.config import read_calibration
    from trailmark.frames import DepthCamera, Pinhole
    from trailmark_kinect_landmarks.calibrating.crop_ratios import lens_of_angle

    if path is None:
        return lens_of_angle(size, _KINECT_DEG)
    known = read_calibration(path)
    lens = known.colour if isinstance(known, DepthCamera) else known
    if not isinstance(lens, Pinhole):
        raise ConfigError(f"{path} is no calibration of a colour camera: fx, fy, cx and cy are needed")
    if max(abs(lens.cx / size[0] - 0.5), abs(lens.cy / size[1] - 0.5)) > _OFF_CENTRE:
        raise ConfigError(
            f"{path}: the axis of this lens, at {lens.cx:g}, {lens.cy:g} px, is far from the middle of the pictures of"
            f" {size[0]} x {size[1]} px; calibrate it at their size"
        )
    return lens


def _size(text: str, option: str) -> Size:
    width, height = _numbers(text, "x", 2, f"{option} takes WIDTHxHEIGHT in pixels, as 640x480")
    if min(width, height) < 1 or width % 1 or height % 1:
        raise ConfigError(f"{option} takes whole pixels, as 640x480, not {text!r}")
    return int(width), int(height)


def _sides(text: str) -> tuple[float, float]:
    width, height = _numbers(text, "x", 2, "--board takes WIDTHxHEIGHT in metres, as 0.60x0.45")
    if not 0.05 <= min(width, height) <= max(width, height) <= 5.0:
        raise ConfigError(f"--board is in metres, 0.05 to 5, not {text!r}")
    return width, height


def _numbers(text: str, separator: str, n: int, usage: str) -> list[float]:
    import math

    try:
        numbers = [float(part) for part in text.split(separator)]
    except ValueError:
        numbers = []
    if len(numbers) != n or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"{usage}, not {text!r}")
    return numbers
