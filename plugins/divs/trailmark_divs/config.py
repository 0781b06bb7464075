"""Config of the localizer."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from trailmark.config import PresetConfig, PresetValue, Sensor
from trailmark_divs.options import Average, Correspond, Gain, Select, Shift, Threshold, TurnSource, WhenBlind

__all__ = ["DivsConfig"]


class DivsConfig(PresetConfig):
    """Differential visual streams (Perroni Filho & Ohya 2014); w = 25, d = 50, e = 5 and q = 1.5 cm are the paper's."""

    presets: ClassVar = {
        "paper": {
            "window": PresetValue(25, "Sec. V: w"),
            "columns": PresetValue(50, "Sec. V: d"),
            "correlation_window": PresetValue(5, "Sec. V: e"),
            "select": PresetValue("distance", "Eq. 14"),
            "spacing_m": PresetValue(0.015, "Sec. V: a picture every 1.5 cm"),
            "region": PresetValue((0.0, 0.5), "Eq. 7: the upper half"),
            "threshold": PresetValue("otsu", "Eq. 5"),
            "average": PresetValue("mean", "Eq. 6"),
            "shift": PresetValue("paper", "Eq. 8, Fig. 1: correlation and hill climbing"),
            "confidence": PresetValue(0.0, "Fig. 1: the hill is the answer, whatever its height"),
            "correspondence": PresetValue("distance", "Eq. 13"),
            "gain": PresetValue("paper", "Eqs. 15, 16"),
            "when_blind": PresetValue("silent", "Sec. IV: nothing is collected in a turn"),
        }
    }

    preset: Literal["paper"] | None = None
    """The method as printed; what is written beside it wins. `drift_steering` has a preset of this name too."""
    camera: Sensor["image", "rgbd"]
    """Camera that looks along the path."""

    window: int = Field(25, ge=2)
    """Differences in a change vector, w."""
    columns: int = Field(50, ge=8)
    """Columns of a change vector, d."""
    correlation_window: int = Field(5, ge=3)
    """Columns of a correlation window, e."""
    select: Select = "distance"
    """Which pictures make the stream: by the way driven, by time, or every one."""
    spacing_m: float = Field(0.015, gt=0)
    """Way between pictures, q of Eq. (14) [m]."""
    spacing_s: float = Field(0.05, gt=0)
    """Time between pictures, with `select: time`; 0.05 s are 1.5 cm at the paper's 0.3 m/s [s]."""
    region: tuple[float, float] = (0.0, 0.5)
    """Rows that are looked at, as shares of the height; the paper leaves out the lower half, which shows the floor."""
    lens_radius: float | None = Field(None, gt=0)
    """Radius of a fisheye's circle about the picture's centre, as a share of the width; its rim is masked."""
    threshold: Threshold = "p90"
    """What counts as a change: the top tenth of a difference, Otsu's method (the paper), or Otsu after a blur."""
    average: Average = "trimmed"
    """Average over the window: without the outer quarters (against passers-by), or the mean of Eq. (6)."""
    keep_change_image: bool = False
    """Keep the pictures of the window, so that the change image can be shown."""

    shift: Shift = "robust"
    """Local normalised correlation, tracked; or circular correlation and hill climbing, as the reference does."""
    max_shift_columns: int = Field(20, ge=1)
    """Largest shift that is looked for, with `shift: robust` [columns]."""
    confidence: float = Field(0.8, ge=0, lt=1)
    """A shift less probable than this is not told."""

    correspondence: Correspond = "distance"
    """What says which taught window belongs to the present one: Eqs. (13), (12), (11), or the change vectors."""
    look_back: int = Field(4, ge=0)
    """How many windows further back than expected the next one may lie, with `correspondence: appearance`."""
    look_ahead: int = Field(6, ge=1)
    """How many further ahead."""
    landmark_spacing_m: float | None = Field(None, gt=0)
    """Least way between places where the place along the path is corrected by appearance; left out: nowhere [m]."""

    gain: Gain = "geometry"
    """Drift of a shift: by the field of view, by Eqs. (15) and (16), or learned from what turns do to the shift."""
    field_of_view_deg: float | None = Field(None, gt=0, lt=180)
    """Horizontal field of view; left out: from the calibration, or else one degree per column as in the paper [deg]."""
    depth_m: float = Field(6.0, gt=0)
    """Typical distance of what the upper half shows: sideways drift of this much weighs as one radian [m]."""
    sigma_columns: float = Field(0.5, gt=0)
    """Standard deviation of one window's shift [columns]."""
    lateral_prior_m: float = Field(0.5, gt=0)
    """How far from the path the robot may stand while nothing is known of its pose yet (one sigma) [m]."""

    turn_limit_deg: float = Field(6.0, gt=0)
    """A turn of more than this within a window clutters it: a new "time zero" is set [deg]."""
    turn_source: TurnSource = "auto"
    """What tells a turn: the belief, the pictures, or the belief as soon as it has ever turned."""
    when_blind: WhenBlind = "single"
    """In turns, and until a window is full: compare brightness profiles of single pictures, or say `Lost`. `pictures`
    compares small pictures, also where the stream is unclear or contradicts them, and finds a place that nobody knows;
    teach with it too."""
    picture_spacing_m: float = Field(0.1, gt=0)
    """Way between the small pictures that are taught, of 5 kB each [m]."""
    place_fit: float = Field(0.885, gt=0, le=1)
    """What the areas of pictures must fit to, by what can be asked of each, before a place is told to a robot that was
    not; the more was seen that tells a place, the less is asked. Less finds a place in other light sooner, and takes
    another place for it more often."""

    @model_validator(mode="after")
    def _check(self) -> DivsConfig:
        first, last = self.region
        if not 0.0 <= first < last <= 1.0:
            raise ValueError(f"region runs from one share of the height to a larger one, not {first} to {last}")
        if self.correlation_window > self.columns:
            raise ValueError(f"correlation_window ({self.correlation_window}) is wider than columns ({self.columns})")
        most = self.columns - self.correlation_window
        if self.max_shift_columns > most:
            raise ValueError(
                f"max_shift_columns ({self.max_shift_columns}) must leave a correlation window:"
                f" at most {most} of {self.columns} columns"
            )
        return self
