"""Draw the pictures of the page on frames and axes: ``python docs/axes.py``.

Every arrow is computed by the poses of Trailmark, so that the pictures cannot say anything else than the code.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2, Pose3
from trailmark.report.style import css_variables

WIDTH = 960
STYLE = """
text { font: 15px system-ui, -apple-system, 'Segoe UI', Arial, sans-serif; fill: var(--ink); }
.small { font-size: 13px; fill: var(--muted); } .title { font-weight: 600; } .middle { text-anchor: middle; }
path, line { fill: none; stroke-linecap: round; stroke-linejoin: round; stroke-width: 2.5; }
.body { stroke: var(--muted); stroke-width: 1.3; fill: var(--rule); fill-opacity: 0.35; }
.over { paint-order: stroke; stroke: var(--paper); stroke-width: 6; }
.x { stroke: #d1495b; } .y { stroke: #2e9e6b; } .z { stroke: #2f7fc1; } .pose { stroke: var(--ink); stroke-width: 1.5; }
text.x { fill: #d1495b; stroke: none; } text.y { fill: #2e9e6b; stroke: none; } text.z { fill: #2f7fc1; stroke: none; }
"""
#: Where x, y and z of a robot point on the paper: forward to the right, left into it, up.
ON_PAPER = np.array([[1.0, 0.55, 0.0], [0.3, -0.42, -1.0]])
#: Columns: right, down and forward of a picture in the axes of its sensor.
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
HEAD = (
    '<marker id="head" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="5" markerHeight="5" orient="auto">'
    '<path d="M0 0L10 5L0 10Z" style="fill: context-stroke; stroke: none"/></marker>'
)


def main() -> None:
    """Write the two pictures."""
    assets = Path(__file__).parent / "assets"
    for name, picture in (("axes-robot", robot_picture()), ("axes-map", map_picture())):
        target = assets / f"{name}.svg"
        target.write_text(picture, encoding="utf-8")
        print(f"{target}: {target.stat().st_size / 1000:.1f} kB")


def robot_picture() -> str:
    """Return base, a camera that looks 30 degrees down, and the picture's own axes."""
    parts = [box((150, 190), (1.5, 0.9, 0.35), 70), *axes((150, 190), np.eye(3), "xyz", 95)]
    parts += [label((150, 300), "base", "x forward, y left, z up")]
    mounting = Pose3(pitch=math.radians(30.0))
    parts += [box((465, 170), (0.45, 0.45, 0.35), 70, mounting.rotation())]
    parts += axes((465, 170), mounting.rotation(), "xyz", 95)
    parts += [label((465, 300), "a camera as a sensor", "the same axes, turned by its mounting: pitch_deg: 30")]
    parts += [box((795, 170), (0.45, 0.45, 0.35), 70, mounting.rotation())]
    parts += axes((795, 170), mounting.rotation() @ OPTICAL, "xyz", 95)
    parts += [label((795, 300), "the same camera, optical", "x right, y down, z forward; so are u and v")]
    return drawing(parts, 335)


def map_picture() -> str:
    """Return map, odom and base from above, and the poses between them."""
    pose_map_odom, pose_odom_base = Pose2(2.0, 0.5, 0.35), Pose2(2.9, 0.25, 0.5)
    pose_map_base = pose_map_odom @ pose_odom_base
    parts = []
    places = {}
    for name, pose, words in (
        ("map", Pose2(), "where it was taught"),
        ("odom", pose_map_odom, "where the run began, as motion alone has it"),
        ("base", pose_map_base, "the robot"),
    ):
        x, y = above(pose)
        places[name] = (x, y)
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(pose.theta), -math.sin(pose.theta)], [math.sin(pose.theta), math.cos(pose.theta)]]
        parts += axes((x, y), turn, "xy", 75, np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
        parts += [label((x, y + 36), name, words)]
    for start, end, words, lift in (
        ("map", "odom", "pose_map_odom: the correction", -46),
        ("odom", "base", "pose_odom_base: motion, never jumps", -56),
        ("map", "base", "pose_map_base = pose_map_odom @ pose_odom_base", -190),
    ):
        parts.append(arc(places[start], places[end], words, lift))
    return drawing(parts, 380)


def above(pose: Pose2) -> tuple[float, float]:
    """Return where the origin of a pose is on the paper, seen from above."""
    return 110.0 + 150.0 * pose.x, 300.0 - 95.0 * pose.y


def axes(
    origin: tuple[float, float], directions: Floats, names: str, length: float, on_paper: Floats = ON_PAPER
) -> list[str]:
    """Return arrows along the columns of a rotation, with their names."""
    parts = []
    for i, name in enumerate(names):
        dx, dy = length * (on_paper @ directions[:, i])
        x, y = origin[0] + dx, origin[1] + dy
        line = f'x1="{origin[0]}" y1="{origin[1]}" x2="{x:.1f}" y2="{y:.1f}"'
        parts.append(f'<line class="{name}" {line} marker-end="url(#head)"/>')
        far = 1.0 + 16.0 / max(1.0, math.hypot(dx, dy))
        place = f'x="{origin[0] + far * dx:.1f}" y="{origin[1] + far * dy + 5:.1f}"'
        parts.append(f'<text class="{name} middle" {place}>{name}</text>')
    return parts


def box(origin: tuple[float, float], size: tuple[float, float, float], scale: float, turn: Floats | None = None) -> str:
    """Return a box about an origin, drawn by its faces."""
    turn = np.eye(3) if turn is None else turn
    corners = {
        (i, j, k): ON_PAPER @ turn @ (scale * np.array([i, j, k]) * np.array(size) / 2.0)
        for i in (-1, 1)
        for j in (-1, 1)
        for k in (-1, 1)
    }
    faces = []
    for axis in range(3):
        for side in (-1, 1):
            ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
            keys = [tuple(np.insert(pair, axis, side).tolist()) for pair in ring]
            points = " ".join(f"{origin[0] + x:.1f},{origin[1] + y:.1f}" for x, y in (corners[key] for key in keys))
            faces.append(f'<polygon class="body" points="{points}"/>')
    return "".join(faces)


def arc(start: tuple[float, float], end: tuple[float, float], words: str, lift: float) -> str:
    """Return a bent arrow with words at its top."""
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + lift
    top = (start[1] + end[1]) / 4 + y / 2
    bend = f"M{start[0]:.1f} {start[1]:.1f}Q{x:.1f} {y:.1f} {end[0]:.1f} {end[1]:.1f}"
    return (
        f'<path class="pose" d="{bend}" marker-end="url(#head)"/>'
        f'<text class="small middle over" x="{x:.1f}" y="{top - 24:.1f}">{words}</text>'
    )


def label(place: tuple[float, float], title: str, words: str) -> str:
    """Return a name and what it is."""
    return (
        f'<text class="title middle" x="{place[0]:.1f}" y="{place[1]:.1f}">{title}</text>'
        f'<text class="small middle" x="{place[0]:.1f}" y="{place[1] + 20:.1f}">{words}</text>'
    )


def drawing(parts: list[str], height: int) -> str:
    """Return a whole picture, for light and dark screens."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}">\n'
        f"<style>\n{css_variables()}{STYLE}</style>\n<defs>{HEAD}</defs>\n"
        f'<rect width="{WIDTH}" height="{height}" fill="var(--paper)"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


if __name__ == "__main__":
    main()
