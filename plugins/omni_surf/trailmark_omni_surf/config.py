"""Config of the omnidirectional camera's localizer."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from trailmark.config import ConfigPath, PresetConfig, PresetValue, Sensor

__all__ = ["OmniSurfConfig"]


class OmniSurfConfig(PresetConfig):
    """Landmarks from an uncalibrated omnidirectional camera (Tasaki et al. 2010)."""

    presets: ClassVar = {
        "paper": {
            "features": PresetValue("surf", "Sec. II-A"),
            "descriptor_gate": PresetValue(0.4, "Sec. IV: T_F = 40, where vectors have length 100"),
            "ratio": PresetValue(1.0, "Eq. 1 asks for nothing else"),
            "position_gate_px": PresetValue(1.5, "Sec. IV: T_x"),
            "n_longest": PresetValue(9, "Sec. IV: K"),
            "selection": PresetValue("svm", "Sec. II-B"),
            "label_distance_m": PresetValue(0.6, "Sec. IV: T_d"),
            "tracking_error_deg": PresetValue(5.0, "Sec. IV: T_p"),
            "min_tracked": PresetValue(5, "Sec. IV: T_n"),
            "refresh_every": PresetValue(1_000_000, "Fig. 3: it tracks as long as more than T_n are left"),
            "min_agreeing": PresetValue(4, "Sec. III: more than 3 landmarks"),
            "max_rival_share": PresetValue(1.0, "not in the paper"),
            "min_agreeing_share": PresetValue(0.0, "not in the paper"),
            "confirm_pictures": PresetValue(1, "not in the paper"),
            "place_fit": PresetValue(0.0, "not in the paper"),
            "max_gap_deg": PresetValue(360.0, "not in the paper"),
        }
    }

    preset: Literal["paper"] | None = None
    """The method as printed; what is written beside it wins. Teach with it too: `n_longest` chooses candidates."""
    camera: Sensor["image"]
    """The omnidirectional camera."""
    unwrapped: bool = False
    """Its pictures are panoramas already, 360 deg wide, as 360 degree cameras give them; there is no circle to find."""
    features: Literal["surf", "sift", "orb", "akaze", "cv2_surf"] = "surf"
    """Kind of features. SURF is covered by patents in some countries; `sift` is the free choice."""
    quality: Literal["fast", "compact", "quality"] = "fast"
    """Of our SURF: on the picture as it is, with fewer octaves and a smaller described square, or on twice the size."""
    n_features: int = Field(250, ge=20)
    """Features of a picture, the strongest."""
    descriptor_gate: float = Field(0.4, gt=0, le=2)
    """T_F of Eq. (1) between unit vectors: the paper's 40 on a scale where vectors have length 100."""
    ratio: float = Field(0.85, gt=0, le=1)
    """A match must be this much nearer than the second nearest landmark."""
    position_gate_px: float = Field(1.5, gt=0)
    """T_x of Eq. (2) [px]."""
    n_longest: int = Field(40, ge=1)
    """K: of the points seen from one place, so many of the longest-lived become candidates. (The paper: 9.)"""
    keyframe_m: float = Field(0.1, gt=0)
    """In teach, observations are remembered every so far [m]."""
    keyframe_deg: float = Field(10.0, gt=0)
    """In teach, observations are remembered after a turn of this much [deg]."""
    selection: Literal["svm", "covariance", "all"] = "svm"
    """How candidates become landmarks: the trained machine, the covariance of their position, or all of them."""
    model: ConfigPath | None = None
    """Selection model written by `trailmark omni train`; left out, the one that comes with the plugin."""
    label_distance_m: float = Field(0.6, gt=0)
    """T_d: how far a measured landmark may be off; `selection: covariance` asks twice its sigma to be below it [m]."""
    tracking_error_deg: float = Field(5.0, gt=0, lt=90)
    """T_p: a landmark with a larger tracking error, Eq. (4), is removed [deg]."""
    min_tracked: int = Field(5, ge=3)
    """T_n: with more landmarks than this the next picture is tracked; otherwise features are detected again."""
    refresh_every: int = Field(15, ge=1)
    """After so many tracked pictures features are detected again: what tracking drifts by cannot be seen in its own
    errors. (Not in the paper.)"""
    min_agreeing: int = Field(10, ge=4)
    """So many landmarks must agree on a pose found without a start, each counted the less the larger its error. (The
    paper: more than three.)"""
    max_rival_share: float = Field(0.85, gt=0, le=1)
    """A pose elsewhere with more than this share of its support makes it ambiguous. (Not in the paper.)"""
    min_agreeing_share: float = Field(0.35, ge=0, le=1)
    """And this share of the recognised landmarks. (Not in the paper.)"""
    confirm_pictures: int = Field(2, ge=1)
    """A place that was not expected is told when so many pictures in a row have found it. (Not in the paper.)"""
    place_fit: float = Field(0.935, ge=0, le=1)
    """A place that was not expected must look as it was taught, up to 0.5 m beside the way: areas of the picture fit by
    this share of what neighbouring taught pictures fit each other. Landmarks alone believe in another building of the
    same plan. 0: not asked. (Not in the paper.)"""
    max_gap_deg: float = Field(200.0, gt=0, le=360)
    """Widest angle around it without a landmark that agrees: one board alone may be another board. (Not in the
    paper.) [deg]"""
    bearing_sigma_deg: float = Field(1.0, gt=0)
    """Noise of a good bearing, positions of landmarks included [deg]."""
    map_sigma_m: float = Field(0.015, ge=0)
    """What the taught landmarks are off together: many bearings do not average it away [m]."""
    map_sigma_deg: float = Field(0.25, ge=0)
    """The same of the heading [deg]."""
    max_position_sigma_m: float = Field(0.5, gt=0)
    """A pose less certain than this is none [m]."""
    use_tracking: bool = True
    """Main flow by tracking; off, every picture goes through the sub flow, by itself (the paper's simple method)."""
    check_centre: bool = True
    """Look for the image circle also where the calibration names a centre, and refuse a picture that contradicts it."""
    max_centre_error_px: float = Field(6.0, gt=0)
    """Largest distance between the centre found and the one named [px]."""
    min_circle_coverage: float = Field(0.6, gt=0, le=1)
    """Share of the rim that must be seen as a circle."""

    @property
    def descriptor_name(self) -> str:
        """What a map calls its descriptors: those of ``compact`` tell of a smaller square, and match no others."""
        return f"{self.features} compact" if (self.features, self.quality) == ("surf", "compact") else self.features
