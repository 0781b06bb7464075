"""Errors of a localizer against ground truth: the noise figures for the config of a Kalman estimator.

A fix repeats the errors of its map, so its errors do not average out over a second: their root mean square is what no
fix should be believed to be better than (``floor_m``, ``floor_deg``). Errors of motion add up, so they are compared
over a second, and the stated standard deviations are scaled (``sigma_scale``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame
from trailmark.geometry import Pose2, Trajectory, wrap_angle, wrap_angles
from trailmark.paths import Path

__all__ = ["MeasuredNoise", "config_lines", "measured_noise"]


# Motion is compared over windows of this length [s].
_WINDOW_S = 1.0
_SAME_INSTANT_S = 1e-6
# Fewer than this say nothing.
_LEAST = 10
# Half the squared errors of 1, 2 and 3 numbers lie below this: medians bear outliers, which a gate takes out.
_CHI2_MEDIANS = (0.4549, 1.3863, 2.3660)


@dataclass(frozen=True, slots=True)
class MeasuredNoise:
    """Errors of one localizer.

    Attributes
    ----------
    kind : str
        ``motion``, ``fix`` or ``pathoffset``.
    n : int
        Fixes, or windows of motion, that were compared.
    rms : (float, float, float)
        Of x, y and heading, or station, lateral and heading; NaN where none was measured [m, m, rad].
    sigma_scale : float
        Factor that makes the stated standard deviations right, by the median of the squared errors.
    """

    kind: str
    n: int
    rms: tuple[float, float, float]
    sigma_scale: float


def measured_noise(
    estimates: EstimateTable, truth: Trajectory, path: Path | None = None, map_frame: MapFrame = ONE_FRAME
) -> dict[str, MeasuredNoise]:
    """Return the errors of each localizer by name, without those that gave too few estimates.

    Parameters
    ----------
    estimates : EstimateTable
        Of a run, in the frame of the truth.
    truth : Trajectory
        Where base really was.
    path : Path, optional
        The taught path: needed for path offsets.
    map_frame : MapFrame
        How the map lies in the frame of the truth.

    Raises
    ------
    DataError
        If there is a path offset, and no path.
    """
    found = {}
    for source in estimates.sources():
        own = estimates.of(source)
        kinds = [kind for kind in ("fix", "pathoffset", "motion") if (own.kind == kind).any()]
        if not kinds:
            continue
        kind = kinds[0]  # who says both a place and a motion is judged by the place
        if kind == "pathoffset" and path is None:
            raise DataError(f"{source!r} says path offsets: their errors need the path, --store F.trail")
        rows = own.where(_usable(own, truth, kind))
        pairs = list(_windows(rows, truth) if kind == "motion" else _singles(rows, truth, path, map_frame))
        if len(pairs) >= _LEAST:
            found[source] = _noise_of(kind, pairs)
    return found


def config_lines(noise: Mapping[str, MeasuredNoise]) -> str:
    """Return what to paste into a config, as YAML; what was measured stands behind it."""
    lines = ["estimator:", "  plugin: kalman", "  sources:"]
    for source, one in noise.items():
        x, y, turn = one.rms
        what = "windows of 1 s" if one.kind == "motion" else "fixes" if one.kind == "fix" else "path offsets"
        spoken = (
            f"# {one.n} {what}: rms {x:.3g}, {y:.3g} m, {math.degrees(turn):.3g} deg; {one.sigma_scale:.3g} x stated"
        )
        lines.append(f"    {source}: {{{', '.join(_keys(one))}}}  {spoken}")
    return "\n".join(lines)


def _keys(noise: MeasuredNoise) -> Iterator[str]:
    if noise.kind == "motion":
        yield f"sigma_scale: {noise.sigma_scale:.3g}"
        return
    sides = [value for value in noise.rms[:2] if math.isfinite(value)]
    if sides:
        yield f"floor_m: {max(math.sqrt(sum(value * value for value in sides) / len(sides)), 1e-6):.3g}"
    if math.isfinite(noise.rms[2]):
        yield f"floor_deg: {max(math.degrees(noise.rms[2]), 1e-4):.3g}"


def _usable(rows: EstimateTable, truth: Trajectory, kind: str) -> Bools:
    begin_s = rows.since_s if kind == "motion" else rows.stamp_s
    is_inside = (begin_s >= truth.stamps_s[0]) & (rows.stamp_s <= truth.stamps_s[-1])
    is_finite = np.isfinite(rows.numbers).all(axis=1) & np.isfinite(rows.information).all(axis=(1, 2))
    return np.asarray((rows.kind == kind) & (rows.outcome != "refused") & is_inside & is_finite)


def _singles(
    rows: EstimateTable, truth: Trajectory, path: Path | None, map_frame: MapFrame
) -> Iterator[tuple[Floats, Floats]]:
    """Yield error and information of each fix; of a path offset, in path coordinates."""
    if not len(rows):
        return
    stamps, where = np.unique(rows.stamp_s, return_inverse=True)
    true = truth.at(stamps)
    if map_frame is not ONE_FRAME:
        true = Trajectory(true.stamps_s, map_frame.in_map(true.poses))
    for numbers, information, index in zip(rows.numbers, rows.information, where):
        pose = true[int(index)][1]
        if path is None or rows.kind[0] == "fix":
            expected = pose.array()
        else:
            located = path.locate(pose, float(numbers[0]))
            expected = np.array([located.station_m, located.lateral_m, located.heading_rad])
        error = numbers - expected
        error[2] = wrap_angle(float(error[2]))
        yield error, information


def _windows(rows: EstimateTable, truth: Trajectory) -> Iterator[tuple[Floats, Floats]]:
    """Yield error and information of the motion over each second."""
    begin = 0
    for end in range(len(rows)):
        if rows.since_s[end] - rows.stamp_s[end - 1] > _SAME_INSTANT_S and end > begin:
            begin = end  # a gap
        if rows.stamp_s[end] - rows.since_s[begin] < _WINDOW_S - _SAME_INSTANT_S:
            continue
        chained, information = _chain_motions(rows.numbers[begin : end + 1], rows.information[begin : end + 1])
        (_, since), (_, now) = truth.at([rows.since_s[begin], rows.stamp_s[end]])
        error = chained.array() - since.between(now).array()
        yield np.array([error[0], error[1], wrap_angle(float(error[2]))]), information
        begin = end + 1


def _chain_motions(steps: Floats, information: Floats) -> tuple[Pose2, Floats]:
    """Return several motions as one, and its information; of what all measured."""
    measured = np.flatnonzero(np.diagonal(information, axis1=1, axis2=2).min(axis=0) > 0.0)
    way, spread = Pose2(), np.zeros((3, 3))
    for step, own in zip(steps, information):
        cos, sin = math.cos(way.theta), math.sin(way.theta)
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        longer = way @ Pose2.from_array(step)
        carried = np.array([[1.0, 0.0, way.y - longer.y], [0.0, 1.0, longer.x - way.x], [0.0, 0.0, 1.0]])
        spread = carried @ spread @ carried.T + turned @ np.linalg.pinv(own, rcond=1e-15, hermitian=True) @ turned.T
        way = longer
    if len(measured) == 3:
        return way, np.asarray(np.linalg.inv(spread))
    total = np.zeros((3, 3))
    total[measured, measured] = 1.0 / np.diag(spread)[measured]
    return way, total


def _noise_of(kind: str, pairs: list[tuple[Floats, Floats]]) -> MeasuredNoise:
    errors, information = (np.array(values) for values in zip(*pairs))
    errors[:, 2] = wrap_angles(errors[:, 2])
    is_measured = np.diagonal(information, axis1=1, axis2=2) > 0.0
    counted = is_measured.sum(axis=0)
    squares = (errors * errors * is_measured).sum(axis=0)
    rms = np.sqrt(np.divide(squares, counted, out=np.full(3, np.nan), where=counted > 0))
    nees = np.einsum("ni,nij,nj->n", errors, information, errors)
    dof = np.array([np.linalg.matrix_rank(_unitless(one), hermitian=True) for one in information])
    ratio = nees[dof > 0] / np.take(_CHI2_MEDIANS, dof[dof > 0] - 1)
    scale = math.sqrt(float(np.median(ratio))) if len(ratio) else 1.0
    return MeasuredNoise(kind, len(pairs), (float(rms[0]), float(rms[1]), float(rms[2])), scale)


def _unitless(information: Floats) -> Floats:
    roots = np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    return np.asarray(information / np.outer(roots, roots))
