"""The paper's experiments, in the simulator: ``trailmark reproduce toth2015``."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import begin_with, over_places
from trailmark_papers.toth2015.disturbances import disturbance_plans, disturbance_rows, draw_disturbances
from trailmark_papers.toth2015.drives import drive
from trailmark_papers.toth2015.light import light_plans, light_rows
from trailmark_papers.toth2015.places import draw_places, place_plans, place_rows
from trailmark_papers.toth2015.registration import registration_plans, registration_rows
from trailmark_papers.toth2015.speeds import speed_plans, speed_rows
from trailmark_papers.toth2015.stage_pictures import draw_stages

__all__ = ["PARTS", "toth2015"]

_N_PLACES = 5
#: The figures by which the paper is judged.
_HEADLINES = (
    "*, * m: landmarks: p*",
    "laboratory, * m: two landmarks, one in reserve: p*",
    "*, rate: landmarks",
    "laboratory, 0.3 m/s at 2 fps: landmarks: position, rms",
    "laboratory, 1 m/s *: landmarks: position, rms",
    "laboratory, * m: fuzzy control, *: position, rms",
    "laboratory, rate: fuzzy control, *",
    "* a landmark walks away: landmarks: largest jump",
    "*, people cross: landmarks: largest jump",
    "laboratory, lamps to 20 %, fixed exposure: by colours, *: position, rms",
    "laboratory, half of the view black, *: by colours, *: position, rms",
    "laboratory, depth not registered: *: position, rms",
)
#: The drives of each part of the experiment, and the rows that they give.
PARTS = (
    (place_plans, place_rows),
    (speed_plans, speed_rows),
    (disturbance_plans, disturbance_rows),
    (light_plans, light_rows),
    (registration_plans, registration_rows),
)


def toth2015(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat what Toth et al. 2015 report, and what they leave open."""
    return begin_with(over_places(options, _rows_of_place, _N_PLACES), *_HEADLINES)


def _rows_of_place(options: ExperimentOptions) -> list[Row]:
    plans = [plans_of(options) for plans_of, _ in PARTS]
    # All drives at once, so that no process waits for the longest of a part.
    calls = [(plan,) for part in plans for plan in part]
    options.report(f"{len(calls)} drives")
    driven = iter(options.map(drive, calls))
    found = [[next(driven) for _ in part] for part in plans]
    draw_places(options, found[0])
    draw_disturbances(options, found[2])
    draw_stages(options)
    return [row for (_, rows_of), part in zip(PARTS, found) for row in rows_of(part)]
