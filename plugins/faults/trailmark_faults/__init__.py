"""What can be wrong with a sensor: faults of pictures, depth, scans, time and calibration.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_faults.basic import BasicConfig, BasicFault
    from trailmark_faults.depth import DepthHoles, DepthHolesConfig, DepthShift, DepthShiftConfig
    from trailmark_faults.lens import (
        Cover,
        CoverConfig,
        Glints,
        GlintsConfig,
        LensMarks,
        LensMarksConfig,
        Vignette,
        VignetteConfig,
    )
    from trailmark_faults.light import (
        Mains,
        MainsConfig,
        OverExposure,
        OverExposureConfig,
        WanderingShadow,
        WanderingShadowConfig,
    )
    from trailmark_faults.scan import BlindSector, BlindSectorConfig
    from trailmark_faults.sensor import LowLight, LowLightConfig, MotionBlur, MotionBlurConfig, Specks, SpecksConfig
    from trailmark_faults.timing import Frozen, FrozenConfig, Jitter, JitterConfig, Repeated, RepeatedConfig
    from trailmark_faults.wet import WetPatch, WetPatchConfig

__all__ = [
    "BasicConfig",
    "BasicFault",
    "BlindSector",
    "BlindSectorConfig",
    "Cover",
    "CoverConfig",
    "DepthHoles",
    "DepthHolesConfig",
    "DepthShift",
    "DepthShiftConfig",
    "Frozen",
    "FrozenConfig",
    "Glints",
    "GlintsConfig",
    "Jitter",
    "JitterConfig",
    "LensMarks",
    "LensMarksConfig",
    "LowLight",
    "LowLightConfig",
    "Mains",
    "MainsConfig",
    "MotionBlur",
    "MotionBlurConfig",
    "OverExposure",
    "OverExposureConfig",
    "Repeated",
    "RepeatedConfig",
    "Specks",
    "SpecksConfig",
    "Vignette",
    "VignetteConfig",
    "WanderingShadow",
    "WanderingShadowConfig",
    "WetPatch",
    "WetPatchConfig",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "basic": (
            "BasicConfig",
            "BasicFault",
        ),
        "depth": (
            "DepthHoles",
            "DepthHolesConfig",
            "DepthShift",
            "DepthShiftConfig",
        ),
        "lens": (
            "Cover",
            "CoverConfig",
            "Glints",
            "GlintsConfig",
            "LensMarks",
            "LensMarksConfig",
            "Vignette",
            "VignetteConfig",
        ),
        "light": (
            "Mains",
            "MainsConfig",
            "OverExposure",
            "OverExposureConfig",
            "WanderingShadow",
            "WanderingShadowConfig",
        ),
        "scan": (
            "BlindSector",
            "BlindSectorConfig",
        ),
        "sensor": (
            "LowLight",
            "LowLightConfig",
            "MotionBlur",
            "MotionBlurConfig",
            "Specks",
            "SpecksConfig",
        ),
        "timing": (
            "Frozen",
            "FrozenConfig",
            "Jitter",
            "JitterConfig",
            "Repeated",
            "RepeatedConfig",
        ),
        "wet": (
            "WetPatch",
            "WetPatchConfig",
        ),
    },
)
