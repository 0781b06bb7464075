"""Configs of the two localizers for a downward camera."""

from __future__ import annotations

import logging
import math
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from trailmark.config import PresetConfig, PresetValue, Sensor

__all__ = ["GroundMapConfig", "GroundVOConfig"]

logger = logging.getLogger(__name__)

_STEP_DEG = math.degrees(1 / 128)


class GroundVOConfig(PresetConfig):
    """Relative search between consecutive pictures of the ground (Nagai & Watanabe 2015, Sec. II-A)."""

    presets: ClassVar = {
        "paper": {
            "mode": PresetValue("whole_pixels", "Sec. II-A: integer coordinates and 9.7 fixed point"),
            "n_pixels": PresetValue(768, "Sec. II-A: N_1 and N_2"),
            "search_px": PresetValue(8, "Sec. II-A: i and j"),
            "rotation_steps": PresetValue(5, "Sec. II-A: k"),
            "rotation_step_deg": PresetValue(_STEP_DEG, "Sec. II-A: 0.448 deg, the least sine in 7 bits"),
            "max_shift_px": PresetValue(36, "Sec. II-A: the largest p"),
            "margin_px": PresetValue(64, "Fig. 1"),
            "wide_search": PresetValue(False, "Sec. II-A: it looks where the last motion leads, and nowhere else"),
            "max_error_ratio": PresetValue(1.0, "Sec. II-A: the least error is the answer, whatever it is"),
            "max_error_growth": PresetValue(1e6, "the same"),
        }
    }

    preset: Literal["paper"] | None = None
    """The relative search as printed; what is written beside it wins."""
    camera: Sensor["image"]
    """The downward camera."""
    mode: Literal["refined", "pyramid", "whole_pixels"] = "refined"
    """whole_pixels: as the paper; pyramid: the same search in two levels; refined: to a hundredth of a pixel.
    (It was called `paper`; `preset: paper` is all that the paper prints.)"""
    n_pixels: int = Field(768, ge=16, multiple_of=2)
    """Reference pixels of each of the two groups (paper: 768)."""
    search_px: int = Field(8, ge=2, le=32)
    """Range of the search around the predicted shift, to all sides (paper: 8) [px]."""
    rotation_steps: int = Field(5, ge=1, le=64)
    """Steps of the rotational search to either side (paper: 5)."""
    rotation_step_deg: float = Field(_STEP_DEG, gt=0, le=5)
    """Step of the rotational search; 1/128 rad, the paper's 0.448 deg [deg]."""
    max_shift_px: int | None = Field(None, ge=0)
    """Largest predicted shift per picture; left out: 36 as in the paper, in mode refined as much of the picture's
    shorter side, and 0.35 of that where a second opinion says where to look. Given, it has to fit into the rim [px]."""
    margin_px: int | None = Field(None, ge=8)
    """Rim of the picture without reference pixels, so that none is lost while searching; left out: 64 as in the paper,
    and in mode refined as much in a picture of another size as in one 480 px high [px]."""
    centre_distance_px: int | None = Field(None, ge=8)
    """D of Eq. (3), the distance of the two viewpoints; left out: in a picture 480 px high 128 in mode
    whole_pixels, where the tracking areas overlap as in Fig. 1, and 192 else, where they do not [px]."""
    wide_search: bool = True
    """Search the whole range of shifts when nothing is known of the motion: at the start and when the track is lost."""
    max_error_ratio: float = Field(0.8, gt=0, le=1)
    """Lost when the least error is more than this share of the mean over all candidates."""
    max_error_share: float = Field(0.25, gt=0, le=1)
    """Lost, where the search looks at the smoothed picture, when the least error is more than this share of the mean
    and more than the noise of the picture explains: coarse grain fits to itself elsewhere; 1: noise is not asked."""
    max_error_growth: float = Field(3.0, gt=1)
    """Lost when the least error is this many times what it has been."""
    patience_frames: int = Field(2, ge=0)
    """Pictures that may miss in a row before the last of them is what the next ones are compared with."""
    smooth_search: bool | None = None
    """Refined mode: search on the picture smoothed with 1 4 6 4 1, which the noise of the camera disturbs a third as
    much, but light that was not corrected more. Left out: as soon as the flat field is known, and wherever the guarded
    tracker decides. The other modes search on the picture as it is, as the paper."""
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
    learn_flat_field: bool | None = None
    """Refined mode: learn while driving how uneven the light is; left out: when the calibration has no flat field.
    Where the light changes, each picture is brought to even light by itself."""
    tilt_deg: float = Field(0.01, ge=0, le=10)
    """How far the camera nods and rolls while the robot drives, standard deviation: it shifts each picture, and no
    picture tells; 0: it is stiff [deg]."""
    use_vectors: bool = True
    """Use the vector kernels; false takes the plain ones, which give the same bits, slower."""

    @model_validator(mode="before")
    @classmethod
    def _rename_mode(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("mode") != "paper":
            return values
        logger.warning(
            "ground_vo: 'mode: paper' is called 'whole_pixels' now; 'preset: paper' is all that the paper prints"
        )
        return values | {"mode": "whole_pixels"}


class GroundMapConfig(PresetConfig):
    """Registration and absolute search of ground patches (Nagai & Watanabe 2015, Sec. II-B)."""

    presets: ClassVar = {
        "paper": {
            "spacing_m": PresetValue(0.05, "Sec. II-B"),
            "patch_px": PresetValue(44, "Sec. II-B: 0.18 W of the half-size picture"),
            "reach_m": PresetValue(0.025, "Sec. II-B"),
            "search_px": PresetValue(32, "Sec. II-B: 0.025 m"),
            "rotation_steps": PresetValue(15, "Sec. II-B: k"),
            "rotation_step_deg": PresetValue(_STEP_DEG, "Sec. II-A: 0.448 deg"),
            "search": PresetValue("exhaustive", "Eq. 1"),
            "high_pass": PresetValue(False, "Eq. 1: raw illuminance"),
            "refined": PresetValue(False, "Eq. 5: whole pixels"),
            "min_groups": PresetValue(4, "Sec. II-B: all four close together"),
            "min_correlation": PresetValue(-1.0, "not in the paper"),
            "heading_sigma_deg": PresetValue(90.0, "not in the paper: every heading is told"),
            "max_attempts": PresetValue(1, "Sec. II-B: one search at a registered place"),
        }
    }

    preset: Literal["paper"] | None = None
    """Registration and search as printed; what is written beside it wins."""
    camera: Sensor["image"]
    """The downward camera."""
    spacing_m: float = Field(0.05, gt=0)
    """A patch is registered every time this way has been driven (paper: 0.05) [m]."""
    patch_px: int = Field(44, ge=12, multiple_of=4)
    """Side of a patch, in pixels of the half-size picture (paper: 0.18 W, that is 44) [px]."""
    reach_m: float = Field(0.025, gt=0)
    """A patch is searched for when its place is believed to be this near (paper: 0.025) [m]."""
    search_px: int = Field(32, ge=4, le=64)
    """Range of the search to all sides, in pixels of the half-size picture (paper: 32, that is 0.025 m) [px]."""
    rotation_steps: int = Field(15, ge=1, le=90)
    """Steps of the rotational search to either side (paper: 15)."""
    rotation_step_deg: float = Field(_STEP_DEG, gt=0, le=5)
    """Step of the rotational search; 1/128 rad, the paper's 0.448 deg [deg]."""
    search: Literal["exhaustive", "pyramid"] = "exhaustive"
    """exhaustive: every candidate, as Eq. (1) says; pyramid: quarter-size first, ten times faster."""
    high_pass: bool = True
    """Search pictures of even brightness and contrast; false: raw intensities, as in the paper."""
    refined: bool = True
    """Refine what is found to a hundredth of a pixel; false: whole pixels, as in the paper."""
    tolerance_px: float = Field(3.0, gt=0)
    """Groups agree when they are found this close to the whole patch, in pixels of the half-size picture [px]."""
    min_groups: int = Field(3, ge=1, le=4)
    """Groups that must agree (paper: all 4). With 3, dirt on one of them does not hide the place."""
    weak_shift_px: float = Field(6.0, ge=0)
    """With fewer than 4 groups, the farthest that the place may lie from where it was expected, in pixels of the
    half-size picture (5 mm): on other ground one search in a thousand has 3 groups agree, anywhere [px]."""
    min_correlation: float = Field(0.4, ge=-1, lt=1)
    """Least correlation of the patch with the place where it was found; -1: any."""
    heading_sigma_deg: float = Field(0.2, gt=0, le=90)
    """Headings that are known less well than this are not told: the `Fix` is of the place, and its heading is as good
    as unknown. Fine ground in light of its own is right to some 0.1; what looks like little else than noise may be off
    by a degree or two. A place of which it is known three times less well than that is `Lost` [deg]."""
    max_attempts: int = Field(10, ge=1)
    """Pictures in which a patch is searched for until it is given up for this pass (paper: 1)."""
    global_batch: int = Field(20, ge=1)
    """Patches tried per picture while the start is unknown."""
    start_margin: float = Field(0.7, gt=0, le=1)
    """With an unknown start, the place that fits best is believed when what the picture leaves unexplained of it
    (1 - correlation^2) is at most this share of any other place's: ground may repeat itself. 1: the best counts."""
    confirm_m: float = Field(0.0, ge=0)
    """With an unknown start, the way over which a place must go on to fit before it is believed. 0: a robot that stands
    finds itself, and ground that is the same as the path's beside it is believed [m]."""
    tilt_deg: float = Field(0.01, ge=0, le=10)
    """How far the camera nods and rolls while the robot drives, standard deviation: it shifts each picture, and no
    picture tells; 0: it is stiff [deg]."""
    use_vectors: bool = True
    """Use the vector kernels; false takes the plain ones, which give the same bits, slower."""
