"""Configs of the two localizers for a downward camera."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["GroundVOConfig"]


class GroundVOConfig(PluginConfig):
    """Relative search between consecutive pictures of the ground (Nagai & Watanabe 2015, Sec. II-A)."""

    camera: Sensor["image"]
    """The downward camera."""
    mode: Literal["refined", "pyramid", "paper"] = "refined"
    """paper: whole pixels, as printed; pyramid: the same search in two levels; refined: to a hundredth of a pixel."""
    n_pixels: int = Field(768, ge=16, multiple_of=2)
    """Reference pixels of each of the two groups (paper: 768)."""
    search_px: int = Field(8, ge=2, le=32)
    """Range of the search around the predicted shift, to all sides (paper: 8) [px]."""
    rotation_steps: int = Field(5, ge=1, le=64)
    """Steps of the rotational search to either side (paper: 5)."""
    rotation_step_deg: float = Field(math.degrees(1 / 128), gt=0, le=5)
    """Step of the rotational search; 1/128 rad, the paper's 0.448 deg [deg]."""
    max_shift_px: int = Field(36, ge=0)
    """Largest predicted shift per picture (paper: 36) [px]."""
    margin_px: int = Field(64, ge=8)
    """Rim of the picture without reference pixels, so that none is lost while searching [px]."""
    centre_distance_px: int | None = Field(None, ge=8)
    """D of Eq. (3), the distance of the two viewpoints; left out: 128 in mode paper, where the tracking areas
    overlap as in Fig. 1, 192 else, where they do not [px, for a picture 480 px high]."""
    wide_search: bool = True
    """Search the whole range of shifts when nothing is known of the motion: at the start and when the track is lost."""
    max_error_ratio: float = Field(0.8, gt=0, le=1)
    """Lost when the least error is more than this share of the mean over all candidates."""
    max_error_growth: float = Field(3.0, gt=1)
    """Lost when the least error is this many times what it has been."""
    patience_frames: int = Field(2, ge=0)
    """Pictures that may miss in a row before the last of them is what the next ones are compared with."""
    n_segments: int = Field(8, ge=1, le=64)
    """Refinement: segments of each vertical line that give two pixels each."""
    line_step_px: int = Field(2, ge=1, le=64)
    """Refinement: every this many vertical lines give pixels [px]."""
    memory_frames: int = Field(10, ge=1, le=255)
    """Refinement: pictures that a remembered pixel is averaged over at most; 1 keeps the first."""
    huber_levels: float = Field(8.0, gt=0)
    """Refinement: residual beyond which a pixel counts less (Huber) [grey levels]."""
    max_iterations: int = Field(8, ge=1, le=50)
    """Refinement: steps at most."""
    use_vectors: bool = True
    """Use the vector kernels; false takes the plain ones, which give the same bits, slower."""
