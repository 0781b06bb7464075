"""Configs of the localizers that compare single pictures."""

from __future__ import annotations

from pydantic import Field, model_validator

from trailmark.config import PluginConfig, Sensor

__all__ = ["AppearanceConfig", "ColumnNCCConfig", "PatchNCCConfig", "PhaseShiftConfig"]


class AppearanceConfig(PluginConfig):
    """A taught sequence of pictures; each is compared with the one nearest along the path."""

    camera: Sensor["image", "rgbd"]
    """Camera that looks along the path."""
    spacing_m: float = Field(0.1, gt=0)
    """Way between remembered pictures; compared are all that come in replay [m]."""
    region: tuple[float, float] = (0.0, 1.0)
    """Rows that are looked at, as shares of the height."""
    min_score: float = Field(0.1, ge=0, lt=1)
    """A match that scores less is not told."""
    field_of_view_deg: float | None = Field(None, gt=0, lt=180)
    """Horizontal field of view; left out: from the calibration, or else 60 deg [deg]."""
    depth_m: float = Field(6.0, gt=0)
    """Typical distance of what is seen: sideways drift of this much weighs as one radian [m]."""
    sigma_deg: float = Field(1.0, gt=0)
    """Standard deviation of a shift [deg]."""

    @model_validator(mode="after")
    def _check(self) -> AppearanceConfig:
        first, last = self.region
        if not 0.0 <= first < last <= 1.0:
            raise ValueError(f"region runs from one share of the height to a larger one, not {first} to {last}")
        return self


class ColumnNCCConfig(AppearanceConfig):
    """Mean brightness of each pixel column, correlated: 1-D, and the toughest of the simple ones over seasons."""

    max_shift: float = Field(0.25, gt=0, lt=1)
    """Largest shift, as a share of the width."""


class PatchNCCConfig(AppearanceConfig):
    """Small pictures, brightness normalised in patches, correlated (Dall'Osto, Fischer & Milford 2021)."""

    width_px: int = Field(115, ge=16)
    """Width of the small picture [px]."""
    height_px: int = Field(44, ge=4)
    """Its height [px]."""
    patch_px: int = Field(9, ge=3)
    """Side of the patch that a pixel is normalised by, odd [px]."""

    @model_validator(mode="after")
    def _is_odd(self) -> PatchNCCConfig:
        if self.patch_px % 2 == 0:
            raise ValueError(f"patch_px must be odd, not {self.patch_px}")
        return self


class PhaseShiftConfig(AppearanceConfig):
    """Phase correlation of whole pictures."""

    width_px: int = Field(320, ge=16)
    """Width that pictures are reduced to [px]."""
