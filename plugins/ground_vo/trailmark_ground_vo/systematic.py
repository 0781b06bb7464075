"""What better pictures of the ground do not average out: the camera nods on its springs, and light is never quite even.

The alignment's covariance knows the noise of pixels. What is here is of the robot and of the lamps, and grows with the
way: where nothing moves there is none of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.systematic import motions_in_stretch
from trailmark_ground_vo.motion import ImageMotion

__all__ = ["CameraErrors", "motion_systematic", "nod_covariance"]

#: What a surface of six terms does not know of uneven light, per standard deviation of that light: it leads the way
#: astray by this share of it, and turns it by this angle on the width of a picture [1, rad]. Seen behind four lamps of
#: unequal brightness.
_LIGHT_SHARE, _LIGHT_RAD = 0.007, 0.007
#: On so much of the way a camera nods from one side to the other; nearer pictures differ less [m].
_NOD_WAY_M = 0.01
#: Share of a tilt that is taken for a turn [1].
_NOD_TURN = 0.2


def nod_covariance(tilt_rad: float, width_px: int, aspect: float) -> Floats:
    """Return the covariance of (u, v, turn) by which a camera that nods and rolls shifts and turns one picture, (3, 3).

    A lens is about as high over the ground as its picture is wide, with a field of view of 45 to 60 deg, so that a tilt
    shifts the picture by its angle times the width. It also squeezes one side of it, which pixels that are not spread
    evenly take for a turn by a share of the angle.

    Parameters
    ----------
    tilt_rad : float
        Standard deviation of roll and pitch [rad].
    width_px : int
        Of the picture [px].
    aspect : float
        Metres per pixel along v over those along u.
    """
    shift_px = tilt_rad * width_px
    return np.diag([shift_px**2, (shift_px / aspect) ** 2, (_NOD_TURN * tilt_rad) ** 2])


@dataclass(frozen=True, slots=True)
class CameraErrors:
    """What is known of a camera's errors that last.

    Attributes
    ----------
    width_px : int
        Of the picture [px].
    metres_per_pixel : (float, float)
        Along u and along v.
    tilt_rad : float
        Standard deviation of roll and pitch while the robot drives [rad].
    unevenness : float
        Standard deviation of the light over the picture, as a share of it; it is corrected for, but not wholly [1].
    """

    width_px: int
    metres_per_pixel: tuple[float, float]
    tilt_rad: float
    unevenness: float


def motion_systematic(motion: ImageMotion, dt_s: float, camera: CameraErrors) -> Floats:
    """Return the covariance of (u, v, turn) that a motion has beside that of its alignment.

    What the light does is the same in every picture: it is raised as an estimator needs that takes motions for
    independent (see `trailmark.systematic.motions_in_stretch`).

    Parameters
    ----------
    motion : ImageMotion
        Of the content.
    dt_s : float
        Its duration [s].
    camera : CameraErrors
        Whose picture it is.

    Returns
    -------
    (3, 3) float64
        [px^2, px^2, rad^2 on the diagonal].
    """
    aspect = camera.metres_per_pixel[1] / camera.metres_per_pixel[0]
    way_px = math.hypot(motion.u, motion.v * aspect) + abs(motion.turn_rad) * camera.width_px / 2.0
    way_m = way_px * camera.metres_per_pixel[0]
    lasting = motions_in_stretch(way_m, dt_s) * (camera.unevenness * way_px) ** 2
    shift = lasting * _LIGHT_SHARE**2
    light = np.diag([shift, shift / aspect**2, lasting * (_LIGHT_RAD / camera.width_px) ** 2])
    both_pictures = 2.0 * min(1.0, way_m / _NOD_WAY_M)
    return np.asarray(light + both_pictures * nod_covariance(camera.tilt_rad, camera.width_px, aspect))
