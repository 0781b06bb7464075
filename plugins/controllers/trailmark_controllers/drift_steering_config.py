"""Config of the drift-steering controller."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from trailmark.config import PresetConfig, PresetValue

__all__ = ["DriftSteeringConfig"]


class DriftSteeringConfig(PresetConfig):
    """Steering against the drift from a taught path (Perroni Filho & Ohya 2014, Sec. IV)."""

    presets: ClassVar = {
        "paper": {
            "speed_mps": PresetValue(0.3, "Sec. V"),
            "law": PresetValue("steps", "Sec. IV: turn by the drift, go straight until the next one is known"),
        }
    }

    preset: Literal["paper"] | None = None
    """The steering as printed; what is written beside it wins."""
    speed_mps: float = Field(0.3, gt=0)
    """Speed along the path; the paper's [m/s]."""
    reverse: bool | None = None
    """Drive from the end to the start; left out, the end at which the robot stands decides."""
    repeat: float = Field(0.5, ge=0.5)
    """Round trips; 0.5 is one way, 10.5 ends at the other end."""
    law: Literal["smooth", "steps"] = "smooth"
    """Correct all the time, or as the paper: turn, drive straight until the drift is known again, turn again."""
    lookahead_m: float = Field(6.0, gt=0)
    """An offset of this much weighs as one radian of heading; the way on which offsets vanish [m]."""
    response_m: float = Field(0.5, gt=0)
    """Way on which heading errors vanish, with `law: smooth` [m]."""
    correction_limit_deg_per_m: float = Field(15.0, gt=0)
    """Sharpest bend that a correction adds to the taught one, so that streams stay clear [deg/m]."""
    yaw_limit_deg_per_s: float = Field(45.0, gt=0)
    """Fastest turn; in sharper bends the robot slows down [deg/s]."""
    dead_band_deg: float = Field(1.0, ge=0)
    """Drift that is not worth a turn, with `law: steps` [deg]."""
    search_m: float = Field(1.0, ge=0)
    """How far to drive straight on, at half speed, while the place on the path is unknown: streams need motion [m]."""
    arrive_m: float = Field(0.02, gt=0)
    """An end counts as reached this close to it [m]."""

    @model_validator(mode="after")
    def _check(self) -> DriftSteeringConfig:
        if (2 * self.repeat) % 1:
            raise ValueError(f"repeat counts round trips in halves (0.5, 1, 1.5, ...), not {self.repeat}")
        return self
