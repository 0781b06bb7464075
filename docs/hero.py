"""Draw the picture at the head of the README from a run of the demo: ``python docs/hero.py runs/demo/replay``.

An animated SVG without a script: a robot drives a taught path again, its camera goes dark on the way, and the error
of what it believes is drawn as a colour and over time. Light and dark screens have their own colours.
"""

from __future__ import annotations

import sys
from base64 import b64encode
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.evaluation import evaluate_run_folder, read_run
from trailmark.evaluation.association import poses_at
from trailmark.report.gaps import find_gaps
from trailmark.report.style import css_variables

WIDTH, HEIGHT = 960, 440
#: How long the robot takes, and how long it stands at the end [s].
DRIVE_S, REST_S = 12.0, 2.0
#: It begins shortly before the camera goes dark, so that its first moment shows something.
TIMING = f'dur="{DRIVE_S + REST_S:g}s" begin="-4.2s" repeatCount="indefinite"'
MAP = (34.0, 60.0, 720.0, 190.0)
CAMERA = (756.0, 60.0, 182.0)
STRIP = (56.0, 300.0, 882.0, 104.0)
LOW_MM, HIGH_MM = 0.05, 100.0
HEAT_MM = (0.1, 0.2, 0.5, 1.0, 3.0)
STYLE = """
text { font: 14px system-ui, -apple-system, 'Segoe UI', Arial, sans-serif; fill: var(--ink); }
.small { font-size: 12px; fill: var(--muted); } .end { text-anchor: end; } .title { font-size: 16px; font-weight: 600; }
.robot { stroke: var(--ink); stroke-width: 1.6; fill: var(--paper); fill-opacity: 0.7; }
path:not(.robot) { fill: none; stroke-linejoin: round; stroke-linecap: round; }
.rule { stroke: var(--rule); stroke-width: 1; }
"""


def main() -> None:
    """Write ``docs/assets/demo.svg``."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/demo/replay")
    target = Path(__file__).parent / "assets" / "demo.svg"
    target.write_text(Hero(folder).text(), encoding="utf-8")
    print(f"{target}: {target.stat().st_size / 1000:.0f} kB")


class Hero:
    """A run of the demo as a moving picture.

    Parameters
    ----------
    folder : Path
        Of the replay.
    """

    def __init__(self, folder: Path) -> None:
        evaluated = evaluate_run_folder(read_run(folder))
        self.run = evaluated.run
        assert self.run.truth is not None
        self.truth = self.run.truth
        self.start_s, self.stop_s = float(self.truth.stamps_s[0]), float(self.truth.stamps_s[-1])
        self.ways = {
            name: evaluated.evaluations[name].absolute.alignment.apply(self.run.trajectories[name])
            for name in ("wheels", "fused")
        }
        assert self.run.estimates is not None
        gaps = find_gaps(self.run.estimates, (self.start_s, self.stop_s))
        dark = max((gap for gap in gaps if gap.name == "floor"), key=lambda gap: gap.stop_s - gap.start_s)
        self.dark_s = dark.start_s, dark.stop_s
        self._frame_map()

    def text(self) -> str:
        """Return the picture."""
        parts = [self._heading(), self._map(), self._camera(), self._strip()]
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="A robot'
        head += ' drives a taught path through four gates again; its camera is dark for two seconds on the way">'
        back = f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" style="fill: var(--paper)"/>'
        return "\n".join([head, f"<style>{css_variables()}{STYLE}</style>", back, *parts, "</svg>", ""])

    def _heading(self) -> str:
        length_m = self.truth.length_m()
        return (
            '<text class="title" x="34" y="34">Taught once, driven again by itself:'
            f" {length_m:.1f} m through four gates</text>"
            '<text class="small end" x="938" y="34">a camera that looks at the floor, and wheels</text>'
        )

    # --- the map

    def _frame_map(self) -> None:
        x0, y0, width, height = MAP
        low, high = self.truth.positions.min(axis=0) - 0.4, self.truth.positions.max(axis=0) + 0.4
        self.scale = min(width / (high[0] - low[0]), height / (high[1] - low[1]))
        middle = (low + high) / 2.0
        self.offset = np.array([x0 + width / 2.0 - self.scale * middle[0], y0 + height / 2.0 + self.scale * middle[1]])

    def _place(self, points: Floats) -> Floats:
        return np.column_stack([self.offset[0] + self.scale * points[:, 0], self.offset[1] - self.scale * points[:, 1]])

    def _map(self) -> str:
        stamps = np.linspace(self.start_s, self.stop_s, 400)
        way = self._place(poses_at(self.truth, stamps, 1.0)[:, :2])
        errors_mm = 1e3 * self._errors("fused", stamps)
        levels = np.searchsorted(HEAT_MM, np.nan_to_num(errors_mm))
        pieces = "".join(
            f'<path d="{_path(way[first : last + 2])}" style="stroke: var(--heat-{levels[first]})"/>'
            for first, last in _runs(levels)
        )
        dark = way[(stamps >= self.dark_s[0]) & (stamps <= self.dark_s[1])]
        label_x, label_y = dark.mean(axis=0)
        taught = _path(self._place(self.run.path_taught.positions)) if self.run.path_taught is not None else ""
        assert self.run.outlines is not None
        poles = "".join(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" style="fill: var(--muted)"/>'
            for x, y in (self._place(line).mean(axis=0) for line in self.run.outlines.around)
        )
        body = np.zeros((0, 2)) if self.run.outlines.robot is None else self.run.outlines.robot * self.scale
        drive = self._timeline("stroke-dashoffset", [(0.0, "1"), (1.0, "0")])
        motion = (
            f'<animateMotion {TIMING} rotate="auto" calcMode="linear"'
            f' keyPoints="0;1;1" keyTimes="0;{DRIVE_S / (DRIVE_S + REST_S):.4f};1" path="{_path(way)}"/>'
        )
        return f"""<mask id="driven" maskUnits="userSpaceOnUse" x="0" y="0" width="{WIDTH}" height="{HEIGHT}">
<path d="{_path(way)}" pathLength="1" stroke="#fff" stroke-width="12" stroke-dasharray="1"
 stroke-linecap="butt">{drive}</path></mask>
<path d="{_path(dark)}" style="stroke: var(--blind); stroke-width: 34; stroke-linecap: butt"/>
<text class="small" x="{label_x - 150:.0f}" y="{label_y - 4:.0f}">the camera is dark</text>
<path d="{taught}" style="stroke: var(--muted); stroke-width: 1.5; stroke-dasharray: 5 4"/>
{poles}<g mask="url(#driven)" stroke-width="5">{pieces}</g>
<g>{motion}<path d="{_path(body)}Z" class="robot"/>
<path d="M0 0H{body[:, 0].max() if len(body) else 12:.1f}" style="stroke: var(--ink); stroke-width: 1.6"/></g>
{self._legend()}"""

    def _legend(self) -> str:
        swatches = "".join(
            f'<rect x="{92 + 22 * level}" y="254" width="22" height="7" style="fill: var(--heat-{level})"/>'
            for level in range(len(HEAT_MM) + 1)
        )
        return (
            f'<text class="small" x="34" y="262">0.1 mm</text>{swatches}'
            '<text class="small" x="232" y="262">3 mm wrong</text>'
            '<path d="M330 258h34" style="stroke: var(--muted); stroke-width: 1.5; stroke-dasharray: 5 4"/>'
            '<text class="small" x="372" y="262">as it was taught</text>'
            '<circle cx="492" cy="258" r="4" style="fill: var(--muted)"/>'
            '<text class="small" x="502" y="262">poles, 0.5 m apart</text>'
        )

    def _errors(self, name: str, stamps_s: Floats) -> Floats:
        """Return the distance of a trajectory from the truth [m]."""
        apart = poses_at(self.ways[name], stamps_s, 0.2)[:, :2] - poses_at(self.truth, stamps_s, 1.0)[:, :2]
        return np.asarray(np.hypot(*apart.T))

    # --- what the camera sees

    def _camera(self) -> str:
        x, y, size = CAMERA
        files = sorted((self.run.path / "pictures").glob("floor_*.jpg"), key=_time_of)
        times = [_time_of(file) for file in files]
        shown = []
        for index, file in enumerate(files):
            since = times[index] if index else 0.0
            until = times[index + 1] if index + 1 < len(files) else self.stop_s - self.start_s
            data = b64encode(file.read_bytes()).decode()
            shown.append(
                f'<image x="{x}" y="{y}" width="{size}" height="{size * 0.94:.0f}" preserveAspectRatio="xMidYMid slice"'
                f' href="data:image/jpeg;base64,{data}" opacity="{int(index == 0)}">'
                f"{self._visible(since, until)}</image>"
            )
        dark = [second - self.start_s for second in self.dark_s]
        night = (
            f'<rect x="{x}" y="{y}" width="{size}" height="{size * 0.94:.0f}" opacity="0">{self._visible(*dark)}</rect>'
        )
        word = f'<text class="small" x="{x}" y="{y + size * 0.94 + 18:.0f}">what its camera sees</text>'
        return "".join(shown) + night + word

    def _visible(self, since_s: float, until_s: float) -> str:
        """Return an animation that shows something from one time of the run to another."""
        whole_s = self.stop_s - self.start_s
        since, until = since_s / whole_s, min(1.0, until_s / whole_s)
        steps = [(0.0, "1" if since <= 0.0 else "0"), *([(since, "1")] if since > 0.0 else [])]
        steps += [(until, "0")] if until < 1.0 else []
        return self._timeline("opacity", steps, "discrete")

    def _timeline(self, attribute: str, steps: Sequence[tuple[float, str]], mode: str = "linear") -> str:
        """Return an animation of an attribute over the drive; at the end it rests as it is."""
        share = DRIVE_S / (DRIVE_S + REST_S)
        times = [share * time for time, _ in steps] + [1.0]
        values = [value for _, value in steps] + [steps[-1][1]]
        if mode == "discrete":
            times, values = times[:-1], values[:-1]
        return (
            f'<animate attributeName="{attribute}" {TIMING} calcMode="{mode}"'
            f' keyTimes="{";".join(f"{time:.4f}" for time in times)}" values="{";".join(values)}"/>'
        )

    # --- the error over time

    def _strip(self) -> str:
        x, y, width, height = STRIP
        stamps = np.linspace(self.start_s, self.stop_s, 700)
        lines = {name: self._curve(stamps, 1e3 * self._errors(name, stamps)) for name in self.ways}
        rules = "".join(
            f'<path class="rule" d="M{x} {self._level(value):.1f}H{x + width}"/>'
            f'<text class="small end" x="{x - 8}" y="{self._level(value) + 4:.1f}">{value:g}</text>'
            for value in (0.1, 1.0, 10.0, 100.0)
        )
        first, last = (x + width * (second - self.start_s) / (self.stop_s - self.start_s) for second in self.dark_s)
        cover = self._timeline("width", [(0.0, "0"), (1.0, str(width))])
        cursor = self._timeline("x", [(0.0, str(x)), (1.0, str(x + width))])
        seconds = f"{self.stop_s - self.start_s:.0f} s"
        return f"""<text class="small" x="34" y="{y - 12}">position error [mm] over {seconds}, logarithmic</text>
<rect x="{first:.1f}" y="{y}" width="{last - first:.1f}" height="{height}" style="fill: var(--blind)"/>{rules}
<clipPath id="passed"><rect x="{x}" y="{y - 2}" height="{height + 4}" width="{width}">{cover}</rect></clipPath>
<g clip-path="url(#passed)"><path d="{self._band()}" style="fill: var(--muted); fill-opacity: 0.18; stroke: none"/>
<path d="{lines["wheels"]}" style="stroke: var(--series-2); stroke-width: 1.8"/>
<path d="{lines["fused"]}" style="stroke: var(--ink); stroke-width: 1.8"/></g>
<rect x="{x + width}" y="{y}" width="1.5" height="{height}" style="fill: var(--ink)">{cursor}</rect>
<text class="small" x="{x}" y="{HEIGHT - 12}"><tspan style="fill: var(--ink); font-weight: 600">both together</tspan>,
 and three sigmas of what they believe;
 <tspan style="fill: var(--series-2); font-weight: 600">the wheels alone</tspan></text>"""

    def _level(self, value_mm: float) -> float:
        _, y, _, height = STRIP
        share = np.log(max(value_mm, LOW_MM) / LOW_MM) / np.log(HIGH_MM / LOW_MM)
        return float(y + height * (1.0 - min(1.0, share)))

    def _curve(self, stamps: Floats, values_mm: Floats) -> str:
        known = np.isfinite(values_mm)
        return _path(self._on_strip(stamps[known], values_mm[known]))

    def _on_strip(self, stamps: Floats, values_mm: Floats) -> Floats:
        x, _, width, _ = STRIP
        along = x + width * (stamps - self.start_s) / (self.stop_s - self.start_s)
        return np.column_stack([along, [self._level(value) for value in values_mm]])

    def _band(self) -> str:
        """Return the area below three standard deviations: the largest of each third of a second."""
        beliefs = self.run.beliefs
        assert beliefs is not None
        sigmas_mm = 3e3 * np.sqrt(np.linalg.eigvalsh(beliefs.covariances[:, :2, :2])[:, 1])
        bins = np.floor((beliefs.stamps_s - self.start_s) / 0.33).astype(int)
        stamps = np.array([beliefs.stamps_s[bins == k].mean() for k in np.unique(bins)])
        upper = self._on_strip(stamps, np.array([sigmas_mm[bins == k].max() for k in np.unique(bins)]))
        floor = STRIP[1] + STRIP[3]
        return f"{_path(upper)}L{upper[-1, 0]:.1f} {floor}L{upper[0, 0]:.1f} {floor}Z"


def _runs(levels: Floats) -> list[tuple[int, int]]:
    """Return the first and last index of each stretch of equal numbers."""
    cuts = np.flatnonzero(np.diff(levels)) + 1
    edges = [0, *cuts.tolist(), len(levels)]
    return [(first, last - 1) for first, last in pairwise(edges)]


def _time_of(file: Path) -> float:
    return float(file.stem.rpartition("_")[2].rstrip("s"))


def _path(points: Floats) -> str:
    return "".join(f"{'L' if index else 'M'}{x:.1f} {y:.1f}" for index, (x, y) in enumerate(points))


if __name__ == "__main__":
    main()
