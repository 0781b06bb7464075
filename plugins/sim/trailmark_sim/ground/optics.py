"""The light and the sensor of a ground camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Float32s

__all__ = ["Optics", "led_light"]


@dataclass(frozen=True, slots=True)
class Optics:
    """What stands between the ground and the bytes.

    Attributes
    ----------
    psf_px : float
        Standard deviation of the lens' blur [px].
    vignette : float
        Light lost in the corners, 0 to 1.
    read_noise : float
        Noise of a black pixel, one standard deviation [grey levels].
    shot_noise : float
        Further noise of a white pixel; its variance grows with the grey [grey levels].
    gain, offset : float
        Of the camera; another day has others.
    exposure_s : float
        While the vehicle moves on, the picture is smeared [s].
    readout_s : float
        Rows are exposed one after the other in this time, around the stamp; 0: all at once [s].
    height_jitter : float
        Standard deviation of the camera's height over the ground, as a share of it.
    tilt_jitter_rad : float
        Standard deviation of roll and pitch [rad].
    camera_height_m : float
        Height of the lens: what a tilt shifts the picture by [m].
    """

    psf_px: float = 0.7
    vignette: float = 0.25
    read_noise: float = 0.8
    shot_noise: float = 1.6
    gain: float = 1.0
    offset: float = 0.0
    exposure_s: float = 5e-4
    readout_s: float = 0.0
    height_jitter: float = 5e-4
    tilt_jitter_rad: float = 2e-4
    camera_height_m: float = 0.15


def led_light(width: int, height: int, vignette: float) -> Float32s:
    """Return the brightness of a uniform floor, 1 on average: the lens' falling off and four LEDs in a cover.

    Parameters
    ----------
    width, height : int
        Size of the picture [px].
    vignette : float
        Light lost in the corners, 0 to 1; 0 is even light.

    Returns
    -------
    (height, width) float32
    """
    u = (np.arange(width) - (width - 1) / 2.0) / (width / 2.0)
    v = (np.arange(height) - (height - 1) / 2.0) / (height / 2.0)
    x, y = np.meshgrid(u, v)
    light = 1.0 - vignette * (x * x + y * y) / 2.0
    for n in range(4):  # one LED stands a little brighter than the next
        turn = math.radians(45.0 + 90.0 * n)
        squared = (x - 0.7 * math.cos(turn)) ** 2 + (y - 0.7 * math.sin(turn)) ** 2
        light += vignette * (0.10 + 0.05 * n) * np.exp(-squared / 0.3)
    return np.asarray(light / light.mean(), dtype=np.float32)
