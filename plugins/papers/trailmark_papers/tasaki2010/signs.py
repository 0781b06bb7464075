"""Fig. 1 and Sec. IV: a landmark from four positions, and what becomes a landmark ("the robot selects signs").

The simulator knows what every pixel shows, so that each landmark can be named by what it was seen on.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray, Floats, Grey8
from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Omni
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.report.drawing import RED, drawing
from trailmark_omni_surf.circle import BearingCamera
from trailmark_omni_surf.landmark_map import Candidates, measured_candidates
from trailmark_omni_surf.selection import shipped_model
from trailmark_papers.kit import Table, keyframes_of, started_source, world_of
from trailmark_papers.tasaki2010.place import TaughtPlace

__all__ = ["Sightings", "draw_landmark", "pixels_of", "sightings_of", "sign_rows", "spread_sightings"]

_N_PICTURES = 4
_LONGEST = {"the default's K = 40": 40, "the paper's K = 9": 9}
_RING_PX = 9.0


@dataclass(slots=True)
class Sightings:
    """Where a tracked point was seen while teaching.

    Attributes
    ----------
    labels : Counter
        What the pixels showed, by how often.
    poses : list of Pose2
        Of base.
    uv : list of (float, float)
        Pixels.
    """

    labels: Counter[str] = field(default_factory=Counter)
    poses: list[Pose2] = field(default_factory=list)
    uv: list[tuple[float, float]] = field(default_factory=list)

    @property
    def label(self) -> str:
        """What it was seen on most often."""
        return self.labels.most_common(1)[0][0] if self.labels else ""


def sign_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return what candidates and landmarks were seen on, and draw Fig. 1."""
    keyframes = keyframes_of(place.store, "omni")
    with started_source(place.source(sensors=["omni"]), options.seed) as robot:
        camera = world_of(robot).sensors[0]
        seen = sightings_of(keyframes, camera)
        candidates, chosen = _selected(keyframes, _LONGEST["the default's K = 40"])
        landmarks = [int(k) for k in candidates.ids[chosen]]
        _draw(options.out / "tasaki2010_fig1_landmark.svg", camera, seen, landmarks)
    table = Table("Fig. 1, what landmarks are")
    for name, n_longest in _LONGEST.items():
        candidates, chosen = _selected(keyframes, n_longest)
        labels = np.array([seen[int(k)].label for k in candidates.ids])
        for who, some in (("candidates", labels), ("selected", labels[chosen])):
            counts = ", ".join(f"{label or 'not known'} {n}" for label, n in Counter(some.tolist()).most_common())
            table.add_higher(f"{name}, {who}: on signs", "%", _percent(some == "sign"), n=len(some), note=counts)
    options.report(f"Fig. 1: {table.rows[1].note}")
    return table.rows


def _selected(keyframes: Sequence[Keyframe], n_longest: int) -> tuple[Candidates, AnyArray]:
    """Return candidates, and which of them the shipped machine selects."""
    candidates = measured_candidates(keyframes, n_longest)
    return candidates, np.flatnonzero(shipped_model().probability(candidates.features) >= 0.5)


def _percent(holds: AnyArray) -> float | None:
    return 100.0 * float(holds.mean()) if len(holds) else None


def sightings_of(keyframes: Sequence[Keyframe], camera: Any) -> Mapping[int, Sightings]:
    """Return the sightings of every track, each named by what its pixel showed from the pose of the keyframe.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        Of the camera's localizer.
    camera : CameraSensor
        The simulated camera; nobody walks about while it looks.
    """
    seen: dict[int, Sightings] = defaultdict(Sightings)
    for keyframe in keyframes:
        pose, arrays = keyframe.pose_map_base, keyframe.arrays
        labels = camera.view_from(pose, keyframe.stamp_s).labels()
        pixels = pixels_of(camera.info.calibration, arrays["bearings"], arrays["distances_px"])
        height, width = labels.shape
        for track_id, (u, v) in zip(arrays["ids"].tolist(), pixels.tolist(), strict=True):
            one = seen[track_id]
            one.poses.append(pose)
            one.uv.append((u, v))
            label = str(labels[min(max(round(v), 0), height - 1), min(max(round(u), 0), width - 1)])
            if label:
                one.labels[label] += 1
    return seen


def pixels_of(calibration: Omni, bearings_rad: Floats, distances_px: Floats) -> Floats:
    """Return the pixels (N, 2) that are seen under bearings, at distances from the centre of the circle [px]."""
    camera = BearingCamera.of(calibration, None)
    centre = np.array([camera.centre_u, camera.centre_v])
    angles = camera.sign * np.asarray(bearings_rad, np.float64) + camera.forward_rad
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray(centre + np.asarray(distances_px, np.float64)[:, None] * rays)


def _draw(path: Path, camera: Any, seen: Mapping[int, Sightings], landmarks: Sequence[int]) -> None:
    """Draw the landmark on a sign, or else any, that was seen from places farthest apart."""
    on_signs = [k for k in landmarks if seen[k].label == "sign"] or list(landmarks)
    if on_signs:
        draw_landmark(path, camera, max((seen[k] for k in on_signs), key=_extent_m))


def _extent_m(one: Sightings) -> float:
    positions = np.array([(pose.x, pose.y) for pose in one.poses])
    return float(np.hypot(*np.ptp(positions, axis=0)))


def spread_sightings(one: Sightings, n: int) -> list[int]:
    """Return which of the sightings are spread evenly over the way on which it was seen, `n` at most."""
    return sorted({round(k) for k in np.linspace(0, len(one.poses) - 1, n).tolist()})


def draw_landmark(path: Path, camera: Any, one: Sightings) -> None:
    """Draw the pictures of four of the places from which a landmark was seen, with a ring about it (Fig. 1)."""
    from matplotlib.patches import Circle

    chosen = spread_sightings(one, _N_PICTURES)
    with drawing(path, 5.6, 2, 2, name="fig1") as (figure, _):
        for axes in figure.axes:
            axes.set_axis_off()
        for axes, k in zip(figure.axes, chosen):
            pixels: Grey8 = camera.picture_from(one.poses[k], k).pixels
            grey = pixels if pixels.ndim == 2 else pixels[..., ::-1]
            axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axes.add_patch(Circle(one.uv[k], _RING_PX, fill=False, edgecolor=RED, linestyle="dotted", linewidth=1.6))
            axes.set_title(f"from ({one.poses[k].x:.1f}, {one.poses[k].y:.1f}) m")
