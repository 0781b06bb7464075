"""Whether the landmarks of a taught place look as they did, where a pose says that they should be seen.

A few posters and corners agree on a pose in any room with the same furniture. In the taught room nearly all others are
to be seen from there as well; in another one something else hangs in their places.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trailmark.arrays import Bools, Floats, Indices
from trailmark.geometry import wrap_angles
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.landmarks import vicinities
from trailmark_kinect_landmarks.memory import LandmarkMemory

__all__ = ["InView", "in_view", "place_likeness"]

_MARGIN_PX = 26  # the vicinity lies in the picture
# Of the pose from which a landmark was remembered: it looks otherwise from elsewhere.
_SEEN_FROM_M, _SEEN_FROM_RAD = 0.6, 0.4
_DEPTH_SHARE, _DEPTH_M = 0.06, 0.03  # a surface farther off than this from a landmark is not its own
_ASIDE_PX = (-4.0, -2.0, 0.0, 2.0, 4.0)  # the pose may be wrong by so much
_LEAST_SEEN = 5  # fewer do not tell


def place_likeness(
    memory: LandmarkMemory, camera: LandmarkCamera, picture: PreparedImage, T_map_base: Floats
) -> float | None:
    """Return how alike the taught landmarks look that should be seen from a pose, the mean of them, at most 1.

    Those count that lie in the picture at the depth that is measured there, and were remembered from near the pose.

    Parameters
    ----------
    memory : LandmarkMemory
        What was taught.
    camera : LandmarkCamera
        Says where points are seen.
    picture : PreparedImage
        What is seen.
    T_map_base : (4, 4) float64
        The pose.

    Returns
    -------
    float or None
        Mean correlation of their vicinities with those that were remembered; None where fewer than five should be seen.
    """
    rows, uv, off_m, allowed_m = _to_be_seen(memory.is_taught, memory, camera, picture, T_map_base)
    is_seen = np.abs(off_m) < allowed_m
    if is_seen.sum() < _LEAST_SEEN:
        return None
    return float(_alike(memory, rows[is_seen], uv[is_seen], picture).mean())


class InView(NamedTuple):
    """Remembered landmarks that should be seen from a pose, where nothing stands before them.

    Attributes
    ----------
    n : int
        How many there are.
    n_through : int
        ... of which lie where the picture looks through to something farther.
    """

    n: int
    n_through: int

    @property
    def are_gone(self) -> bool:
        """Whether most of them are not there."""
        return self.n >= _LEAST_SEEN and self.n_through > self.n / 2


def in_view(memory: LandmarkMemory, camera: LandmarkCamera, picture: PreparedImage, T_map_base: Floats) -> InView:
    """Return how many remembered landmarks, taught or not, should be seen from a pose.

    Parameters
    ----------
    memory, camera, picture, T_map_base
        As for `place_likeness`.
    """
    _, _, off_m, allowed_m = _to_be_seen(~memory.is_moved, memory, camera, picture, T_map_base)
    return InView(int(np.sum(off_m > -allowed_m)), int(np.sum(off_m > allowed_m)))  # NaN is neither


def _to_be_seen(
    which: Bools, memory: LandmarkMemory, camera: LandmarkCamera, picture: PreparedImage, T_map_base: Floats
) -> tuple[Indices, Floats, Floats, Floats]:
    """Return which landmarks, of some, were seen from near a pose and lie in the picture.

    Returns
    -------
    rows : (N,) int
        Their rows in the memory.
    uv : (N, 2) float64
        Where they should be seen [px].
    off_m : (N,) float64
        By how much the surface that is measured there lies farther off; NaN where nothing is measured [m].
    allowed_m : (N,) float64
        By how much a surface may be off to be that of the landmark [m].
    """
    rows = np.flatnonzero(which & _was_near(memory.anchor, T_map_base))
    points_base = (memory.points[rows] - T_map_base[:3, 3]) @ T_map_base[:3, :3]
    uv = camera.project(points_base, picture.size)
    ahead_m = camera.in_camera(points_base)[:, 0]
    last = np.array(picture.size) - 1 - _MARGIN_PX
    is_inside = np.all((uv >= _MARGIN_PX) & (uv <= last), axis=1)  # NaN, behind the camera, is not
    rows, uv, ahead_m = rows[is_inside], uv[is_inside], ahead_m[is_inside]
    whole = np.rint(uv).astype(np.intp)
    off_m = picture.depth_m[whole[:, 1], whole[:, 0]] - ahead_m
    return rows, uv, off_m, _DEPTH_SHARE * ahead_m + _DEPTH_M


def _alike(memory: LandmarkMemory, rows: Indices, uv: Floats, picture: PreparedImage) -> Floats:
    """Return how alike landmarks look at pixels, or a little aside, (N,)."""
    aside = np.array([(du, dv) for du in _ASIDE_PX for dv in _ASIDE_PX])
    looks = vicinities(picture.grey, (uv[None] + aside[:, None]).reshape(-1, 2)).reshape(len(aside), len(rows), -1)
    return np.asarray(np.einsum("anc,nc->an", looks, memory.vicinity[rows]).max(axis=0))


def _was_near(anchor: Floats, T_map_base: Floats) -> Bools:
    """Return which landmarks were remembered from near a pose; False where a map does not tell."""
    away_m = np.hypot(anchor[:, 0] - T_map_base[0, 3], anchor[:, 1] - T_map_base[1, 3])
    turned_rad = np.abs(wrap_angles(anchor[:, 2] - math.atan2(T_map_base[1, 0], T_map_base[0, 0])))
    return np.asarray((away_m < _SEEN_FROM_M) & (turned_rad < _SEEN_FROM_RAD))
