"""Reads the looks of a taught path: column sums and brightness profiles, 50 numbers each per picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import AnyArray, Bools, Float32s, Floats, Int64s
from trailmark.errors import StoreError
from trailmark.patches import SMALL_PX
from trailmark.paths import Keyframe
from trailmark_divs.eye import TURNING
from trailmark_divs.taught_layout import (
    HEADINGS,
    PICTURE_CLEAR,
    PICTURE_ROWS,
    PICTURE_UNITS,
    PICTURES,
    PROFILE_UNITS,
    PROFILES,
    RUNS,
    STAMPS,
    STATION_OFFSETS,
    SUMS,
)

__all__ = ["TaughtStream", "summarize"]


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
    pictures : (K, h, w) float32
        Small newer pictures of some looks; none where pictures are not compared, and in maps of earlier versions.
    picture_rows : (K,) int64
        Which looks they belong to.
    clear : (K, h, w) bool
        Which of their pixels are not over-exposed; all, in maps of earlier versions.
    """

    sums: Int64s
    profiles: Floats
    runs: Int64s
    stations_m: Floats
    stamps_s: Floats
    headings_rad: Floats
    pictures: Float32s
    picture_rows: Int64s
    clear: Bools = field(default_factory=lambda: np.empty((0, *SMALL_PX[::-1]), np.bool_))

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
                for name in (SUMS, PROFILES, RUNS, STAMPS, HEADINGS)
            }
            stations_m = np.concatenate(
                [keyframe.station_m + keyframe.arrays[STATION_OFFSETS] for keyframe in keyframes]
            )
            pictures, picture_rows = _pictures_of(keyframes)
            clear = _clear_of_pictures(keyframes)
        except (KeyError, ValueError) as error:
            raise StoreError(f"the keyframes are not those of a visual stream: {error}") from error
        return cls(
            arrays[SUMS].astype(np.int64),
            arrays[PROFILES] / PROFILE_UNITS,
            arrays[RUNS].astype(np.int64),
            stations_m.astype(np.float64),
            arrays[STAMPS].astype(np.float64),
            arrays[HEADINGS].astype(np.float64),
            pictures,
            picture_rows,
            clear,
        )

    def __len__(self) -> int:
        return len(self.runs)


def _pictures_of(keyframes: Sequence[Keyframe]) -> tuple[Float32s, Int64s]:
    """Return the small pictures, and the looks that they belong to; keyframes of earlier versions have none."""
    firsts = np.cumsum([0, *(len(keyframe.arrays[RUNS]) for keyframe in keyframes)])
    having = [(k, keyframe.arrays) for k, keyframe in enumerate(keyframes) if PICTURES in keyframe.arrays]
    if not having:
        return np.empty((0, *SMALL_PX[::-1]), np.float32), np.empty(0, np.int64)
    rows = np.concatenate([firsts[k] + arrays[PICTURE_ROWS] for k, arrays in having]).astype(np.int64)
    pictures = np.concatenate([arrays[PICTURES] for _, arrays in having]).astype(np.float32)
    return np.asarray(pictures / np.float32(PICTURE_UNITS), np.float32), rows


def _clear_of_pictures(keyframes: Sequence[Keyframe]) -> Bools:
    """Return which pixels of the small pictures are not over-exposed."""
    having = [keyframe.arrays for keyframe in keyframes if PICTURES in keyframe.arrays]
    return (
        np.concatenate([_clear_of(arrays) for arrays in having]) if having else np.empty((0, *SMALL_PX[::-1]), np.bool_)
    )


def _clear_of(arrays: Mapping[str, AnyArray]) -> Bools:
    shape = arrays[PICTURES].shape
    if PICTURE_CLEAR not in arrays:
        return np.ones(shape, np.bool_)
    bits = np.unpackbits(arrays[PICTURE_CLEAR], axis=1, count=shape[1] * shape[2])
    return np.asarray(bits.reshape(shape), np.bool_)


def summarize(recording: TaughtStream) -> dict[str, float]:
    """Return the figures that decide whether a path can be replayed: pictures, length, spacing, share of turns."""
    steps_m = np.diff(recording.stations_m[:, 1])
    return {
        "n_looks": float(len(recording)),
        "length_m": float(recording.stations_m[-1, 1] - recording.stations_m[0, 0]),
        "spacing_m": float(np.median(steps_m)) if len(steps_m) else 0.0,
        "turning_share": float((recording.runs == TURNING).mean()),
    }
