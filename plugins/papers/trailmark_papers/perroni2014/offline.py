"""Figs. 3 and 4: shifts of drives that were turned aside, against a reference, in the street and in the corridor.

The robot believes its wheels alone: it thinks that it is on the path and drives straight ahead, to where it was
turned. All localizers look at the same pictures and are only recorded. The truth is the median displacement of what
the upper half shows, between the two poses that an answer says belong together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from trailmark.arrays import Depth, Floats
from trailmark.estimates import PathOffset
from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import RGBD, Pinhole
from trailmark.geometry import Trajectory
from trailmark.pipeline import Pipeline, Step
from trailmark_papers.kit import AnswerKeeper, FrameKeeper, Table, beside_faithful, group_by, sweep, truth_of
from trailmark_papers.perroni2014.drives import AFTERNOON, FAITHFUL, PEERS, STREAMS, Localizers, Place, Replay, Taught
from trailmark_papers.perroni2014.plots import draw_shifts
from trailmark_papers.perroni2014.true_shift import Eyepiece, Surroundings

__all__ = ["LOCALIZERS", "DepthKeeper", "DriveAnswers", "compare", "offline_drive", "offline_rows", "with_depth"]

_WIDTH_PX = 160
_LENGTH_M = 10.0
_N_SEEDS = 1
_DEPTH_HZ = 2.0
_WINDOW = 25  # pictures of a stream
LOCALIZERS: Localizers = {
    "streams": STREAMS,
    "stream_alone": {**STREAMS, "when_blind": "silent"},
    "faithful": FAITHFUL,
    **PEERS,
}
#: What differs from teaching in the morning with nobody about.
_CONDITIONS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "street": {
        "6 people, 2 more parked cars": {"people": 6, "cars": 6},
        "overexposed 2.8 times": {**AFTERNOON, "exposure": 1.0},
    },
    "corridor": {
        "6 people, half of the lamps": {"people": 6, "lamps": "half"},
        "overexposed 2.4 times": {**AFTERNOON, "exposure": 5.0},
    },
}
_FIGURES = {"street": "Fig. 3", "corridor": "Fig. 4"}


@dataclass(slots=True)
class DriveAnswers:
    """What one localizer said in one drive.

    Attributes
    ----------
    said, true : list of float
        Shifts [columns].
    stations_m : list of float
        Of the answers [m].
    misses_m : list of float
        How far the station of each answer is from the true one [m].
    n_lost : int
        Pictures that it did not speak on.
    n_collecting : int
        How many of them are among the first 25, of which a stream must be collected before it can say anything.
    """

    said: list[float] = field(default_factory=list)
    true: list[float] = field(default_factory=list)
    stations_m: list[float] = field(default_factory=list)
    misses_m: list[float] = field(default_factory=list)
    n_lost: int = 0
    n_collecting: int = 0

    @property
    def n_pictures(self) -> int:
        """Pictures that it was shown."""
        return len(self.said) + self.n_lost

    @property
    def spoken_percent(self) -> float:
        """Share of the pictures that it spoke on [%]."""
        return 100.0 * len(self.said) / max(1, self.n_pictures)


class DepthKeeper(FrameKeeper[Depth]):
    """Keeps the depth pictures of a drive, as a pipeline's ``on_step``."""

    def __init__(self) -> None:
        super().__init__(RGBD, lambda payload: payload.depth_m)
        self._eyepiece: Eyepiece | None = None

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Keep the depth of a step that has one."""
        super().__call__(pipeline, step)
        if self.values and self._eyepiece is None:
            info = pipeline.sensors["front"]
            assert isinstance(info.calibration, Pinhole)
            assert info.size is not None
            self._eyepiece = Eyepiece(info.calibration, info.size, info.pose_base_sensor)

    def surroundings(self, truth: Trajectory) -> Surroundings:
        """Return what there was to see; `truth` is where the robot was."""
        assert self._eyepiece is not None
        poses = [truth.at([stamp_s])[0][1] for stamp_s in self.stamps_s]
        points = [self._eyepiece.points(depth, pose) for depth, pose in zip(self.values, poses, strict=True)]
        return Surroundings(self._eyepiece, poses, points)


#: What every localizer said in one drive.
Drive: TypeAlias = dict[str, DriveAnswers]
#: The drives of a condition and an angle [deg].
Found: TypeAlias = Mapping[tuple[str, float], list[Drive]]


def with_depth() -> dict[str, Any]:
    """Return the option by which the source gives depth too."""
    return {"sensors": ["wheels", "front", "front_depth"], "rates_hz": {"front_depth": _DEPTH_HZ}}


def offline_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Figs. 3 and 4, and draw them."""
    if options.quick:
        return _rows_of(options, Place("corridor", 4.0, _WIDTH_PX, world_seed=options.world_seed), (5.0,), {})
    return [
        row
        for world, conditions in _CONDITIONS.items()
        for row in _rows_of(
            options,
            Place(world, _LENGTH_M, _WIDTH_PX, world_seed=options.world_seed),
            (0.0, 5.0, -5.0),
            conditions,
        )
    ]


def _rows_of(
    options: ExperimentOptions, place: Place, angles_deg: Sequence[float], conditions: Mapping[str, Mapping[str, Any]]
) -> list[Row]:
    keeper, folder = DepthKeeper(), options.out / "runs" / f"offline-{place.world}"
    taught = place.teach(folder, LOCALIZERS, options.seed, on_step=keeper, sensors=with_depth())
    around = keeper.surroundings(taught.truth)
    cells: dict[tuple[str, float, int], tuple[Any, ...]] = {
        ("", angle, k): (taught, around, AFTERNOON, angle, options.seed + k)
        for angle in angles_deg
        for k in range(_N_SEEDS)
    } | {
        (condition, angle, 0): (taught, around, given, angle, options.seed)
        for condition, given in conditions.items()
        for angle in (5.0, -5.0)
    }
    found = group_by(sweep(options, offline_drive, cells), lambda cell: cell[:2])
    figure = _FIGURES[place.world]
    options.report(f"{figure} {place.world}: {len(cells)} drives")
    first = {angle: _series(found["", angle][0]["streams"]) for angle in angles_deg}
    draw_shifts(options.out / f"figure_{figure[-1]}_{place.world}.svg", first)
    turned = [angle for angle in angles_deg if angle != 0.0]
    rows = _rows_of_drives(f"{figure} {place.world}, 0 deg", found.get(("", 0.0), []), is_turned=False)
    sides = "/".join(f"{angle:+g}" for angle in turned)
    rows += _rows_of_drives(f"{figure} {place.world}, {sides} deg", _of_both(found, "", turned))
    for condition in conditions:
        rows += _rows_of_drives(f"{place.world}, {condition}, +5/-5 deg", _of_both(found, condition, (5.0, -5.0)))
    return rows


def _of_both(
    found: Mapping[tuple[str, float], list[Drive]], condition: str, angles_deg: Iterable[float]
) -> list[Drive]:
    return [drive for angle in angles_deg for drive in found[condition, angle]]


def offline_drive(
    taught: Taught, around: Surroundings, given: Mapping[str, Any], turned_deg: float, seed: int
) -> dict[str, DriveAnswers]:
    """Drive straight ahead from a start turned aside; return what every localizer said, beside the truth."""
    keeper = AnswerKeeper(LOCALIZERS)
    result = taught.replay(Replay(LOCALIZERS, seed, given, turned_deg, use=[]), keeper)
    return compare(keeper.answers, taught, around, truth_of(result))


def compare(
    told: Iterable[tuple[str, float, PathOffset | None]], taught: Taught, around: Surroundings, truth: Trajectory
) -> dict[str, DriveAnswers]:
    """Set what localizers said beside the truth.

    Parameters
    ----------
    told : iterable of (str, float, PathOffset or None)
        Who said when what; None for `Lost`.
    truth : Trajectory
        Of the replay.
    """
    answers: dict[str, DriveAnswers] = {}
    ways_m, column_px = taught.truth.travelled_m(), taught.place.width_px // 50
    for name, stamp_s, offset in told:
        answer = answers.setdefault(name, DriveAnswers())
        if offset is None:
            answer.n_collecting += answer.n_pictures < _WINDOW
            answer.n_lost += 1
            continue
        shift = offset.details.get("shift_columns", offset.details["shift_px"] / column_px)
        matched = taught.truth[min(int(np.searchsorted(ways_m, offset.station_m)), len(ways_m) - 1)][1]
        seen = truth.at([min(max(stamp_s, truth.stamps_s[0]), truth.stamps_s[-1])])[0][1]
        answer.said.append(float(shift))
        answer.true.append(around.shift_columns(matched, seen))
        answer.stations_m.append(offset.station_m)
        answer.misses_m.append(abs(matched.between(seen).x))
    return answers


def _rows_of_drives(name: str, drives: Sequence[Drive], is_turned: bool = True) -> list[Row]:
    """Return the rows of some drives: ours with bars and with the method as printed, the others after them."""
    rows: list[Row] = []
    for who in LOCALIZERS:
        if who == "faithful" or not any(who in drive for drive in drives):
            continue
        said = who.replace("_", " ")
        ours = _rows_of_one(name, said, [drive[who] for drive in drives if who in drive], is_turned=is_turned)
        faithful = [drive["faithful"] for drive in drives if "faithful" in drive] if who == "streams" else []
        rows += beside_faithful(ours, _rows_of_one(name, said, faithful, is_turned=is_turned) if faithful else [])
    return rows


def _rows_of_one(name: str, said: str, several: Sequence[DriveAnswers], *, is_turned: bool) -> Table:
    is_judged = said == "streams"
    table = Table(name, sum(len(one.said) for one in several), len(several))
    table.add(
        f"{said}: mean less the true mean, worst drive", "columns", _worst_bias(several), bar=1.0 if is_judged else None
    )
    misses = np.abs([said - true for one in several for said, true in zip(one.said, one.true, strict=True)])
    table.add(f"{said}: error of an answer, mean absolute", "columns", float(misses.mean()) if len(misses) else None)
    p95 = float(np.quantile(misses, 0.95)) if len(misses) else None
    table.add(f"{said}: error of an answer, p95 absolute", "columns", p95)
    if is_turned:
        share, bar = _signs_percent(several), 98.0 if is_judged else None
        table.add_higher(f"{said}: sign right, a picture without an answer is wrong", "%", share, bar=bar)
    if any(one.n_lost for one in several):
        spoken = float(np.mean([one.spoken_percent for one in several]))
        table.add_higher(f"{said}: spoken on", "%", spoken)
    return table


def _worst_bias(several: Sequence[DriveAnswers]) -> float | None:
    biases = [abs(float(np.mean(one.said) - np.mean(one.true))) for one in several if one.said]
    return max(biases, default=None)


def _signs_percent(several: Sequence[DriveAnswers]) -> float | None:
    """Return the share of the pictures after the first window whose sign is right; one without an answer is wrong."""
    n_right = sum(int((np.sign(one.said) == np.sign(one.true)).sum()) for one in several)
    n_asked = sum(one.n_pictures - one.n_collecting for one in several)
    return 100.0 * n_right / n_asked if n_asked else None


def _series(answers: DriveAnswers) -> dict[str, Floats]:
    columns = {"station": answers.stations_m, "said": answers.said, "true": answers.true}
    return {name: np.array(values) for name, values in columns.items()}
