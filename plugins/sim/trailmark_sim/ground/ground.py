"""The ground of a world: floors in zones, the weather over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import Float32s, Floats
from trailmark.deprecation import deprecated_name
from trailmark_sim.ground.canvas import Canvas, grid
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.ground.photo import Photo, load_photo
from trailmark_sim.ground.weather import Weather

__all__ = ["EVERYWHERE", "Floor", "GroundTexture", "Zone"]

EVERYWHERE = (-np.inf, np.inf, -np.inf, np.inf)


@dataclass(frozen=True, slots=True)
class Floor:
    """One kind of floor: a built-in one by name, or a photograph.

    Attributes
    ----------
    name : str
        One of `FLOORS`; not looked at when there is a photograph.
    photo : Path or None
        A photograph to make the floor of.
    photo_width_m : float or None
        Width of the floor that the photograph shows [m]; None: its pixels are the paper's camera's.
    yaw_rad : float
        Direction in which its planks run, in the map [rad].
    """

    name: str = "wood"
    photo: Path | None = None
    photo_width_m: float | None = None
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Zone:
    """A rectangle of floor; later zones lie over earlier ones.

    Attributes
    ----------
    floor : Floor
        What it is made of.
    box_m : (float, float, float, float)
        From x, to x, from y, to y, in the map [m].
    """

    floor: Floor
    box_m: tuple[float, float, float, float] = EVERYWHERE


class GroundTexture:
    """Everything that a downward camera can see, as a function of the place.

    Parameters
    ----------
    zones : sequence of Zone
        Floors; the first must cover everything.
    seed : int
        Of the floors: what they look like in detail.
    weather : Weather
        What lies on them.
    texel_m : float
        How fine they are painted [m].
    """

    def __init__(
        self, zones: Sequence[Zone], seed: int, weather: Weather | None = None, texel_m: float = 2.6e-4
    ) -> None:
        self.zones = tuple(zones)
        self.seed = seed
        self.weather = weather or Weather()
        self.texel_m = texel_m

    def load(self) -> None:
        """Read the photographs, if there are any, and say at once what is wrong with them."""
        for zone in self.zones:
            if zone.floor.photo is not None:
                self._photo(zone.floor)

    def paint(self, x_m: float, y_m: float, n_texels: int) -> Float32s:
        """Return the greys of a square of texels.

        Parameters
        ----------
        x_m, y_m : float
            Place of the first texel in the map; x grows with columns, y with rows [m].
        n_texels : int
            Texels on a side.

        Returns
        -------
        (n_texels, n_texels) float32
            Greys, 0 to 255 or beyond.
        """
        last_m = (n_texels - 1) * self.texel_m
        x, y = grid(x_m, y_m, self.texel_m, n_texels)
        visible = self._visible(x_m, x_m + last_m, y_m, y_m + last_m)
        grey = np.empty((n_texels, n_texels), dtype=np.float32)
        for index in visible:
            zone = self.zones[index]
            yaw_rad = zone.floor.yaw_rad
            places = grid(x_m, y_m, self.texel_m, n_texels, yaw_rad) if yaw_rad else (x, y)
            painted = self._paint_floor(zone.floor, *places)
            if len(visible) == 1:  # it covers the square whole
                grey = painted
                break
            west, east, south, north = zone.box_m
            inside = (x >= west) & (x < east) & (y >= south) & (y < north)
            np.copyto(grey, painted, where=inside)
        self.weather.change(grey, x, y)
        return grey

    def _visible(self, west: float, east: float, south: float, north: float) -> list[int]:
        """Return the zones that show in a box, from the lowest; what is covered whole is left out."""
        seen: list[int] = []
        for index in range(len(self.zones) - 1, -1, -1):
            box = self.zones[index].box_m
            if box[0] <= east and west < box[1] and box[2] <= north and south < box[3]:
                seen.append(index)
            if box[0] <= west and east < box[1] and box[2] <= south and north < box[3]:
                break
        return seen[::-1]

    def _paint_floor(self, floor: Floor, x: Floats, y: Floats) -> Float32s:
        if floor.photo is not None:
            return self._photo(floor).paint(x, y, self.seed)
        mean, painter = FLOORS[floor.name]
        canvas = Canvas(x, y, self.seed, mean)
        painter(canvas)
        return canvas.grey

    def _photo(self, floor: Floor) -> Photo:
        assert floor.photo is not None
        return _cached_photo(floor.photo, floor.photo_width_m, self.texel_m)


_cached_photo = lru_cache(maxsize=16)(load_photo)


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"Ground": GroundTexture})
