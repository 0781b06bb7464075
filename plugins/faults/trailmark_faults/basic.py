"""The fault `basic`: the keys that stand directly under ``perturb``.

They are one fault and not many because one stream of random numbers runs through them in a fixed order: runs of
version 0.1.0 give the same bytes for the same seed.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from trailmark.arrays import AnyArray
from trailmark.config import PluginConfig
from trailmark.frames import RGBD, Frame, Image, Payload, Scan, SensorInfo
from trailmark.interfaces import Fault, Session
from trailmark_faults.calibration import WrongCalibration, idle_keys, with_wrong_calibration
from trailmark_faults.depth import add_depth_noise
from trailmark_faults.image import Occluder, add_speckle, blur, expose, white_of
from trailmark_faults.scan import worsen_ranges
from trailmark_faults.timing import FrameLoss

__all__ = ["BasicConfig", "BasicFault", "Occluders"]

_PICTURES = frozenset({"image", "rgbd"})
#: The kinds of sensor that a key befalls, where it does not befall all.
_KINDS = {
    **dict.fromkeys(("noise", "blur_px", "exposure", "flicker", "occluders"), _PICTURES),
    "speckle": _PICTURES | {"scan"},
    "range_noise_m": frozenset({"rgbd", "scan"}),
}


class Occluders(PluginConfig):
    """Things that pass in front of a camera, each of one grey."""

    n: int = Field(default=2, ge=1)
    """How many."""
    size: float = Field(default=0.2, gt=0, le=1)
    """Side of each, as a share of the shorter side of the picture."""
    speed: float = Field(default=0.2, ge=0)
    """How fast they cross [widths of the picture per second]."""


class BasicConfig(PluginConfig):
    """The keys that stand directly under ``perturb``. Every default is no fault."""

    noise: float = Field(default=0.0, ge=0)
    """Noise of pictures, standard deviation [grey levels of 255]."""
    blur_px: float = Field(default=0.0, ge=0)
    """Gaussian blur of pictures, standard deviation [px]."""
    exposure: float = Field(default=1.0, gt=0)
    """Brightness of pictures: times this, cut off at white."""
    flicker: float = Field(default=0.0, ge=0)
    """Brightness changes from picture to picture: standard deviation of the logarithm of the factor."""
    speckle: float = Field(default=0.0, ge=0, le=1)
    """Share of pixels that are black or white, and of laser beams that return from anywhere."""
    range_noise_m: float = Field(default=0.0, ge=0)
    """Noise of laser ranges and of depth, standard deviation [m]."""
    occluders: Occluders | None = None
    """Things that pass in front of a camera."""
    dropped: float = Field(default=0.0, ge=0, lt=1)
    """Share of frames that are lost."""
    dropped_in_a_row: float | None = Field(default=None, ge=1)
    """How many are lost at a time, on average; left out: each by itself."""
    missing_s: tuple[float, float] | None = None
    """A time in which the sensor says nothing, from and to, since the first frame [s]."""
    late_s: float = Field(default=0.0, ge=0)
    """Stamps say when a frame arrived, and it took so long [s]."""
    wrong: WrongCalibration | None = None
    """What is believed of the sensor and is not so."""

    @model_validator(mode="after")
    def _keys_say_a_fault(self) -> Self:
        """Refuse keys that no fault stands behind; one at its neutral value, as in a sweep, is none of them."""
        if self.dropped_in_a_row is not None and "dropped" not in self.model_fields_set:
            raise ValueError("dropped_in_a_row goes with dropped, the share of frames that are lost")
        if self.wrong is not None and not self.wrong.model_fields_set:
            raise ValueError(f"wrong says nothing that is wrong: {', '.join(WrongCalibration.model_fields)}")
        return self

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        if self.missing_s is not None and not 0.0 <= self.missing_s[0] < self.missing_s[1]:
            raise ValueError(f"missing_s is [from, to] with 0 <= from < to, not {list(self.missing_s)}")
        shortest = self.dropped / (1.0 - self.dropped)
        if self.dropped_in_a_row is not None and self.dropped_in_a_row < shortest - 1e-9:
            raise ValueError(
                f"a share of {self.dropped:g} cannot be lost in runs of {self.dropped_in_a_row:g}:"
                f" they must be {shortest:.3g} long at least"
            )
        return self


class BasicFault(Fault):
    """Lost frames, blur, occluders, brightness, noise, speckle and late frames, in this order; a wrong calibration."""

    config: BasicConfig

    def start(self, session: Session) -> None:
        """Draw the occluders."""
        config = self.config
        self._counts: Counter[str] = Counter()
        self._loss = FrameLoss(config.dropped, config.dropped_in_a_row)
        asked = config.occluders or Occluders()
        n = config.occluders.n if config.occluders is not None else 0
        self._occluders = [Occluder(session.rng, asked.size, asked.speed) for _ in range(n)]

    def counters(self) -> Mapping[str, int]:
        """Return how many frames were ``dropped``, ``missing`` and ``late``."""
        return self._counts

    def idle_options(self, info: SensorInfo) -> Mapping[str, str]:
        """Return the keys that are in use and change nothing of a sensor."""
        config, fields = self.config, BasicConfig.model_fields
        used = [key for key in _KINDS if getattr(config, key) != fields[key].default]
        idle = {
            key: f"sensors of kind {' or '.join(sorted(_KINDS[key]))}" for key in used if info.kind not in _KINDS[key]
        }
        return idle if config.wrong is None else idle | idle_keys(info, config.wrong)

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return the sensor with the calibration that is wrong."""
        return info if self.config.wrong is None else with_wrong_calibration(info, self.config.wrong)

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        """Return the frame with its faults; None where it is lost."""
        missing, late_s = self.config.missing_s, self.config.late_s
        if self._loss.loses(rng):
            self._counts["dropped"] += 1
            return None
        if missing is not None and missing[0] <= since_s < missing[1]:
            self._counts["missing"] += 1
            return None
        payload = self._worsen(frame.payload, rng, since_s)
        if late_s:
            self._counts["late"] += 1
        elif payload is frame.payload:
            return frame
        return Frame(frame.sensor, frame.stamp_s + late_s, payload)

    def _worsen(self, payload: Payload, rng: np.random.Generator, since_s: float) -> Payload:
        match payload:
            case Image(pixels=pixels):
                worse = self._picture(pixels, rng, since_s)
                return payload if worse is pixels else Image(worse)
            case RGBD():
                return self._rgbd(payload, rng, since_s)
            case Scan():
                return worsen_ranges(payload, self.config.range_noise_m, self.config.speckle, rng)
        return payload

    def _picture(self, pixels: AnyArray, rng: np.random.Generator, since_s: float) -> AnyArray:
        config = self.config
        worse = blur(pixels, config.blur_px) if config.blur_px else pixels
        if self._occluders:
            worse = worse.copy()
            for occluder in self._occluders:
                worse[occluder.window(worse.shape, since_s)] = round(occluder.grey * white_of(pixels))
        gain = config.exposure * math.exp(config.flicker * rng.standard_normal())
        worse = expose(worse, gain, config.noise, rng)
        return add_speckle(worse, config.speckle, rng) if config.speckle else worse

    def _rgbd(self, payload: RGBD, rng: np.random.Generator, since_s: float) -> RGBD:
        colour = self._picture(payload.bgr, rng, since_s)
        depth = payload.depth_m
        if self.config.range_noise_m:
            depth = add_depth_noise(depth, self.config.range_noise_m, rng)
        if self._occluders:
            depth = depth.copy()
            for occluder in self._occluders:
                depth[occluder.window(depth.shape, since_s)] = np.nan  # too near to be measured
        return payload if colour is payload.bgr and depth is payload.depth_m else RGBD(colour, depth)
