"""One tracking area with its group of reference pixels: where it is searched for and how it moves along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats, Grey8, Grey16, Indices, Int32s
from trailmark_ground_vo.extremes import Area, Group, advance, select
from trailmark_ground_vo.kernels import Kernels
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.search import centre_out, places, reach, rotation_angles, summarise
from trailmark_ground_vo.uncertainty import response_covariance
from trailmark_ground_vo.witness import Spectrum

__all__ = ["GroupMatch", "SearchPicture", "SearchRange", "Viewpoint"]


@dataclass(frozen=True, slots=True, eq=False)
class SearchPicture:
    """A picture in the forms that the search reads.

    Attributes
    ----------
    image, image_t : (H, W) and (W, H) uint8
        The picture and its transpose.
    half, half_t : (H / 2, W / 2) and (W / 2, H / 2) uint8, or None
        The same at half the resolution, where the pyramid needs it.
    smoothed : (H, W) uint16, or None
        The picture smoothed (see `filters.smooth`), where the refinement needs it.
    noise : float or None
        Standard deviation of its noise before it was smoothed, where `image` is smoothed [grey levels].
    spectrum : (H / 4, W / 8 + 1) complex64, or None
        What the second opinion compares (see `witness`), where there is one.
    unmasked : (H, W) uint8, or None
        `image` with what is fixed to the lens, where `image` has none of that.
    """

    image: Grey8
    image_t: Grey8
    half: Grey8 | None = None
    half_t: Grey8 | None = None
    smoothed: Grey16 | None = None
    noise: float | None = None
    spectrum: Spectrum | None = None
    unmasked: Grey8 | None = None


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The candidates of a search.

    Attributes
    ----------
    shift_px : int
        Shifts along u and v go from ``-shift_px`` to ``shift_px`` [px].
    steps : int
        Turns go from ``-steps`` to ``steps`` times `step_rad`.
    step_rad : float
        Angle between two candidates [rad].
    """

    shift_px: int
    steps: int
    step_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class GroupMatch:
    """Where a group was found.

    Attributes
    ----------
    motion : ImageMotion
        About the centre of the area; the shift is prediction plus search, v = p + (i, j).
    error, mean_error : float
        Least absolute difference, and the mean over all candidates, per pixel [grey levels].
    covariance : (2, 2) float64
        Of the shift [px^2].
    """

    motion: ImageMotion
    error: float
    mean_error: float
    covariance: Floats

    @property
    def ratio(self) -> float:
        """Least error over mean error: near 0 for a sharp match, near 1 for none."""
        return self.error / self.mean_error if self.mean_error > 0.0 else 1.0


class Viewpoint:
    """A tracking area and its group.

    Parameters
    ----------
    area : Area
        Where in the picture its pixels are chosen.
    search : SearchRange
        Candidates of the search.
    aspect : float
        Metres per pixel along v over those along u.
    kernels : Kernels
        Compiled kernels, with vectors or without.
    """

    def __init__(self, area: Area, search: SearchRange, aspect: float, kernels: Kernels) -> None:
        self.area = area
        self.centre = ((area[0] + area[2] - 1) / 2.0, (area[1] + area[3] - 1) / 2.0)
        self._shift_px = search.shift_px
        self._step_rad = search.step_rad
        self._angles = rotation_angles(search.steps, search.step_rad)
        # a candidate reads this far around a pixel; up to this shift no pixel of the area leaves the picture
        turned_px = abs(self._angles[-1]) * (area[2] - area[0]) / 2.0
        self._rim_px = reach(search.shift_px) + turned_px
        self._near_px = min(area[0], area[1]) - search.shift_px - turned_px
        self._aspect = aspect
        self._kernels = kernels
        self._group: Group
        self._half_values: Grey8
        self._n_compared = 0

    def begin(self, picture: SearchPicture, n_pixels: int) -> None:
        """Choose the reference pixels in a picture."""
        self._group = Group(*select(picture.image, self.area, n_pixels))
        if picture.half is not None:
            rows, columns = _half_indices(self._group.y, picture.half, 0), _half_indices(self._group.x, picture.half, 1)
            self._half_values = picture.half[rows, columns]

    def find(self, picture: SearchPicture, shift: tuple[float, float], turn_rad: float = 0.0) -> GroupMatch:
        """Search all candidates around a predicted shift and turn, Eqs. (1) and (2)."""
        values, angles = self._group.values, self._angles + turn_rad
        errors = self._errors(picture.image, picture.image_t, values, shift, angles, self._shift_px, 1)
        return self._match(errors, shift, angles)

    def find_in_pyramid(self, picture: SearchPicture, shift: tuple[float, float]) -> GroupMatch:
        """Search at half resolution with every second turn, then finely around what was found."""
        assert picture.half is not None
        assert picture.half_t is not None
        angles, coarse_px = self._angles[::2].copy(), -(-self._shift_px // 2)
        errors = self._errors(picture.half, picture.half_t, self._half_values, shift, angles, coarse_px, 2)
        k, j, i, _, mean = summarise(errors, centre_out(errors.shape[0], errors.shape[1]))
        near = (shift[0] + 2 * (i - coarse_px), shift[1] + 2 * (j - coarse_px))
        around = angles[k] + rotation_angles(1, self._step_rad)
        fine = self._errors(picture.image, picture.image_t, self._group.values, near, around, 2, 1)
        return self._match(fine, near, around, mean)

    def advance(self, picture: SearchPicture, motion: ImageMotion, grid: float) -> float:
        """Move the group with the picture; returns the share of pixels that jumped."""
        moved = (motion.u, motion.v, motion.turn_rad)
        x, y, values, fresh = advance(picture.image, *self._group, self.area, self.centre, moved, self._aspect, grid)
        self._group = Group(x, y, values, self._group.brightest)
        if picture.half is not None:
            rows, columns = _half_indices(self._group.y, picture.half, 0), _half_indices(self._group.x, picture.half, 1)
            self._half_values = np.where(fresh, picture.half[rows, columns], self._half_values)
        return float(np.count_nonzero(fresh)) / len(fresh)

    def _errors(
        self,
        image: Grey8,
        image_t: Grey8,
        values: Grey8,
        shift: tuple[float, float],
        angles: Floats,
        shift_px: int,
        scale: int,
    ) -> Int32s:
        height, width = image.shape
        limits = (shift_px, width - 1 - reach(shift_px), shift_px, height - 1 - reach(shift_px))
        x, y, centre = self._group.x, self._group.y, self.centre
        if max(abs(shift[0]), abs(shift[1])) > self._near_px and scale == 1:
            x, y, values = self._in_picture(shift, values, (width, height))
        if scale != 1:  # the middle of a block of 2 x 2 pixels
            x, y = (x - 0.5) / scale, (y - 0.5) / scale
            centre = ((centre[0] - 0.5) / scale, (centre[1] - 0.5) / scale)
        self._n_compared = len(x)
        spots = places(x, y, centre, (shift[0] / scale, shift[1] / scale), angles, self._aspect, limits)
        return self._kernels.sad_search(shift_px)(image, image_t, spots, values)

    def _in_picture(
        self, shift: tuple[float, float], values: Grey8, size: tuple[int, int]
    ) -> tuple[Floats, Floats, Grey8]:
        """Return the pixels that a long shift leaves in the picture, whatever the turn and the candidate."""
        u, v, rim_px = self._group.x + shift[0], self._group.y + shift[1], self._rim_px
        inside = (u >= rim_px) & (u < size[0] - rim_px) & (v >= rim_px) & (v < size[1] - rim_px)
        return self._group.x[inside], self._group.y[inside], values[inside]

    def _match(
        self, errors: Int32s, shift: tuple[float, float], angles: Floats, mean: float | None = None
    ) -> GroupMatch:
        n_pixels, shift_px = max(1, self._n_compared), errors.shape[1] // 2
        k, j, i, best, own_mean = summarise(errors, centre_out(errors.shape[0], errors.shape[1]))
        motion = ImageMotion(shift[0] + i - shift_px, shift[1] + j - shift_px, float(angles[k]))
        covariance = response_covariance(errors, best, n_pixels)
        return GroupMatch(motion, best / n_pixels, (own_mean if mean is None else mean) / n_pixels, covariance)


def _half_indices(coordinates: Floats, half: Grey8, axis: int) -> Indices:
    nearest = np.floor(coordinates / 2.0 + 0.25).astype(np.intp)  # (x - 0.5) / 2, rounded
    return np.clip(nearest, 0, half.shape[axis] - 1)
