"""The canvas on which a floor is painted: greys and the places they belong to."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark_sim.ground import layers
from trailmark_sim.rng import stream_key

__all__ = ["Canvas"]


class Canvas:
    """Greys of a square piece of floor, painted layer by layer; each layer is a function of the place alone.

    Parameters
    ----------
    x, y : (N, N) float64
        Where each texel lies, in the floor's own axes [m].
    seed : int
        Of the floor; every layer has its own numbers of it, by its order.
    grey : float
        What it starts with.

    Attributes
    ----------
    grey : (N, N) float32
        The greys so far.
    """

    def __init__(self, x: Floats, y: Floats, seed: int, grey: float) -> None:
        self.grey = np.full(x.shape, grey, dtype=np.float32)
        self._x, self._y = x, y
        self._seed = seed
        self._n_layers = 0
        self._edge: Floats | None = None

    def clouds(self, cell_m: float | tuple[float, float], gain: float) -> Canvas:
        """Add smooth noise of one size; cells may be longer along x than along y."""
        cell_x_m, cell_y_m = cell_m if isinstance(cell_m, tuple) else (cell_m, cell_m)
        layers.add_clouds(self.grey, self._x, self._y, cell_x_m, cell_y_m, gain, self._next_seed())
        return self

    def dust(self, gain: float, cell_m: float = 0.0002) -> Canvas:
        """Add noise as fine as the texels; the lens takes three quarters of it away."""
        layers.add_dust(self.grey, self._x, self._y, cell_m, gain, self._next_seed())
        return self

    def grains(self, cell_m: float, gain: float, **look: float) -> Canvas:
        """Add grains or stones; `look` are the other fields of `layers.GrainLayer`."""
        layers.add_grains(self.grey, self._x, self._y, layers.GrainLayer(cell_m, gain, **look), self._next_seed())
        return self

    def specks(self, cell_m: float | tuple[float, float], share: float, gain: float, **look: float) -> Canvas:
        """Add sparse round or long specks; `look` are the other fields of `layers.SpeckLayer`."""
        cell_x_m, cell_y_m = cell_m if isinstance(cell_m, tuple) else (cell_m, cell_m)
        specks = layers.SpeckLayer(cell_x_m, cell_y_m, share, gain, **look)
        layers.add_specks(self.grey, self._x, self._y, specks, self._next_seed())
        return self

    def planks(self, length_m: float, width_m: float, gain: float, *, shift: float = -1.0) -> Canvas:
        """Cut what follows into planks or stones, each with a grey and noise of its own."""
        self._x, self._y = self._x.copy(), self._y.copy()
        self._edge = np.empty_like(self._x)
        seed = self._next_seed()
        layers.split_planks(self.grey, self._x, self._y, self._edge, length_m, width_m, shift, gain, seed)
        return self

    def joints(self, width_m: float, gain: float) -> Canvas:
        """Darken the edges of the planks that were cut before."""
        if self._edge is None:
            raise ValueError("joints lie between planks: call planks first")
        layers.add_joints(self.grey, self._x, self._y, self._edge, width_m, gain, self._next_seed())
        return self

    def bend(self, cell_m: tuple[float, float], shift_m: float) -> Canvas:
        """Bend what follows: places slide along y by smooth noise, as grain runs around a knot."""
        slide = np.zeros_like(self.grey)
        layers.add_clouds(slide, self._x, self._y, *cell_m, shift_m, self._next_seed())
        self._y = self._y + slide
        return self

    def _next_seed(self) -> np.uint64:
        self._n_layers += 1
        return np.uint64(stream_key(self._seed, f"layer {self._n_layers}"))


def grid(x_m: float, y_m: float, pitch_m: float, n_texels: int, yaw_rad: float = 0.0) -> tuple[Floats, Floats]:
    """Return the places of a square of texels in axes turned by `yaw_rad`.

    Parameters
    ----------
    x_m, y_m : float
        Place of the first texel; x grows with columns, y with rows [m].
    pitch_m : float
        Distance of the texels [m].
    n_texels : int
        Texels on a side.
    yaw_rad : float
        Direction of the floor's x axis in the map [rad].
    """
    steps = np.arange(n_texels) * pitch_m
    x, y = x_m + steps, (y_m + steps)[:, np.newaxis]
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * x + sin * y, cos * y - sin * x
