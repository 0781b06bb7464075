"""An RGB-D camera and landmarks in its pictures (Toth et al. 2015).

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_kinect_landmarks.config import KinectFlowConfig, KinectLandmarksConfig
    from trailmark_kinect_landmarks.flow import KinectFlow
    from trailmark_kinect_landmarks.localizer import KinectLandmarks, KinectMotion

__all__ = ["KinectFlow", "KinectFlowConfig", "KinectLandmarks", "KinectLandmarksConfig", "KinectMotion"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": (
            "KinectFlowConfig",
            "KinectLandmarksConfig",
        ),
        "flow": ("KinectFlow",),
        "localizer": (
            "KinectLandmarks",
            "KinectMotion",
        ),
    },
)
