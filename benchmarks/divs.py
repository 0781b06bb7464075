"""Visual streams and their peers on real recordings, side by side from one run, and what a picture costs.

Every row is measured through the localizers as a user would run them: taught on one sequence, replayed on another.
The recordings are not shipped (``TRAILMARK_DATA``, or ``../shared/data``); without them only times are measured.

    python benchmarks/divs.py [--quick] [--json]

* KITTI street, camera 0.8 m further in every picture: a horizontal crop gives a known shift. ``degraded``: gamma 1.6
  and noise of 6 grey levels. ``even/odd``: taught on the even pictures, replayed on the odd ones. ``3 off``: the
  correspondence is wrong by three pictures. ``occluders``: two, each 15 % of the width, crossing each other.
* KITTI stereo: taught with the left camera, replayed with the right one, 0.54 m to the right.
* Corridor: walked twice with a fisheye, the second time nearer the left wall.

Limits on turns are 2.5 columns a picture here: between pictures 0.8 m apart the path bends more than in 1.5 cm.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief, Estimate, PathOffset
from trailmark.experiments import Row
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.testing import MemoryMap
from trailmark_baselines.appearance.config import ColumnNCCConfig, PatchNCCConfig, PhaseShiftConfig
from trailmark_baselines.appearance.localizer import ColumnNCC, PatchNCC, PhaseShift
from trailmark_divs.config import DivsConfig
from trailmark_divs.layout import make_layout
from trailmark_divs.localizer import Divs
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import ChangeStream
from trailmark_divs.tracking import ShiftTracker

Picture = npt.NDArray[np.uint8]
Pictures = Sequence[Picture]
Maker = Callable[..., Localizer]

CROP_PX = 400  # 8 px a column
SHIFTS_PX = (0, 8, -8, 16, -16, 24, -24, 32, -32, 48, -48, 64, -64)
QUICK_SHIFTS_PX = (0, 8, -24, 48)
TURN_PER_PICTURE = 2.5
CAMERA: dict[str, Any] = {"camera": "front"}
PAPER: dict[str, Any] = {"shift": "paper", "threshold": "otsu", "average": "mean", "when_blind": "silent"}


def make_divs(window: int = 25, **settings: Any) -> Localizer:
    """Return ours: every picture, unless told otherwise; a lens of one degree a column."""
    defaults = {"window": window, "select": "every", "turn_limit_deg": TURN_PER_PICTURE * window}
    return Divs(DivsConfig.model_validate(CAMERA | defaults | settings))


def make_stream(window: int = 25, **settings: Any) -> Localizer:
    """Return ours without single pictures in turns: what the stream says by itself."""
    return make_divs(window, **settings | {"when_blind": "silent"})


def make_paper(window: int = 25, **settings: Any) -> Localizer:
    """Return ours as the reference does it: Otsu, plain mean, circular correlation, hill climbing."""
    return make_divs(window, **settings | PAPER)


PEERS: dict[str, Maker] = {
    "column_ncc": lambda **_: ColumnNCC(ColumnNCCConfig.model_validate(CAMERA)),
    "patch_ncc": lambda **_: PatchNCC(PatchNCCConfig.model_validate(CAMERA)),
    "phase_shift": lambda **_: PhaseShift(PhaseShiftConfig.model_validate(CAMERA)),
}
OURS: dict[str, Maker] = {"divs": make_divs, "stream alone": make_stream, "as the reference": make_paper}
ALL: dict[str, Maker] = OURS | PEERS


@dataclass
class Found:
    """What a localizer said after the first window."""

    error_px: list[float] = field(default_factory=list)
    shift_px: list[float] = field(default_factory=list)
    has_sign: list[bool] = field(default_factory=list)
    n_asked: int = 0

    def add(self, estimate: Sequence[Estimate], truth_px: float) -> None:
        """Take an answer and the true shift."""
        self.n_asked += 1
        if estimate and isinstance(estimate[0], PathOffset):
            shift_px = estimate[0].details["shift_px"]
            self.shift_px.append(shift_px)
            self.error_px.append(abs(shift_px - truth_px))
            if truth_px:  # no shift has no sign to get right
                self.has_sign.append(shift_px * truth_px > 0)

    def rates(self) -> tuple[float, float, float]:
        """Return the mean absolute error [px], and the shares of right signs and of pictures spoken on."""
        return float(np.mean(self.error_px)), float(np.mean(self.has_sign)), len(self.error_px) / self.n_asked


def session(mode: Any, localizer_map: LocalizerMap, n: int) -> Session:
    """Return a session over a straight path, a metre a picture."""
    path = TaughtPath(Waypoint(k, float(k), Pose2(float(k))) for k in range(n + 1))
    sensors = {"front": SensorInfo("front", "image")}
    return Session(name="bench", mode=mode, sensors=sensors, path=path if mode == "replay" else None, map=localizer_map)


def shown(localizer: Localizer, pictures: Pictures, first_m: float = 0.0) -> Iterator[Sequence[Estimate]]:
    """Show pictures to a started localizer, a metre apart by the belief."""
    for k, picture in enumerate(pictures):
        station_m = first_m + k
        on_path = PathOffset(0.1 * k, station_m, 0.0, 0.0, np.zeros((3, 3)))
        belief = Belief(0.1 * k, Pose2(station_m), travelled_m=float(k), twist=Twist2(10.0), on_path=on_path)
        yield localizer.observe(Frame("front", 0.1 * k, Image(picture)), belief)


def taught(make: Maker, pictures: Pictures, **settings: Any) -> LocalizerMap:
    """Teach a sequence."""
    localizer_map, localizer = MemoryMap(), make(**settings)
    localizer.start(session("teach", localizer_map, len(pictures)))
    for _ in shown(localizer, pictures):
        pass
    localizer.finish()
    return localizer_map


def replayed(
    make: Maker, localizer_map: LocalizerMap, pictures: Pictures, first_m: float = 0.0, **settings: Any
) -> list[Sequence[Estimate]]:
    """Replay a sequence; the first picture stands at `first_m`."""
    localizer = make(**settings)
    localizer.start(session("replay", localizer_map, len(pictures) + 4))
    return list(shown(localizer, pictures, first_m))


def degraded(pictures: Pictures, seed: int = 1) -> list[Picture]:
    """Return pictures of another day: gamma 1.6, and noise of 6 grey levels."""
    rng = np.random.default_rng(seed)
    curve = 255.0 * (np.arange(256) / 255.0) ** 1.6
    return [np.clip(curve[picture] + rng.normal(0, 6, picture.shape), 0, 255).astype(np.uint8) for picture in pictures]


def occluded(pictures: Pictures, is_textured: bool, seed: int = 3) -> list[Picture]:
    """Return pictures with two things crossing each other, each 15 % of the width and as high as the picture."""
    height, width = pictures[0].shape
    size = round(0.15 * width)
    shade = np.broadcast_to(np.linspace(60, 140, size), (height, size))
    rng = np.random.default_rng(seed)
    looks = [rng.uniform(0, 255, (height, size)) if is_textured else shade + 30 * side for side in (0, 1)]
    result = []
    for k, picture in enumerate(pictures):
        wide = np.pad(picture, ((0, 0), (size, size)))
        for look, speed, start in zip(looks, (7, -9), (0, 200), strict=True):
            u = (start + speed * k) % (width + size)
            wide[:, u : u + size] = look
        result.append(np.ascontiguousarray(wide[:, size:-size]))
    return result


def cropped(pictures: Pictures, shift_px: int = 0) -> list[Picture]:
    """Cut out the middle; what is seen moves to the right by the shift."""
    start = (pictures[0].shape[1] - CROP_PX) // 2 - shift_px
    return [np.ascontiguousarray(picture[:, start : start + CROP_PX]) for picture in pictures]


def crop_case(
    make: Maker,
    pictures: tuple[Pictures, Pictures],
    window: int,
    shifts_px: Sequence[int],
    first_m: float,
    cover: Callable[[Pictures], Pictures] = list,
    **settings: Any,
) -> Found:
    """Teach a crop of the first sequence, replay crops of the second at known shifts."""
    found = Found()
    localizer_map = taught(make, cropped(pictures[0]), window=window, **settings)
    for shift_px in shifts_px:
        seen = cover(cropped(pictures[1], shift_px))
        for estimate in replayed(make, localizer_map, seen, first_m, window=window, **settings)[window + 3 :]:
            found.add(estimate, float(shift_px))
    return found


def crop_rows(street: Pictures, shifts_px: Sequence[int]) -> Iterator[Row]:
    """Rows with shifts known to the pixel."""
    day = degraded(street)
    even_odd, same = (street[0::2], day[1::2]), (street, day)
    silent = {"when_blind": "silent"}
    smooth, textured = (partial(occluded, is_textured=is_textured) for is_textured in (False, True))
    cases: list[tuple[str, Any, dict[str, Any], tuple[float | None, ...]]] = [
        ("even/odd, degraded, w 10", (even_odd, 10, shifts_px, 0.5), {}, (2.0, 1.2, 0.995, 1.0, None)),
        ("same, degraded, 3 off, w 25", (same, 25, shifts_px, -3.0), silent, (1.5, 1.1, 0.995, 1.0, None)),
        ("smooth occluders, 3 off", (same, 25, shifts_px, -3.0, smooth), silent, (None, None, 0.99, None, 0.5)),
        ("textured occluders", (same, 25, shifts_px, 0.0, textured), silent, (None, None, 0.95, None, 0.4)),
    ]
    for item, case, settings, (mae, mae_stretch, sign, sign_stretch, speaks) in cases:
        for name, make in ALL.items():
            found = crop_case(make, *case, **settings)
            row, (mae_px, right, said) = partial(_row, n=len(found.error_px), name=name), found.rates()
            yield row(f"{item}: MAE", "px", mae_px, mae, mae_stretch)
            yield row(f"{item}: sign right", "1", right, sign, sign_stretch, "higher")
            yield row(f"{item}: speaks", "1", said, speaks, None, "higher")


def disparity_px(left: Pictures, right: Pictures) -> float:
    """Return the mean over pairs of the median SIFT disparity of the upper half: right less left [px]."""
    sift, matcher = cv2.SIFT.create(), cv2.BFMatcher()
    medians = []
    for pair in zip(left, right, strict=True):
        (points_l, words_l), (points_r, words_r) = (
            sift.detectAndCompute(picture[: len(picture) // 2], None) for picture in pair
        )
        moves = [
            (points_r[best.trainIdx].pt[0] - points_l[best.queryIdx].pt[0])
            for best, second in matcher.knnMatch(words_l, words_r, k=2)
            if best.distance < 0.7 * second.distance
            and abs(points_r[best.trainIdx].pt[1] - points_l[best.queryIdx].pt[1]) < 2
        ]
        if moves:
            medians.append(float(np.median(moves)))
    return float(np.mean(medians))


def shifts_said(answers: Sequence[Sequence[Estimate]]) -> list[float | None]:
    """Return the shifts that were told, None where it did not speak [px]."""
    return [e[0].details["shift_px"] if e and isinstance(e[0], PathOffset) else None for e in answers]


def stereo_rows(left: Pictures, right: Pictures) -> Iterator[Row]:
    """Rows of a camera that is truly 0.54 m to the right."""
    truth_px = disparity_px(left[::5], right[::5])
    item, column_px = "stereo, 0.54 m to the right", left[0].shape[1] // 50
    for name, make in ALL.items():
        to_right = shifts_said(replayed(make, taught(make, left), right)[26:])
        to_left = shifts_said(replayed(make, taught(make, right), left)[26:])
        told = np.array([shift for shift in to_right if shift is not None])
        both = [a + b for a, b in zip(to_right, to_left, strict=True) if a is not None and b is not None]
        row = partial(_row, n=len(told), name=name)
        yield row(f"{item}: mean off SIFT's {truth_px:.1f} px", "1", abs(float(told.mean()) / truth_px - 1.0), 0.1)
        yield row(f"{item}: sign right", "1", float((told < 0).mean()), 1.0, None, "higher")
        yield row(f"{item}: largest asymmetry", "column", float(np.abs(both).max()) / column_px, 0.2)


def corridor_rows(first: Pictures, second: Pictures) -> Iterator[Row]:
    """Rows of a corridor walked twice: only the sign is known, and not on every picture."""
    settings: dict[str, Any] = {"columns": 40, "max_shift_columns": 16, "lens_radius": 0.41, "window": 5}
    item = "corridor walked twice, w 5, rim masked"
    for name, make in ALL.items():
        own = {} if name in PEERS else settings
        answers = shifts_said(replayed(make, taught(make, first, **own), second, **own)[5:])
        told = np.array([shift for shift in answers if shift is not None])
        row = partial(_row, name=name)
        yield row(f"{item}: positive", "1", float((told > 0).mean()), 0.8, 0.9, "higher", n=len(told))
        yield row(f"{item}: speaks", "1", len(told) / len(answers), 0.6, None, "higher", n=len(answers))


def appearance_rows(street: Pictures) -> Iterator[Row]:
    """Rows of correspondence from the pictures alone, without odometry."""
    even, odd, window = cropped(street[0::2]), cropped(degraded(street)[1::2]), 10
    settings: dict[str, Any] = {"window": window, "correspondence": "appearance", "when_blind": "silent"}
    answers = replayed(make_divs, taught(make_divs, even, **settings), odd, **settings)
    told = [(k, e[0]) for k, e in enumerate(answers) if e and isinstance(e[0], PathOffset)]
    off = np.array([abs(round(offset.station_m - (k - window / 2))) for k, offset in told])
    item = "place by appearance, even/odd, w 10"
    yield _row(f"{item}: median error", "picture", float(np.median(off)), 1.0, n=len(off))
    yield _row(f"{item}: within one", "1", float((off <= 1).mean()), 0.9, 0.96, "higher", n=len(off))
    yield _row(f"{item}: speaks", "1", len(off) / (len(answers) - window), better="higher", n=len(answers))


def scrolling(n: int) -> list[Picture]:
    """Return 640 x 480 pictures of a textured scene that moves by a pixel a picture."""
    noise = np.random.default_rng(0).normal(0, 1, (480, 640 + n)).astype(np.float32)
    scene = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), np.empty(0), 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return [np.ascontiguousarray(scene[:, k : k + 640]) for k in range(n)]


def time_rows(n: int) -> Iterator[Row]:
    """Rows of thread CPU time per 640 x 480 picture."""
    pictures = scrolling(n)
    stream_us = float(np.median(stream_times_us(pictures)))
    item = "time per picture, 640 x 480"
    yield Row("divs", f"{item}: change vector and shift", "ms", stream_us / 1e3, 40.0, 0.15, 0.1, n=n)
    for name, make in ALL.items():
        localizer = make()
        localizer.start(session("replay", taught(make, pictures), n + 4))
        stamps_ns = [time.thread_time_ns() for _ in shown(localizer, pictures)]
        times_us = np.diff(stamps_ns) / 1e3
        yield _row(f"{item}: whole localizer", "ms", float(np.median(times_us[30:])) / 1e3, n=n, name=name)


def stream_times_us(pictures: Pictures) -> list[float]:
    """Return the time from a grey picture to its tracked shift, after a full window [us]."""
    layout = make_layout((640, 480), 50, (0.0, 0.5))
    stream, tracker = ChangeStream(layout, 25, "p90", "trimmed"), ShiftTracker(20, 25)
    first: npt.NDArray[np.float64] | None = None
    times_us = []
    for picture in pictures:
        before_ns = time.thread_time_ns()
        stream.push(picture[:240])
        if stream.is_full:
            vector = stream.vector()
            first = vector if first is None else first
            pair = local_windows(first, layout.usable, 5), local_windows(vector, layout.usable, 5)
            tracker.update(shift_scores(*pair, 20))
            times_us.append((time.thread_time_ns() - before_ns) / 1e3)
    return times_us[1:]


def _row(
    item: str,
    unit: str,
    value: float,
    bar: float | None = None,
    stretch: float | None = None,
    better: Any = "lower",
    *,
    n: int,
    name: str = "divs",
) -> Row:
    """Return a row; others than ours have their name in brackets, and no bar."""
    label, bars = (item, (bar, stretch)) if name == "divs" else (f"{item} [{name}]", (None, None))
    return Row("divs", label, unit, value, None, *bars, better=better, n=n)


def data_folder() -> Path:
    """Return the folder of the recordings, which may be missing."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("TRAILMARK_DATA", beside)) / "divs"


def read(folder: Path) -> list[Picture]:
    """Return all pictures of a folder in grey, in the order of their names."""
    return [np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8) for file in sorted(folder.glob("*.jpg"))]


def measure(is_quick: bool, folder: Path) -> Iterator[Row]:
    """Yield all rows that can be measured."""
    yield from time_rows(120 if is_quick else 500)
    if not folder.is_dir():
        return
    left, right = (read(folder / "kitti_raw_stereo" / side) for side in ("left", "right"))
    yield from crop_rows(left, QUICK_SHIFTS_PX if is_quick else SHIFTS_PX)
    yield from stereo_rows(left, right)
    yield from corridor_rows(*(read(folder / "corridor" / walk) for walk in ("ref", "query")))
    yield from appearance_rows(left)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="four shifts instead of thirteen")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = measure(options.quick, folder := data_folder())
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))
        return
    for row in rows:
        bar = "" if row.bar is None else f"bar {row.bar:g}  {'met' if row.met else 'NOT MET'}"
        print(f"{row.item:82}{row.ours:10.3f} {row.unit:8}{bar:20} n={row.n}", flush=True)
    if not folder.is_dir():
        print(f"no recordings at {folder}: set TRAILMARK_DATA to measure on them")


if __name__ == "__main__":
    main()
