"""Configs of the peers of a camera that looks straight down."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["GroundPeerConfig", "KLTConfig", "ORBConfig", "PhaseCorrelationConfig"]


class GroundPeerConfig(PluginConfig):
    """What the peers share: each picture is compared with a key frame, which changes when the robot leaves it."""

    camera: Sensor["image"]
    """The downward camera."""
    key_shift: float = Field(0.35, ge=0, lt=1)
    """A new key frame is taken after this shift, as a share of the shorter side of a picture; 0: every picture."""
    key_turn_deg: float = Field(4.0, gt=0, le=45)
    """A new key frame is taken after this turn [deg]."""
    patience_frames: int = Field(2, ge=0)
    """Pictures that may fail in a row before the next one begins anew."""


class KLTConfig(GroundPeerConfig):
    """Corners (Shi & Tomasi) tracked from the key frame (Lucas & Kanade, pyramids), rigid motion under RANSAC."""

    corners: int = Field(300, ge=12)
    """Corners of a key frame."""
    quality: float = Field(0.01, gt=0, lt=1)
    """Least quality of a corner, as a share of the best one's."""
    distance_px: float = Field(12.0, gt=0)
    """Least distance between corners [px]."""
    window_px: int = Field(21, ge=5, le=63)
    """Side of the window that is tracked [px]."""
    levels: int = Field(3, ge=0, le=6)
    """Halved pictures above the full one."""
    tolerance_px: float = Field(1.0, gt=0)
    """A corner agrees with the rigid motion within this distance [px]."""
    min_corners: int = Field(12, ge=3)
    """Corners that must agree."""
    min_share: float = Field(0.4, gt=0, le=1)
    """Share of the tracked corners that must agree."""


class ORBConfig(GroundPeerConfig):
    """ORB features matched with those of the key frame, rigid motion under RANSAC."""

    features: int = Field(1000, ge=50)
    """Features of a picture."""
    fast_threshold: int = Field(7, ge=1, le=100)
    """Least contrast of a feature; OpenCV's 20 finds nothing on even floors [grey levels]."""
    tolerance_px: float = Field(2.0, gt=0)
    """A pair agrees with the rigid motion within this distance [px]."""
    min_pairs: int = Field(15, ge=3)
    """Pairs that must agree."""
    min_share: float = Field(0.15, gt=0, le=1)
    """Share of the pairs that must agree."""


class PhaseCorrelationConfig(GroundPeerConfig):
    """Phase correlation of windows; the turn is what their shifts have in common."""

    key_shift: float = Field(0.1, ge=0, lt=0.4)
    """A new key frame is taken after this shift, as a share of the shorter side of a picture; 0: every picture."""
    windows: int = Field(2, ge=2, le=6)
    """Windows along either side of the picture."""
    iterations: int = Field(2, ge=1, le=10)
    """Times that the picture is moved by what was found and correlated again."""
    min_response: float = Field(0.08, gt=0, lt=1)
    """Least height of the correlation's peak, the mean of the windows; 1 is a picture with itself."""
    tolerance_px: float = Field(1.5, gt=0)
    """Windows agree with one rigid motion within this distance, root mean square [px]."""
