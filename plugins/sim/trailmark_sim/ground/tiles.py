"""Tiles of the ground, painted when they are first seen and kept as long as memory allows."""

from __future__ import annotations

import math
import weakref
from collections import OrderedDict
from collections.abc import Hashable, Iterable
from functools import partial

import numpy as np
from numpy.lib.stride_tricks import as_strided

from trailmark.arrays import AnyArray, Float32s
from trailmark.errors import ConfigError
from trailmark.kernels import kernel
from trailmark_sim.ground.ground import GroundTexture
from trailmark_sim.workers import run_all

__all__ = ["GREY_STEPS", "TILE_TEXELS", "TileStore", "lend_tiles"]

#: Texels on the side of a tile.
TILE_TEXELS = 256
#: Greys are kept in this many steps of one grey level.
GREY_STEPS = 256

_SIDE = TILE_TEXELS + 1  # one texel of the next tile, so that interpolation never leaves the tile
_BYTES = _SIDE * _SIDE * 2
_FEWEST = 64

Tile = tuple[int, int]


class TileStore:
    """Keeps the tiles seen last.

    Parameters
    ----------
    ground : GroundTexture
        What is on the tiles.
    psf_m : float
        Standard deviation of the lens' blur, on the ground [m].
    cap_mb : float
        Memory for tiles [MB].
    threads : int
        Tiles painted at the same time.
    """

    def __init__(self, ground: GroundTexture, psf_m: float, cap_mb: float, threads: int) -> None:
        self.n_slots = int(cap_mb * 1e6 / _BYTES)
        if self.n_slots < _FEWEST:
            raise ConfigError(f"sim: tiles need at least {_FEWEST * _BYTES / 1e6:.0f} MB, not {cap_mb:g} MB")
        self.ground = ground
        self._kernel = _gaussian(psf_m / ground.texel_m)
        # Memory that is not written to is not taken: a short run stays small.
        self.pool = np.empty((self.n_slots, _SIDE, _SIDE), dtype=np.uint16)
        #: Every texel and its right neighbour as one number of 32 bits, over the same memory: one access, not two.
        self.pairs = as_strided(self.pool.ravel()[:2].view(np.uint32), (self.pool.size - 1,), (2,))
        self._slots: OrderedDict[Tile, int] = OrderedDict()
        self.threads = threads
        self.n_painted = 0

    @property
    def tile_m(self) -> float:
        """Side of a tile [m]."""
        return TILE_TEXELS * self.ground.texel_m

    @property
    def bytes_in_use(self) -> int:
        """Memory taken by tiles [bytes]."""
        return len(self._slots) * _BYTES

    def slots_of(self, tiles: Iterable[Tile]) -> list[int]:
        """Return where the tiles stand in `pool`; those that are not there yet are painted."""
        wanted = list(tiles)
        missing = []
        for tile in wanted:
            if tile in self._slots:
                self._slots.move_to_end(tile)
            else:
                missing.append(tile)
        if missing:
            self._paint_all(missing)
        return [self._slots[tile] for tile in wanted]

    def _paint_all(self, missing: list[Tile]) -> None:
        for tile in missing:
            full = len(self._slots) >= self.n_slots
            self._slots[tile] = self._slots.popitem(last=False)[1] if full else len(self._slots)
        self.n_painted += len(missing)
        run_all([partial(self._paint, tile) for tile in missing], self.threads)

    def _paint(self, tile: Tile) -> None:
        margin = len(self._kernel) // 2
        texel_m = self.ground.texel_m
        x_m, y_m = ((n * TILE_TEXELS - margin) * texel_m for n in tile)
        grey = self.ground.paint(x_m, y_m, _SIDE + 2 * margin)
        _blur_to_steps(grey, self._kernel, self.pool[self._slots[tile]])


#: Tiles that the last camera left, by the floor and the lens that they show.
_spare: dict[Hashable, TileStore] = {}


def lend_tiles(borrower: object, ground: GroundTexture, psf_m: float, cap_mb: float, threads: int) -> TileStore:
    """Return tiles for a camera: those of the camera before it, if it saw the same ground and is gone, or new ones.

    A path is taught and then repeated in one process: its floor is painted once. Photographs may change between two
    runs, so that floors of them are always painted anew.

    Parameters
    ----------
    borrower : object
        Who uses the tiles; when it is gone, they are kept for the next.
    ground, psf_m, cap_mb, threads
        As for `TileStore`.
    """
    key = (ground.zones, ground.seed, ground.weather, ground.texel_m, psf_m, cap_mb)
    store = _spare.pop(key, None)
    _spare.clear()  # other ground: its memory is needed
    if store is None:
        store = TileStore(ground, psf_m, cap_mb, threads)
    store.n_painted, store.threads = 0, threads
    if all(zone.floor.photo is None for zone in ground.zones):
        weakref.finalize(borrower, _keep, key, store).atexit = False
    return store


def _keep(key: Hashable, store: TileStore) -> None:
    _spare.clear()
    _spare[key] = store


def _gaussian(sigma: float) -> Float32s:
    radius = max(1, math.ceil(3.5 * sigma))
    steps = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 * (steps / max(sigma, 1e-3)) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float32)


@kernel
def _blur_to_steps(grey: AnyArray, kernel: AnyArray, out: AnyArray) -> None:
    """Blur with a separable kernel and store the inner part in steps of 1/256 grey."""
    n, taps = out.shape[0], kernel.shape[0]
    rows = np.zeros((grey.shape[0], n), dtype=np.float32)
    for row in range(grey.shape[0]):
        for tap in range(taps):
            weight = kernel[tap]
            for col in range(n):
                rows[row, col] += weight * grey[row, col + tap]
    line = np.empty(n, dtype=np.float32)
    for row in range(n):
        line[:] = np.float32(0.5)
        for tap in range(taps):
            weight = kernel[tap] * np.float32(GREY_STEPS)
            for col in range(n):
                line[col] += weight * rows[row + tap, col]
        for col in range(n):
            out[row, col] = np.uint16(min(max(line[col], np.float32(0.0)), np.float32(65535.0)))
