"""Lenses that stand in files beside a recording."""

from __future__ import annotations

from pathlib import Path

from trailmark.errors import ShapeError, SourceError
from trailmark.frames import Pinhole
from trailmark_datasets.textfiles import lines_of, number

__all__ = ["lens_of_size", "read_camera", "read_matrix"]


def read_camera(path: Path) -> tuple[Pinhole | None, float | None]:
    """Read ``fx fy cx cy [distortion]`` and, on a second line, the depth values per metre; None for what is not there.

    Raises
    ------
    SourceError
        If something else stands there.
    """
    if not path.exists():
        return None, None
    lines = [(f"{path}:{line}", text.replace(",", " ").split()) for line, text in lines_of(path)]
    if not lines or len(lines[0][1]) < 4:
        raise SourceError(f"{path}: expected fx fy cx cy, then distortion (4, 5 or 8 numbers) or nothing")
    where, fields = lines[0]
    fx, fy, cx, cy, *distortion = (number(field, "a lens parameter", where) for field in fields)
    try:
        lens = Pinhole(fx, fy, cx, cy, tuple(distortion))
    except ShapeError as error:
        raise SourceError(f"{where}: {error}") from error
    if len(lines) == 1:
        return lens, None
    if len(lines[1][1]) != 1:
        raise SourceError(f"{lines[1][0]}: expected the depth values per metre alone, found {len(lines[1][1])} numbers")
    factor = number(lines[1][1][0], "the depth factor", lines[1][0])
    if factor <= 0:
        raise SourceError(f"{lines[1][0]}: the depth factor must be positive, not {factor}")
    return lens, factor


def read_matrix(path: Path) -> Pinhole:
    """Read the matrix of a camera, (3, 3) or (4, 4), row by row.

    Raises
    ------
    SourceError
        If something else stands there.
    """
    words = [word for _, text in lines_of(path) for word in text.replace(",", " ").split()]
    if len(words) not in (9, 16):
        raise SourceError(f"{path}: expected the 9 or 16 numbers of a camera's matrix, found {len(words)}")
    numbers = [number(word, "a number of the matrix", str(path)) for word in words]
    width = 3 if len(words) == 9 else 4
    if numbers[width] or any(numbers[2 * width : 2 * width + 2]) or numbers[2 * width + 2] != 1.0:
        raise SourceError(f"{path}: expected rows fx 0 cx, 0 fy cy, 0 0 1; is the matrix written column by column?")
    try:
        return Pinhole(numbers[0], numbers[width + 1], numbers[2], numbers[width + 2])
    except ShapeError as error:
        raise SourceError(f"{path}: {error}") from error


def lens_of_size(lens: Pinhole, size: tuple[int, ...], other: tuple[int, ...]) -> Pinhole:
    """Return the lens of a picture that shows the same in more or fewer pixels: rows and columns of both are told."""
    down, across = other[0] / size[0], other[1] / size[1]
    return Pinhole(
        lens.fx * across, lens.fy * down, (lens.cx + 0.5) * across - 0.5, (lens.cy + 0.5) * down - 0.5, lens.distortion
    )
