"""Where in the picture reference pixels are tracked, and which shifts are searched when nothing is known."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from trailmark.errors import ConfigError
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.extremes import Area

__all__ = ["margin_px", "max_shift_px", "tracking_areas", "wide_shifts"]

#: The picture that the paper's figures are for: height less its rim, and D with and without overlapping areas.
_PAPER_ROWS, _PAPER_DISTANCE, _DISJOINT_DISTANCE = 352, 128, 192

#: The paper's range of predicted shifts and rim [px], the shorter side of its picture [px], and the range that a second
#: opinion allows, of the shorter side.
_PAPER_SHIFT_PX, _PAPER_MARGIN_PX, _PAPER_SIDE_PX, _LONGEST_SHIFT = 36, 64, 480, 0.35


def tracking_areas(config: GroundVOConfig, size: tuple[int, int]) -> tuple[tuple[Area, Area], int]:
    """Return the two tracking areas, the lower one first, and D, the distance of their centres [px].

    Raises
    ------
    ConfigError
        If the picture is too small for them, or the rim too narrow for the search.
    """
    width, height = size
    margin = margin_px(config, size)
    rows = height - 2 * margin
    paper_px = _PAPER_DISTANCE if config.mode == "whole_pixels" else _DISJOINT_DISTANCE
    distance_px = config.centre_distance_px or round(rows * paper_px / _PAPER_ROWS)
    high = rows - distance_px
    if width - 2 * margin < 32 or high < 16:
        raise ConfigError(
            f"pictures of {width} x {height} are too small for a rim of {margin} px (margin_px) and viewpoints"
            f" {distance_px} px apart (centre_distance_px): each tracking area needs 32 x 16 px"
        )
    turned_px = _most_turn_rad(config) * (width / 2 - margin)
    shift_px = max_shift_px(config, size)
    needed = math.ceil(shift_px + config.search_px + turned_px)
    if margin < needed:
        raise ConfigError(
            f"margin_px is {margin}, but shifts of {shift_px} + {config.search_px} px and turns of"
            f" {config.rotation_steps} x {config.rotation_step_deg:.3g} deg reach {needed} px"
        )
    upper: Area = (margin, margin, width - margin, margin + high)
    lower: Area = (margin, margin + distance_px, width - margin, margin + distance_px + high)
    return (lower, upper), distance_px


def max_shift_px(config: GroundVOConfig, size: tuple[int, int], *, is_guarded: bool = False) -> int:
    """Return the largest predicted shift in a picture (width, height) [px]; longer where the refinement is guarded."""
    if config.max_shift_px is not None:
        return config.max_shift_px
    return round(_LONGEST_SHIFT * min(size)) if is_guarded else _length_in_picture(_PAPER_SHIFT_PX, config, size)


def margin_px(config: GroundVOConfig, size: tuple[int, int]) -> int:
    """Return the rim without reference pixels in a picture (width, height): no less than the search reaches [px]."""
    if config.margin_px is not None:
        return config.margin_px
    scaled_px = _length_in_picture(_PAPER_MARGIN_PX, config, size)
    if config.mode != "refined":
        return scaled_px
    turn_rad = _most_turn_rad(config)
    reach_px = max_shift_px(config, size) + config.search_px
    return max(scaled_px, math.ceil((reach_px + turn_rad * size[0] / 2) / (1.0 + turn_rad)))


def _most_turn_rad(config: GroundVOConfig) -> float:
    return math.radians(config.rotation_steps * config.rotation_step_deg)


def _length_in_picture(paper_px: int, config: GroundVOConfig, size: tuple[int, int]) -> int:
    """Return a length of the paper's picture in one of another size; as printed in the other modes."""
    return round(paper_px * min(size) / _PAPER_SIDE_PX) if config.mode == "refined" else paper_px


def wide_shifts(config: GroundVOConfig, size: tuple[int, int]) -> list[tuple[float, float]]:
    """Return predictions whose searches together cover the shifts of the paper, the small ones first."""
    limit = min(_length_in_picture(_PAPER_SHIFT_PX, config, size), max_shift_px(config, size))
    count = math.ceil(limit / config.search_px) + 1
    along = [float(round(shift)) for shift in np.linspace(-limit, limit, count)]
    return sorted(product(along, along), key=lambda shift: shift[0] ** 2 + shift[1] ** 2)
