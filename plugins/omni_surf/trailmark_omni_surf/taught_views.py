"""Whether it looks here as it did where it was taught: unwrapped views of the keyframes, compared area by area.

Landmarks that agree say that the walls, lamps and shelves stand as they did. Another building of the same plan has
these too; what hangs and lies there looks different.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import cv2
import numpy as np

from trailmark.arrays import Floats, Grey8
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark_omni_surf.pixel_bearings import PixelBearings

__all__ = ["VIEW", "TaughtViews", "unwrapped_view", "view_fit"]

#: Name of the view among a keyframe's arrays.
VIEW: Final = "view"

_WIDTH, _HEIGHT = 360, 72  # a column a degree [px]
_AREA, _SEARCH = 12, 5  # side of an area, and how far it is looked for around its place [px]
_MIN_CONTRAST = 8.0  # one standard deviation of a taught area that has a say [grey levels]
_BRIGHT, _GLARE_PX = 245, 9  # lamps are light, not place; around them, too
_MAX_GLARE = 0.02  # of an area
_MIN_AREAS = 8  # fewer do not tell
_NEXT_M = 0.15  # keyframes up to so far apart tell what can be asked
_FAR_M = 0.5  # farther from every keyframe near things have moved too far to compare
#: Areas fit worse beside the way, by the square of the distance: by this [1/m^2], or by this share of what they do
#: along it, where what is abeam passes by (supermarkets: 0.3 m beside 0.03 less, 0.2 m ahead 0.04).
_BESIDE = 0.35
_LEAST = 0.8  # of what is asked on the way is asked everywhere


def unwrapped_view(image: Grey8, camera: PixelBearings) -> Grey8:
    """Return what is seen all around, (72, 360): forward in the middle, left to the left, a column a degree.

    Parameters
    ----------
    image : (H, W) uint8
        Grey picture.
    camera : PixelBearings
        What turns bearings into pixels.
    """
    bearings = math.pi - (np.arange(_WIDTH) + 0.5) / _WIDTH * 2.0 * math.pi
    shares = 1.0 - (np.arange(_HEIGHT) + 0.5) / _HEIGHT
    uv = camera.pixels(np.tile(bearings, _HEIGHT), np.repeat(shares, _WIDTH)).astype(np.float32)
    step_px = float(np.hypot(*(uv[1::97] - uv[:-1:97]).T).mean())
    smooth = cv2.GaussianBlur(image, (0, 0), 0.4 * step_px) if step_px > 1.5 else image
    columns = uv.reshape(_HEIGHT, _WIDTH, 2)
    return np.asarray(cv2.remap(smooth, columns[..., 0], columns[..., 1], cv2.INTER_LINEAR), dtype=np.uint8)


def view_fit(taught: Grey8, seen: Grey8) -> float:
    """Return how well the areas of a taught view are found in another of the same heading; NaN where too few tell.

    Each area that has contrast counts by its best correlation around its place, at most 1, and weighs by its detail:
    walls and doors look alike in many buildings, print and goods do not. Brightness and contrast do not matter; areas
    in which lamps or their glare are seen, then or now, have no say.

    Parameters
    ----------
    taught, seen : (72, 360) uint8
        Views; the second turned so that each column looks the same way.
    """
    margin = _AREA + _SEARCH
    around = np.concatenate([seen[:, -margin:], seen, seen[:, :margin]], axis=1)
    glare = np.maximum(_glare(taught), _glare(seen))
    fits, weights = [], []
    for v in range(_SEARCH, _HEIGHT - _AREA - _SEARCH + 1, _AREA):
        for u in range(0, _WIDTH - _AREA + 1, _AREA):
            area = taught[v : v + _AREA, u : u + _AREA]
            if area.std() < _MIN_CONTRAST or glare[v : v + _AREA, u : u + _AREA].mean() > _MAX_GLARE:
                continue
            left = u + margin - _SEARCH
            window = around[v - _SEARCH : v + _AREA + _SEARCH, left : left + _AREA + 2 * _SEARCH]
            weights.append(float(np.abs(cv2.Laplacian(area, cv2.CV_32F)).mean()))
            fits.append(float(cv2.matchTemplate(window, area, cv2.TM_CCOEFF_NORMED).max()) if window.std() > 0 else 0.0)
    return float(np.average(fits, weights=weights)) if len(fits) >= _MIN_AREAS else math.nan


def _glare(view: Grey8) -> Floats:
    bright = (view >= _BRIGHT).astype(np.uint8)
    return np.asarray(cv2.dilate(bright, np.ones((_GLARE_PX, _GLARE_PX), np.uint8)), dtype=np.float64)


@dataclass(slots=True, eq=False)
class TaughtViews:
    """The views of the keyframes of a taught place.

    Attributes
    ----------
    poses : (N, 3) float64
        Of the camera in the map [m, m, rad].
    views : sequence of (72, 360) uint8
        What was seen from each.
    """

    poses: Floats
    views: Sequence[Grey8]
    _levels: dict[int, tuple[float, float]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, keyframes: Sequence[Keyframe]) -> TaughtViews:
        """Return the views that keyframes remember; those of earlier versions have none."""
        seeing = [keyframe for keyframe in keyframes if VIEW in keyframe.arrays]
        poses = [(k.pose_map_base @ Pose2.from_array(k.arrays["pose_base_camera"])).array() for k in seeing]
        return cls(np.array(poses).reshape(-1, 3), [np.asarray(k.arrays[VIEW], np.uint8) for k in seeing])

    def __len__(self) -> int:
        return len(self.views)

    def share(self, pose_map_camera: Pose2, seen: Grey8) -> float:
        """Return how well a view fits the taught one nearest to a pose, as a share of what can be had there.

        What can be had is how well the neighbours of that view fit it. NaN: it cannot be compared, because the pose is
        farther than 0.5 m from all that was taught, or because the view has too little contrast.

        Parameters
        ----------
        pose_map_camera : Pose2
            Where the camera is taken to be.
        seen : (72, 360) uint8
            What it sees.
        """
        if not len(self):
            return math.nan
        nearest, distance_m = self._nearest(pose_map_camera)
        if distance_m > _FAR_M:
            return math.nan
        fit = view_fit(self.views[nearest], _turned(seen, pose_map_camera.theta - self.poses[nearest, 2]))
        level, fall_per_m2 = self._level(nearest)
        return fit / max(level - _BESIDE * max(1.0, fall_per_m2) * distance_m**2, _LEAST * level)

    def _nearest(self, pose: Pose2) -> tuple[int, float]:
        away_m = np.hypot(self.poses[:, 0] - pose.x, self.poses[:, 1] - pose.y)
        nearest = int(away_m.argmin())
        return nearest, float(away_m[nearest])

    def _level(self, k: int) -> tuple[float, float]:
        """Return how well neighbours fit a view, and by how much that falls with the square of their distance."""
        if k not in self._levels:
            near = self._fits_along(k, 0.0, _NEXT_M)
            apart_m, fits = self._fits_along(k, _NEXT_M, 2.0 * _NEXT_M)
            level = float(near[1].mean()) if len(near[1]) else 0.97
            falls = (level - fits) / apart_m**2
            self._levels[k] = (level, float(falls.mean()) if len(falls) else 1.0)
        return self._levels[k]

    def _fits_along(self, k: int, least_m: float, most_m: float) -> tuple[Floats, Floats]:
        """Return how far other views are from one, and how well they fit it; up to four within the distances."""
        away_m = np.hypot(*(self.poses[:, :2] - self.poses[k, :2]).T)
        others = [int(j) for j in np.argsort(away_m) if least_m < away_m[j] <= most_m][:4]
        turned = [_turned(self.views[j], float(self.poses[j, 2] - self.poses[k, 2])) for j in others]
        fits = np.array([view_fit(self.views[k], view) for view in turned])
        tells = ~np.isnan(fits)
        return away_m[others][tells], fits[tells]


def _turned(view: Grey8, heading_rad: float) -> Grey8:
    """Return a view as seen with a heading that is smaller by an angle."""
    return np.roll(view, -round(math.degrees(heading_rad)), axis=1)
