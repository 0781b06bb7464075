"""Where the image centre is: as the calibration says, as the picture shows, and whether the two agree."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.frames import Omni
from trailmark_omni_surf.circle import BearingCamera, ImageCircle, find_circle
from trailmark_omni_surf.config import OmniSurfConfig

__all__ = ["CentreFinder"]


@dataclass(slots=True)
class CentreFinder:
    """Looks for the image circle until it is found, once per run.

    Parameters
    ----------
    calibration : Omni
        What is known of the camera.
    check : bool
        Look also where the calibration names a centre.
    max_error_px : float
        Largest distance between the two centres [px].
    min_coverage : float
        Share of the rim that must be seen.
    """

    calibration: Omni
    check: bool
    max_error_px: float
    min_coverage: float
    _camera: BearingCamera | None = None

    @classmethod
    def of(cls, calibration: Omni, config: OmniSurfConfig) -> CentreFinder:
        """Return the finder for a camera.

        Raises
        ------
        ConfigError
            If only half of the centre is given, or no outer radius where the picture is not looked at.
        """
        known = _knows_centre(calibration)
        if (calibration.centre_u is None) != (calibration.centre_v is None):
            raise ConfigError("a calibration names both centre_u and centre_v, or none of them")
        if known and not config.check_centre and calibration.radius_outer_px is None:
            raise ConfigError("check_centre: false needs radius_outer_px in the calibration: nothing looks for it")
        return cls(calibration, config.check_centre, config.max_centre_error_px, config.min_circle_coverage)

    @property
    def camera(self) -> BearingCamera:
        """What turns pixels into bearings; after a `look` without a problem."""
        assert self._camera is not None
        return self._camera

    def look(self, image: npt.NDArray[np.uint8]) -> str:
        """Find or check the centre; return what is wrong, in words, or nothing."""
        if self._camera is not None:
            return ""
        if _knows_centre(self.calibration) and not self.check:
            self._camera = BearingCamera.of(self.calibration, None)
            return ""
        circle = find_circle(image)
        problem = self._problem(circle)
        if not problem:
            self._camera = BearingCamera.of(self.calibration, circle)
        return problem

    def _problem(self, circle: ImageCircle | None) -> str:
        if circle is None or circle.coverage < self.min_coverage:
            seen = 0.0 if circle is None else circle.coverage
            return (
                f"no image circle: {seen:.0%} of the best rim is seen, {self.min_coverage:.0%} are needed; "
                "the picture may be stretched, or dark, or of another camera"
            )
        if _knows_centre(self.calibration):
            assert self.calibration.centre_u is not None
            assert self.calibration.centre_v is not None
            du, dv = circle.centre_u - self.calibration.centre_u, circle.centre_v - self.calibration.centre_v
            if math.hypot(du, dv) > self.max_error_px:
                return (
                    f"the calibration puts the image centre at ({self.calibration.centre_u:.1f}, "
                    f"{self.calibration.centre_v:.1f}), the picture at ({circle.centre_u:.1f}, {circle.centre_v:.1f})"
                )
        return ""


def _knows_centre(calibration: Omni) -> bool:
    return calibration.centre_u is not None and calibration.centre_v is not None
