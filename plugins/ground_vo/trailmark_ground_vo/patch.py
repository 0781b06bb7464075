"""Registering a patch of the ground, and finding it again: Sec. II-B of Nagai & Watanabe (2015)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Floats, Grey8, Int32s
from trailmark.errors import ConfigError
from trailmark_ground_vo.absolute import group_places, quadrants
from trailmark_ground_vo.alignment import SmoothPicture, align_patch
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.kernels import Kernels, load_kernels
from trailmark_ground_vo.levels import foreign_pixels, half_picture, levelled, seven_bits, tamed
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.search import centre_out, rotation_angles, summarise
from trailmark_ground_vo.uncertainty import turn_information

__all__ = ["PatchFinder", "PatchMatch", "PatchView"]

Bits7 = npt.NDArray[np.int8]

#: The picture and its patches at half the resolution of the camera.
_HALF = 2.0

#: Standard deviation of a match that is not refined: rounding to a pixel and to two steps of the rotation.
_ROUNDING = 1.0 / math.sqrt(12.0)

#: A place is believed whose turn is known within so many times what headings must be known to, to be told: other ground
#: that fits by chance tells it less well.
_MOST_TURN = 3.0

#: Smoothing carries dirt so far.
_RIM = np.ones((3, 3), np.uint8)

#: Share of a group that has to be ground for it to tell its place.
_LEAST_GROUND = 0.4

#: Range of the fine search after the coarse one of the pyramid, in pixels of the half-size picture.
_FINE_PX = 4


@dataclass(frozen=True, slots=True, eq=False)
class PatchMatch:
    """What a search for a patch gave.

    Attributes
    ----------
    motion : ImageMotion
        From the picture in which the patch was registered to this one, about the middle, in full-size pixels.
    information : (3, 3) float64
        Of (u, v, turn).
    n_agreeing : int
        Groups that agree, of four.
    error_ratio : float
        Least error over mean error of the search.
    correlation : float
        Of the patch with the place.
    shift_px : float
        How far from where it was expected [full-size px].
    reason : str
        Why it is not to be believed; empty when it is.
    """

    motion: ImageMotion
    information: Floats
    n_agreeing: int
    error_ratio: float
    correlation: float
    shift_px: float
    reason: str = ""

    @property
    def details(self) -> Mapping[str, float]:
        """The figures that are recorded beside an estimate."""
        return {
            "agreeing": float(self.n_agreeing),
            "error_ratio": self.error_ratio,
            "correlation": self.correlation,
            "shift_px": self.shift_px,
        }


class PatchView:
    """A picture in the forms that the search for patches reads, made when asked for.

    Parameters
    ----------
    levels : (H, W) uint8
        The half-size picture.
    is_levelled : bool
        Whether it is high-passed.
    kernels : Kernels
        The build to use.
    """

    def __init__(self, levels: Grey8, is_levelled: bool, kernels: Kernels) -> None:
        self.levels = levels
        self.is_levelled = is_levelled
        self._kernels = kernels

    @cached_property
    def bits(self) -> tuple[Bits7, Bits7]:
        """The picture in seven bits and its transpose."""
        return self._with_transpose(seven_bits(self.levels, self.is_levelled))

    @cached_property
    def coarse_bits(self) -> tuple[Bits7, Bits7]:
        """The same at half that resolution."""
        return self._with_transpose(_halve_bits(self.bits[0]))

    @cached_property
    def smooth(self) -> SmoothPicture:
        """The smoothed picture, for the refinement."""
        return self.smooth_levels(self.levels)

    def smooth_levels(self, levels: Grey8) -> SmoothPicture:
        """Return a picture of this kind, or a part of one, as the refinement compares it."""
        if not self.is_levelled:
            return SmoothPicture(self._kernels.smooth(levels), self.ground_of(levels))
        near_dirt = cv2.dilate(foreign_pixels(levels).astype(np.uint8), _RIM)
        return SmoothPicture(self._kernels.smooth(tamed(levels)), near_dirt == 0)

    def ground_of(self, levels: Grey8) -> Bools:
        """Return which pixels of a picture of this kind, or of a part of one, are ground."""
        return ~foreign_pixels(levels) if self.is_levelled else np.ones(levels.shape, np.bool_)

    def _with_transpose(self, bits: Bits7) -> tuple[Bits7, Bits7]:
        return bits, self._kernels.transpose(bits.view(np.uint8)).view(np.int8)


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """A quadrant of a patch: the pixels that are ground.

    Attributes
    ----------
    values : (1, N) int8
        In seven bits.
    u, v : (1, N) float64
        From the middle of the patch [px].
    tells : bool
        They are enough to tell a place.
    """

    values: Bits7
    u: Floats
    v: Floats
    tells: bool


def _groups_of(bits: Bits7, is_ground: Bools) -> list[_Group]:
    parts = zip(quadrants(bits), *_offsets(len(bits)), quadrants(is_ground), strict=True)
    return [
        _Group(values[None, counts], us[None, counts], vs[None, counts], bool(counts.mean() >= _LEAST_GROUND))
        for values, us, vs, counts in parts
    ]


def _halve_bits(bits: Bits7) -> Bits7:
    return half_picture(bits.view(np.uint8)).view(np.int8)


class PatchFinder:
    """Takes patches out of pictures and finds them again.

    Parameters
    ----------
    config : GroundMapConfig
        Parameters of the paper, and of what was added.
    size : (int, int)
        Width and height of the full-size picture [px].
    aspect : float
        Metres per pixel along v over those along u.

    Raises
    ------
    ConfigError
        If the picture is too small for patch and search.
    """

    def __init__(self, config: GroundMapConfig, size: tuple[int, int], aspect: float = 1.0) -> None:
        self._config = config
        self._aspect = aspect
        self._kernels = load_kernels(config.use_vectors)
        self._size = (size[0] // 2, size[1] // 2)
        self._middle = ((self._size[0] - 1) / 2.0, (self._size[1] - 1) / 2.0)
        step_rad = math.radians(config.rotation_step_deg)
        self._angles = rotation_angles(config.rotation_steps, step_rad)
        self._step_rad = step_rad
        needed = 2 * (config.search_px + math.ceil(config.patch_px / math.sqrt(2.0)) + 1)
        if min(self._size) < needed:
            raise ConfigError(
                f"pictures of {size[0]} x {size[1]} are too small for patches of {config.patch_px} px (patch_px) and"
                f" a search of +-{config.search_px} px (search_px): each side needs {2 * needed} px"
            )
        #: Farthest shift of a patch from the middle that can be searched around [half-size px].
        self._farthest_px = min(self._size) / 2.0 - needed / 2.0

    def view(self, image: Grey8) -> PatchView:
        """Return a full-size picture in the forms that are registered and searched."""
        half = half_picture(image)
        return PatchView(levelled(half) if self._config.high_pass else half, self._config.high_pass, self._kernels)

    def register(self, view: PatchView) -> Grey8:
        """Return the patch in the middle of a picture, (44, 44) uint8: 1936 bytes."""
        side = self._config.patch_px
        left, top = (self._size[0] - side) // 2, (self._size[1] - side) // 2
        return view.levels[top : top + side, left : left + side].copy()

    def is_in_reach(self, expected: ImageMotion) -> bool:
        """Return whether a patch that is expected after this motion can be searched for in the picture."""
        shift = max(abs(expected.u), abs(expected.v)) / _HALF
        return shift <= self._farthest_px + self._config.search_px and abs(expected.turn_rad) <= self._angles[-1]

    def is_in_view(self, expected: ImageMotion) -> bool:
        """Return whether a patch that is expected after this motion is whole in the picture, and would be found."""
        shift = max(abs(expected.u), abs(expected.v))
        return shift <= self.view_px and abs(expected.turn_rad) <= self._angles[-1] - self._step_rad

    @property
    def view_px(self) -> float:
        """How far from the middle of the picture a patch may lie to be found for certain [full-size px]."""
        return _HALF * (self._farthest_px + self._config.search_px - self._config.weak_shift_px)

    def fits(self, found: PatchMatch) -> bool:
        """Return whether a patch may be where it was found, however far from where it was expected."""
        is_alike = found.correlation >= self._config.min_correlation
        return found.n_agreeing >= self._config.min_groups and is_alike and self._tells_turn(found)

    def confirms(self, found: PatchMatch) -> bool:
        """Return whether a patch was found, and where it was expected."""
        return self.fits(found) and found.shift_px <= _HALF * self._config.weak_shift_px

    def find(self, view: PatchView, patch: Grey8, expected: ImageMotion) -> PatchMatch:
        """Search for a patch around the motion that is expected since it was registered."""
        limit = self._farthest_px
        shift = [float(round(min(max(part / _HALF, -limit), limit))) for part in (expected.u, expected.v)]
        search = self._search_pyramid if self._config.search == "pyramid" else self._search_all
        motion, agreeing, ratio = search(view, patch, (shift[0], shift[1]), expected.turn_rad)
        groups = agreeing if agreeing.any() else ~agreeing
        aligned = align_patch(view.smooth, view.smooth_levels(patch), self._middle, motion, self._aspect, groups)
        if self._config.refined:
            motion, information = aligned.motion, aligned.information
        else:
            information = np.diag([1.0 / _ROUNDING**2, 1.0 / _ROUNDING**2, 1.0 / self._step_rad**2])
        full = ImageMotion(_HALF * motion.u, _HALF * motion.v, motion.turn_rad)
        information = information / np.outer([_HALF, _HALF, 1.0], [_HALF, _HALF, 1.0])
        shift_px = math.hypot(full.u - expected.u, full.v - expected.v)
        found = PatchMatch(full, information, int(np.count_nonzero(agreeing)), ratio, aligned.correlation, shift_px)
        return replace(found, reason=self._reason_rejected(found))

    def _reason_rejected(self, found: PatchMatch) -> str:
        if found.n_agreeing < self._config.min_groups:
            return f"only {found.n_agreeing} of 4 groups agree (covered or changed ground)"
        if found.n_agreeing < 4 and found.shift_px > _HALF * self._config.weak_shift_px:
            place = f"a place {found.shift_px:.0f} px off"
            return f"{found.n_agreeing} of 4 groups agree on {place} (covered or changed ground)"
        if found.correlation < self._config.min_correlation:
            return f"correlation {found.correlation:.2f} is too low (covered or changed ground)"
        if not self._tells_turn(found):
            return "too little fits to tell how it is turned (covered or changed ground)"
        return ""

    def _tells_turn(self, found: PatchMatch) -> bool:
        most_rad = _MOST_TURN * math.radians(self._config.heading_sigma_deg)
        return not self._config.refined or turn_information(found.information) >= 1.0 / most_rad**2

    def _search_all(
        self, view: PatchView, patch: Grey8, shift: tuple[float, float], turn_rad: float
    ) -> tuple[ImageMotion, Bools, float]:
        """Evaluate Eq. (1) for every candidate and every group."""
        groups = _groups_of(seven_bits(patch, view.is_levelled), view.ground_of(patch))
        errors = self._errors(view.bits, groups, shift, turn_rad + self._angles, self._config.search_px)
        motion, agreeing, ratio = self._consensus(errors, shift, turn_rad + self._angles, self._config.tolerance_px)
        return motion, agreeing & [group.tells for group in groups], ratio

    def _search_pyramid(
        self, view: PatchView, patch: Grey8, shift: tuple[float, float], turn_rad: float
    ) -> tuple[ImageMotion, Bools, float]:
        """Decide at quarter size, with every second turn, and look closer only there."""
        bits, angles = seven_bits(patch, view.is_levelled), (turn_rad + self._angles)[::2].copy()
        half_shift = (shift[0] / 2.0, shift[1] / 2.0)
        coarse_px = -(-self._config.search_px // 2)
        is_ground = view.ground_of(patch)
        groups = _groups_of(bits, is_ground)
        all_ground = np.asarray(is_ground.reshape(len(bits) // 2, 2, -1, 2).all(axis=(1, 3)), np.bool_)
        halved = _groups_of(_halve_bits(bits), all_ground)
        errors = self._errors(view.coarse_bits, halved, half_shift, angles, coarse_px)
        tolerance_px = max(1.0, self._config.tolerance_px / 2.0)
        coarse, agreeing, ratio = self._consensus(errors, half_shift, angles, tolerance_px)
        near = (float(round(2.0 * coarse.u)), float(round(2.0 * coarse.v)))
        around = coarse.turn_rad + rotation_angles(1, self._step_rad)
        fine = self._errors(view.bits, groups, near, around, _FINE_PX)
        motion, _, _ = self._consensus(fine, near, around, self._config.tolerance_px)
        # a group without a coarse pixel fits everywhere, and says that it agrees
        tells = [fully.tells and coarsely.tells for fully, coarsely in zip(groups, halved, strict=True)]
        return motion, agreeing & tells, ratio

    def _errors(
        self,
        bits: tuple[Bits7, Bits7],
        groups: list[_Group],
        shift: tuple[float, float],
        angles: Floats,
        shift_px: int,
    ) -> Int32s:
        height, width = bits[0].shape
        centre = ((width - 1) / 2.0 + shift[0], (height - 1) / 2.0 + shift[1])
        limits = (shift_px, width - 2 - shift_px, shift_px, height - 2 - shift_px)
        search, errors = self._kernels.patch_search(shift_px), []
        for group in groups:
            spots = group_places(group.u, group.v, centre, angles, self._aspect, limits)
            errors.append(search(*bits, spots, group.values))
        return np.concatenate(errors)

    def _consensus(
        self,
        errors: Int32s,
        shift: tuple[float, float],
        angles: Floats,
        tolerance_px: float,
    ) -> tuple[ImageMotion, Bools, float]:
        """Return the place of the whole patch, which groups agree, and least error over mean error."""
        _, n_angles, size, _ = errors.shape
        ranks = centre_out(n_angles, size)
        k, j, i, least, mean = summarise(errors.sum(axis=0, dtype=np.int32), ranks)
        own = np.array([summarise(group, ranks)[1:3] for group in errors])
        agreeing = np.max(np.abs(own - (j, i)), axis=1) <= tolerance_px
        motion = ImageMotion(shift[0] + i - size // 2, shift[1] + j - size // 2, float(angles[k]))
        return motion, agreeing, least / mean if mean > 0.0 else 1.0


@lru_cache
def _offsets(side: int) -> tuple[Floats, Floats]:
    """Return how far the pixels of a patch are from its middle, along u and v, by quadrants, (4, N) each [px]."""
    v, u = np.asarray(np.mgrid[:side, :side] - (side - 1) / 2.0, np.float64)
    return quadrants(u), quadrants(v)
