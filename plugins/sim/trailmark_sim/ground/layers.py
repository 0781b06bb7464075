"""Layers of a floor: kernels that add detail to a grey canvas, as functions of the place alone.

Every kernel takes the canvas ``out`` (N, N) float32, the coordinates ``x, y`` (N, N) float64 of its texels [m] and a
seed (uint64), and adds to the canvas. What a texel gets depends on its coordinates and the seed, never on the
canvas it lies in: neighbouring tiles fit, and nothing repeats before 2^63 cells are used up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inner_kernel, kernel
from trailmark_sim.hashing import hash2, mix_bits, normal_of, unit_of
from trailmark_sim.interpolation import between

__all__ = [
    "GrainLayer",
    "SpeckLayer",
    "add_clouds",
    "add_dust",
    "add_grains",
    "add_joints",
    "add_specks",
    "split_planks",
]


@kernel
def add_clouds(
    out: AnyArray, x: AnyArray, y: AnyArray, cell_x_m: float, cell_y_m: float, gain: float, seed: np.uint64
) -> None:
    """Add value noise: normal numbers on a lattice, smoothly interpolated."""
    width = out.shape[1]
    us, vs, cells_u, cells_v = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    for row in range(out.shape[0]):
        for col in range(width):  # loops without branches: several texels at once
            u, v = x[row, col] / cell_x_m, y[row, col] / cell_y_m
            cells_u[col], cells_v[col] = np.floor(u), np.floor(v)
            u, v = u - cells_u[col], v - cells_v[col]
            us[col], vs[col] = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
        first = 0
        while first < width:  # most texels share the corners of the one before
            last = _end_of_cell(cells_u, cells_v, first)
            i, j = int(cells_u[first]), int(cells_v[first])
            a, b = normal_of(hash2(i, j, seed)), normal_of(hash2(i + 1, j, seed))
            c, d = normal_of(hash2(i, j + 1, seed)), normal_of(hash2(i + 1, j + 1, seed))
            _add_between(out[row, first:last], (a, b, c, d), us[first:last], vs[first:last], gain)
            first = last


@inner_kernel
def _end_of_cell(cells_u: AnyArray, cells_v: AnyArray, first: int) -> int:
    """Return the first texel beyond the cell that `first` lies in."""
    last = first + 1
    while last < cells_u.shape[0] and cells_u[last] == cells_u[first] and cells_v[last] == cells_v[first]:
        last += 1
    return last


@inner_kernel
def _add_between(
    out: AnyArray, corners: tuple[float, float, float, float], us: AnyArray, vs: AnyArray, gain: float
) -> None:
    a, b, c, d = corners
    for col in range(out.shape[0]):
        out[col] += gain * between(a, b, c, d, us[col], vs[col])


@kernel
def add_dust(out: AnyArray, x: AnyArray, y: AnyArray, cell_m: float, gain: float, seed: np.uint64) -> None:
    """Add noise without any smoothing: finer than the texels when the cells are."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            h = hash2(math.floor(x[row, col] / cell_m), math.floor(y[row, col] / cell_m), seed)
            out[row, col] += gain * normal_of(h)


class GrainLayer(NamedTuple):
    """Grains: the cells of scattered points (Voronoi), each of its own grey.

    Attributes
    ----------
    cell_m : float
        Mean distance of the points [m].
    gain : float
        Standard deviation of the greys of grains.
    jitter : float
        How far points leave their lattice, 0 to 1.
    gap, gap_width : float
        Grey added where two grains meet, and how wide the gap is, in cells.
    shade : float
        Grey added on the side towards the light and taken off the other, at one cell's distance.
    share : float
        Share of the cells that hold a grain; in the others nothing is added.
    """

    cell_m: float
    gain: float
    jitter: float = 0.9
    gap: float = 0.0
    gap_width: float = 0.2
    shade: float = 0.0
    share: float = 1.0


@kernel
def add_grains(out: AnyArray, x: AnyArray, y: AnyArray, grains: GrainLayer, seed: np.uint64) -> None:
    """Add grains."""
    cell_m, gain, jitter, gap, gap_width, shade, share = grains
    px, py, tone = np.empty(9), np.empty(9), np.empty(9)
    last_i, last_j = -(1 << 62), 0
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            u, v = x[row, col] / cell_m, y[row, col] / cell_m
            i, j = math.floor(u), math.floor(v)
            if i != last_i or j != last_j:
                for n in range(9):
                    ni, nj = i - 1 + n % 3, j - 1 + n // 3
                    h = hash2(ni, nj, seed)
                    px[n] = ni + 0.5 + (unit_of(h) - 0.5) * jitter
                    h = mix_bits(h)
                    py[n] = nj + 0.5 + (unit_of(h) - 0.5) * jitter
                    h = mix_bits(h)
                    tone[n] = gain * normal_of(h)
                    if unit_of(mix_bits(h)) >= share:
                        tone[n] = np.nan
                last_i, last_j = i, j
            first, second, best = 1e9, 1e9, 0
            for n in range(9):
                du, dv = u - px[n], v - py[n]
                squared = du * du + dv * dv
                if squared < first:
                    first, second, best = squared, first, n
                elif squared < second:
                    second = squared
            if not math.isnan(tone[best]):
                value = tone[best] + shade * (u - px[best] - v + py[best])
                edge = (math.sqrt(second) - math.sqrt(first)) / gap_width
                out[row, col] += value if edge >= 1.0 else value * edge + gap * (1.0 - edge)


class SpeckLayer(NamedTuple):
    """Sparse round or, with unequal cells, long specks; each lies within its own cell.

    Attributes
    ----------
    cell_x_m, cell_y_m : float
        Size of a cell [m].
    share : float
        Share of the cells that hold a speck.
    gain : float
        Mean grey at the middle of a speck.
    radius : float
        Largest radius, in cells, at most 0.5; they are between a quarter of it and all of it.
    spread : float
        Standard deviation of the grey at the middle.
    """

    cell_x_m: float
    cell_y_m: float
    share: float
    gain: float
    radius: float = 0.4
    spread: float = 0.0


@kernel
def add_specks(out: AnyArray, x: AnyArray, y: AnyArray, specks: SpeckLayer, seed: np.uint64) -> None:
    """Add specks."""
    cell_x_m, cell_y_m, share, gain, radius, spread = specks
    last_i, last_j = -(1 << 62), 0
    cu = cv = r = tone = 0.0
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            u, v = x[row, col] / cell_x_m, y[row, col] / cell_y_m
            i, j = math.floor(u), math.floor(v)
            if i != last_i or j != last_j:
                h = hash2(i, j, seed)
                r = 0.0
                if unit_of(h) < share:
                    h = mix_bits(h)
                    r = radius * (0.25 + 0.75 * unit_of(h))
                    h = mix_bits(h)
                    cu = r + (1.0 - 2.0 * r) * unit_of(h)
                    h = mix_bits(h)
                    cv = r + (1.0 - 2.0 * r) * unit_of(h)
                    tone = gain + spread * normal_of(mix_bits(h))
                last_i, last_j = i, j
            if r > 0.0:
                du, dv = (u - i - cu) / r, (v - j - cv) / r
                squared = du * du + dv * dv
                if squared < 1.0:
                    out[row, col] += tone * (1.0 - squared * squared)


@kernel
def add_joints(
    out: AnyArray, x: AnyArray, y: AnyArray, edge: AnyArray, width_m: float, gain: float, seed: np.uint64
) -> None:
    """Add grey within `width_m` of an edge whose distances are given, with a ragged rim."""
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            if edge[row, col] < 1.5 * width_m:
                ragged = normal_of(hash2(math.floor(x[row, col] / width_m), math.floor(y[row, col] / width_m), seed))
                depth = 1.25 - edge[row, col] / width_m + 0.15 * ragged
                out[row, col] += gain * min(1.0, max(0.0, depth))


@kernel
def split_planks(
    out: AnyArray,
    x: AnyArray,
    y: AnyArray,
    edge: AnyArray,
    length_m: float,
    width_m: float,
    shift: float,
    gain: float,
    seed: np.uint64,
) -> None:
    """Cut the floor into rows of planks or stones along x: give each its grey and its own piece of the noise.

    Parameters
    ----------
    x, y : (N, N) float64
        Coordinates; every plank's are moved by a distance of its own, so that its grain is its own.
    edge : (N, N) float64
        Receives the distance to the nearest edge [m].
    length_m, width_m : float
        Size of a plank [m].
    shift : float
        How far each row is shifted along the one before, in lengths; negative: at random.
    gain : float
        Standard deviation of the greys of planks.
    """
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            v = y[row, col] / width_m
            j = math.floor(v)
            offset = shift * j if shift >= 0.0 else unit_of(hash2(j, 1, seed))
            u = x[row, col] / length_m + offset
            i = math.floor(u)
            h = hash2(i, j, seed)
            along, across = (u - i) * length_m, (v - j) * width_m
            edge[row, col] = min(min(along, length_m - along), min(across, width_m - across))
            out[row, col] += gain * normal_of(h)
            h = mix_bits(h)
            x[row, col] += 1000.0 * math.floor(1000.0 * unit_of(h))
            y[row, col] += 1000.0 * math.floor(1000.0 * unit_of(mix_bits(h)))
