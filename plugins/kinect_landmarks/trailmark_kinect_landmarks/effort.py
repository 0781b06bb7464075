"""How much to do for a picture: the fuzzy controller's inputs, and a model of what finders cost."""

from __future__ import annotations

import logging

from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.fuzzy import Fuzzy, SearchPlan

__all__ = ["COSTS_MS", "Effort"]

logger = logging.getLogger(__name__)

#: Milliseconds per megapixel of working resolution, measured on one core on the recording of the benchmark.
COSTS_MS = {
    "blobs": 4.5,
    "rectangles": 12.0,  # Canny's edges and their contours, which the next two share
    "edges": 5.0,
    "ellipses": 1.5,
    "lines": 5.5,
    "flats": 1.5,
    "mser": 12.0,
    "hough_circles": 45.0,
}
_FIXED_MS = 30.0  # per megapixel of the whole picture: depth, cornerness, flow
_EACH_MS = 0.08  # per landmark
_DEFAULT_ALLOWED_MS = 1000.0 / 15.0


class Effort:
    """Keeps the rate: plans what to do with a picture by light, landmarks and time.

    Parameters
    ----------
    config : KinectLandmarksConfig
        What may run.
    rate_hz : float or None
        Of the camera [Hz].
    """

    def __init__(self, config: KinectLandmarksConfig, rate_hz: float | None) -> None:
        self._config = config
        self._fuzzy = Fuzzy(config.finders)
        usual_ms = 1000.0 / rate_hz if rate_hz else _DEFAULT_ALLOWED_MS
        self._allowed_s = (config.allowed_ms or usual_ms) / 1000.0
        self._light, self._n_agree = 1.0, 0
        self._plan = SearchPlan(config.finders, 1.0, True)
        self._n_finders = 0  # that looked at the last picture
        self._took_s = 0.0  # for the last picture at which finders looked
        self._is_timed = False  # whether the frame before was such a picture
        #: Of the last picture, by the model [s].
        self.latency_s = 0.0

    def note_time(self, last_latency_s: float) -> None:
        """Take how long the frame before took [s]; it counts only if finders looked at it.

        A picture at which they rested, or a reading of the light, says nothing of what their work costs.
        """
        if self._is_timed:
            self._took_s, self._is_timed = last_latency_s, False

    def plan(self) -> SearchPlan:
        """Return what to do with the next picture; all of it on the whole picture where nothing is to adapt."""
        self._is_timed = True
        if not self._config.adapt:
            return self._plan
        share = self._n_agree / self._config.landmarks
        plan = self._fuzzy.plan(self._light, share, self._took_s / self._allowed_s)
        if plan != self._plan:
            logger.debug("light %.2f, landmarks %.2f, last %.3f s: %s", self._light, share, self._took_s, plan)
        self._plan = plan
        return plan

    def note_picture(self, picture: PreparedImage, done: SearchPlan, n_seen: int, n_agree: int) -> None:
        """Take what the last picture gave, and what was done with it."""
        self._light, self._n_agree = picture.light, n_agree
        self._n_finders = len(done.finders)
        self._is_timed = self._n_finders > 0
        megapixels = picture.grey.size * 1e-6
        finders_ms = sum(COSTS_MS[name] for name in done.finders) * megapixels * done.scale**2
        self.latency_s = (finders_ms + _FIXED_MS * megapixels + _EACH_MS * n_seen) / 1000.0

    def details(self) -> dict[str, float]:
        """Return in numbers what was done with the last picture, for the record."""
        return {"n_finders": float(self._n_finders), "scale": self._plan.scale}
