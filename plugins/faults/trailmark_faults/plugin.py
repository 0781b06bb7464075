"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


#: Name, module and class, and what it is; the config is called like the class, with ``Config`` behind it.
_FAULTS = (
    ("lens_marks", "lens:LensMarks", "Dirt, scratches and drops on the lens"),
    ("glints", "lens:Glints", "Reflections of lamps that move with the camera, as of a ring light on a glossy floor"),
    ("vignette", "lens:Vignette", "Corners darker than the middle"),
    ("cover", "lens:Cover", "Something lies on the lens from some time on"),
    ("wandering_shadow", "light:WanderingShadow", "The edge of a shadow swings through the picture"),
    ("mains", "light:Mains", "Lamps on alternating current; bands with a rolling shutter"),
    ("over_exposure", "light:OverExposure", "Out of the shade into the sun, until the camera has got used to it"),
    ("wet_patch", "wet:WetPatch", "Water on the floor: darker, less contrast, sliding highlights"),
    ("low_light", "sensor:LowLight", "Too little light, with shot and read noise"),
    ("motion_blur", "sensor:MotionBlur", "Pictures smeared along a line"),
    ("specks", "sensor:Specks", "Grains in front of the camera, at other places in every picture"),
    ("depth_holes", "depth:DepthHoles", "Depth that is unknown in places"),
    ("depth_shift", "depth:DepthShift", "Depth that is not registered to colour"),
    ("blind_sector", "scan:BlindSector", "Beams of a laser that never return"),
    ("frozen", "timing:Frozen", "The last reading again and again, with new stamps"),
    ("repeated", "timing:Repeated", "Some readings are the one before again"),
    ("jitter", "timing:Jitter", "Frames are late, now shorter, now longer"),
)


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the faults."""
    registry.fault(
        "basic",
        "trailmark_faults.basic:BasicFault",
        config="trailmark_faults.basic:BasicConfig",
        summary="Noise, blur, brightness, lost and late frames, occluders, a wrong calibration: directly under perturb",
    )
    for name, target, summary in _FAULTS:
        full = f"trailmark_faults.{target}"
        registry.fault(name, full, config=f"{full}Config", summary=summary)
