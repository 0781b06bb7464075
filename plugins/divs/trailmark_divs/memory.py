"""What is remembered of a taught path: column sums and brightness profiles, 50 numbers each per picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, StoreError
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe
from trailmark_divs.averaging import mean_windows, trimmed_windows
from trailmark_divs.eye import TURNING, Look
from trailmark_divs.layout import ColumnLayout
from trailmark_divs.options import THRESHOLDS, Threshold

__all__ = ["KeyframeWriter", "TaughtStream", "Windows", "check_layout", "layout_document", "summarize"]

_BATCH = 16  # looks in a keyframe: a row of a store costs more than the sums of one look
_PROFILE_UNITS = 256.0  # a profile is stored in 1/256 grey level
_LAYOUT = "layout"
_THRESHOLD = "threshold"
# Maps that do not tell theirs were taught with what was the default then.
_UNTOLD = {_THRESHOLD: np.array([THRESHOLDS.index("otsu")])}


def layout_document(
    layout: ColumnLayout, region: tuple[float, float], lens_radius: float | None, threshold: Threshold
) -> dict[str, Any]:
    """Return what must be the same in teaching and replaying, as arrays for a localizer map."""
    return {
        "columns": np.array([layout.n_columns]),
        "region": np.array(region, dtype=np.float64),
        "lens_radius": np.array([lens_radius or 0.0]),
        _THRESHOLD: np.array([THRESHOLDS.index(threshold)]),
    }


def check_layout(localizer_map: LocalizerMap, document: Mapping[str, npt.NDArray[Any]], name: str) -> None:
    """Refuse to compare columns that do not show the same.

    Raises
    ------
    ConfigError
        If the path was taught with other columns, another region, mask or threshold.
    """
    stored = localizer_map.load(_LAYOUT)
    if stored is None:
        return
    taught = {**_UNTOLD, **stored}
    for key, value in document.items():
        if not np.array_equal(taught[key], value):
            raise ConfigError(
                f"{name}: the path was taught with {key} {_said(key, taught[key])},"
                f" but the config says {_said(key, value)};"
                f" set {key} back, or teach the path anew"
            )


def _said(key: str, value: npt.NDArray[Any]) -> str:
    if key == _THRESHOLD:
        return THRESHOLDS[int(value[0])]
    return ", ".join(f"{item:g}" for item in value.tolist())


class KeyframeWriter:
    """Writes looks into a localizer map, a few to a keyframe.

    Parameters
    ----------
    localizer map : LocalizerMap
        Where to.
    """

    def __init__(self, localizer_map: LocalizerMap) -> None:
        self._localizer_map = localizer_map
        self._looks: list[Look] = []
        self._pose = Pose2()
        self._first_run, self._start_rad = _continued(localizer_map)

    def begin(self, document: Mapping[str, npt.NDArray[Any]], name: str) -> None:
        """Write the layout down, or check it against what was taught before."""
        check_layout(self._localizer_map, document, name)
        self._localizer_map.save(_LAYOUT, document)

    def add(self, look: Look, pose_map_base: Pose2) -> None:
        """Remember a look; `pose_map_base` is where it was taken."""
        if not self._looks:
            self._pose = pose_map_base
        self._looks.append(look)
        if len(self._looks) >= _BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what is left."""
        if not self._looks:
            return
        looks, self._looks = self._looks, []
        station_m = looks[-1].travelled_m[1]
        sums = np.array([look.sums for look in looks])
        profiles = np.array([look.profile for look in looks]) * _PROFILE_UNITS
        arrays = {
            "sums": sums.astype(np.uint32 if sums.max() > np.iinfo(np.uint16).max else np.uint16),
            "profiles": np.round(profiles).astype(np.uint16),
            "runs": np.array([TURNING if look.run == TURNING else look.run + self._first_run for look in looks]),
            "ways": np.array([look.travelled_m for look in looks]) - station_m,  # so that a path can be continued
            "stamps": np.array([look.stamps_s for look in looks]),
            "headings": np.array([look.heading_rad for look in looks]) + self._start_rad,
        }
        self._localizer_map.add(Keyframe(station_m, looks[-1].stamps_s[1], self._pose, arrays))


def _continued(localizer_map: LocalizerMap) -> tuple[int, float]:
    """Return the first run number and heading of a teaching that goes on after what is in the localizer map."""
    keyframes = localizer_map.keyframes()
    if not keyframes:
        return 0, 0.0
    last_run = max(int(keyframe.arrays["runs"].max()) for keyframe in keyframes)
    return last_run + 1, float(keyframes[-1].arrays["headings"][-1])


@dataclass(frozen=True, slots=True, eq=False)
class TaughtStream:
    """The looks of a taught path.

    Attributes
    ----------
    sums : (N, d) int64
        Changed pixels in each column.
    profiles : (N, d) float64
        Mean brightness of each column [grey levels].
    runs : (N,) int64
        Straight piece that each belongs to; `TURNING` in a turn.
    stations_m, stamps_s : (N, 2) float64
        Of the older and the newer picture of each difference [m, s].
    headings_rad : (N,) float64
        Turn since the start of teaching by motion alone, not wrapped, at the newer picture [rad].
    """

    sums: npt.NDArray[np.int64]
    profiles: npt.NDArray[np.float64]
    runs: npt.NDArray[np.int64]
    stations_m: npt.NDArray[np.float64]
    stamps_s: npt.NDArray[np.float64]
    headings_rad: npt.NDArray[np.float64]

    @classmethod
    def from_keyframes(cls, keyframes: Sequence[Keyframe]) -> TaughtStream:
        """Put the batches together.

        Raises
        ------
        StoreError
            If there are none, or they are not of this plugin.
        """
        if not keyframes:
            raise StoreError("nothing of this path is remembered; teach it with this localizer in the config")
        try:
            arrays = {
                name: np.concatenate([keyframe.arrays[name] for keyframe in keyframes])
                for name in ("sums", "profiles", "runs", "stamps", "headings")
            }
            stations_m = np.concatenate([keyframe.station_m + keyframe.arrays["ways"] for keyframe in keyframes])
        except (KeyError, ValueError) as error:
            raise StoreError(f"the keyframes are not those of a visual stream: {error}") from error
        return cls(
            arrays["sums"].astype(np.int64),
            arrays["profiles"] / _PROFILE_UNITS,
            arrays["runs"].astype(np.int64),
            stations_m.astype(np.float64),
            arrays["stamps"].astype(np.float64),
            arrays["headings"].astype(np.float64),
        )

    def __len__(self) -> int:
        return len(self.runs)


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """The change vectors of a taught path: every full window that no turn interrupts.

    Attributes
    ----------
    vectors : (M, d) float64
        Change vectors.
    stations_m, elapsed_s, headings_rad : (M,) float64
        Place, time since the start, and heading of each window's middle [m, s, rad].
    ordinals : (M,) int64
        Index of each window's newest look in the recording.
    """

    vectors: npt.NDArray[np.float64]
    stations_m: npt.NDArray[np.float64]
    elapsed_s: npt.NDArray[np.float64]
    headings_rad: npt.NDArray[np.float64]
    ordinals: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ordinals)

    @classmethod
    def of(cls, recording: TaughtStream, window: int, n_trimmed: int, scale: npt.NDArray[np.float64]) -> Windows:
        """Average a recording over windows, Eq. (6); see `ColumnLayout.scale` for `scale`."""
        runs = recording.runs
        newest = np.arange(window - 1, len(runs))
        oldest = newest - window + 1
        is_whole = (runs[newest] == runs[oldest]) & (runs[newest] != TURNING)  # runs only count up
        if not len(newest):
            nothing = np.empty(0)
            return cls(np.empty((0, len(scale))), nothing, nothing, nothing, np.empty(0, dtype=np.int64))
        averages = trimmed_windows(recording.sums, window, n_trimmed) if n_trimmed else None
        vectors = mean_windows(recording.sums, window) if averages is None else averages
        stations_m = _means(recording.stations_m.mean(axis=1), window)
        elapsed_s = _means(recording.stamps_s.mean(axis=1), window) - recording.stamps_s[0, 0]
        before = np.concatenate([recording.headings_rad[:1], recording.headings_rad[:-1]])
        headings_rad = _means((before + recording.headings_rad) / 2.0, window)
        return cls(
            vectors[is_whole] * scale,
            stations_m[is_whole],
            elapsed_s[is_whole],
            headings_rad[is_whole],
            newest[is_whole],
        )


def _means(values: npt.NDArray[np.float64], window: int) -> npt.NDArray[np.float64]:
    first = values[0]  # sums of stamps since 1970 would lose digits
    sums = np.concatenate([[0.0], np.cumsum(values - first)])
    return np.asarray(first + (sums[window:] - sums[:-window]) / window)


def summarize(recording: TaughtStream) -> dict[str, float]:
    """Return what tells whether a taught path can be replayed: pictures, length, spacing, share of turns."""
    steps_m = np.diff(recording.stations_m[:, 1])
    return {
        "n_looks": float(len(recording)),
        "length_m": float(recording.stations_m[-1, 1] - recording.stations_m[0, 0]),
        "spacing_m": float(np.median(steps_m)) if len(steps_m) else 0.0,
        "turning_share": float((recording.runs == TURNING).mean()),
    }
