"""Faults of laser scanners."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from pydantic import Field

from trailmark.config import PluginConfig
from trailmark.frames import Frame, Scan
from trailmark.interfaces import Fault, Session

__all__ = ["BlindSector", "BlindSectorConfig", "worsen_ranges"]


def worsen_ranges(scan: Scan, noise_m: float, stray: float, rng: np.random.Generator) -> Scan:
    """Return a scan with noise on its ranges and with beams that return from anywhere.

    Parameters
    ----------
    scan : Scan
        The scan.
    noise_m : float
        Standard deviation [m].
    stray : float
        Share of beams that return from anywhere within what the scanner can measure.
    rng : numpy.random.Generator
        Of this frame.
    """
    if not (noise_m or stray):
        return scan
    ranges = np.array(scan.ranges_m)
    ranges += (noise_m * rng.standard_normal(len(ranges))).astype(ranges.dtype)
    if stray:
        known = ranges[np.isfinite(ranges)]
        far_m = scan.range_max_m if math.isfinite(scan.range_max_m) else float(known.max(initial=1.0))
        is_stray = rng.random(len(ranges)) < stray
        ranges[is_stray] = rng.uniform(scan.range_min_m, far_m, int(is_stray.sum()))
    return replace(scan, ranges_m=np.where(ranges < scan.range_min_m, np.nan, ranges).astype(ranges.dtype))


class BlindSectorConfig(PluginConfig):
    """Beams that never return: dirt on the window, or something that is mounted before it."""

    width_deg: float = Field(default=60.0, gt=0, le=360)
    """How wide [deg]."""
    centre_deg: float | None = None
    """Where, counter-clockwise from straight ahead of the scanner; left out: at random [deg]."""


class BlindSector(Fault):
    """A sector without ranges, the same in every scan."""

    kinds = frozenset({"scan"})
    config: BlindSectorConfig

    def start(self, session: Session) -> None:
        """Draw where the sector is."""
        drawn_deg = session.rng.uniform(-180.0, 180.0)
        self._centre = math.radians(drawn_deg if self.config.centre_deg is None else self.config.centre_deg)

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the scan without the ranges of the sector."""
        scan = frame.payload
        if not isinstance(scan, Scan):
            return frame
        away = np.abs((scan.angles() - self._centre + math.pi) % (2.0 * math.pi) - math.pi)
        blind = away <= math.radians(self.config.width_deg) / 2
        ranges = np.where(blind, np.nan, scan.ranges_m).astype(scan.ranges_m.dtype)
        return Frame(frame.sensor, frame.stamp_s, replace(scan, ranges_m=ranges))
