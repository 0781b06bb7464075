"""A scene: shapes with surfaces, lights, and the light baked on every surface."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray, Bgr8, Float32s, Floats, Int32s
from trailmark.geometry import Pose2
from trailmark_sim.render.atlas import Atlas, build_atlas, join_atlases
from trailmark_sim.render.bake import Lighting, bake_light
from trailmark_sim.render.mirrors import Mirror, mirrors_of
from trailmark_sim.render.records import SURFACE_ROW
from trailmark_sim.render.shapes import Shape, box_sides, cylinder, ellipsoid, move, rectangle
from trailmark_sim.render.surfaces import Colour, Surface, surface_row

__all__ = ["Colour", "Scene", "SceneBuilder", "Surface"]

Triple = Sequence[float] | Floats
_WHITE = np.full((1, 1, 3), 255, np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything the kernels need to know of a world, as arrays; P shapes.

    Attributes
    ----------
    kinds : (P,) int8
    frames : (P, 3, 3) float64
    origins, centres : (P, 3) float64
    radii : (P,) float64
        Of the shapes; see `Shape`.
    surfaces : (P,) SURFACE_ROW
        How each shape looks, and where its light stands.
    light : (N, 3) float32
        Baked light, red, green, blue.
    atlas : Atlas
        The textures.
    sky : (H, W, 3) float32
        Light from where no shape is: rows from straight up to straight down, columns by azimuth from -pi.
    key : (3,) float64
        Direction to the brightest light; for highlights.
    n_fixed : int
        Shapes from here on move: `actors` writes their frames.
    lighting : Lighting
        What it was lit by.
    prints : mapping of bytes to int
        Digest and number of each texture.
    labels : tuple of str
        What each shape is that stands, in a word; "" where nobody said.
    mirrors : tuple of Mirror
        What shows the scene once more.
    """

    kinds: npt.NDArray[np.int8]
    frames: Floats
    origins: Floats
    centres: Floats
    radii: Floats
    surfaces: AnyArray
    light: Float32s
    atlas: Atlas
    sky: Float32s
    key: Floats
    n_fixed: int
    lighting: Lighting
    prints: Mapping[bytes, int]
    labels: tuple[str, ...] = ()
    mirrors: tuple[Mirror, ...] = ()

    def with_movers(self, add_to: Callable[[SceneBuilder], None]) -> Scene:
        """Return the same place with other moving shapes; nothing that stands is computed again.

        Parameters
        ----------
        add_to : callable
            Takes a builder and adds the movers, and nothing else.
        """
        builder = SceneBuilder(self.lighting, _prints=dict(self.prints), _images=[])
        add_to(builder)
        movers = builder.parts()
        if not movers.shapes:
            return self
        n = self.n_fixed
        atlas = self.atlas if not movers.images else join_atlases(self.atlas, build_atlas(movers.images))
        light, patches = bake_light(movers.shapes, [], self.lighting)
        first = self.surfaces["light_start"][n] if n < len(self.surfaces) else len(self.light)
        patches[:, 0] += first
        moving = _columns(movers, atlas, patches)
        joined: dict[str, Any] = {name: np.concatenate([getattr(self, name)[:n], moving[name]]) for name in moving}
        return replace(
            self,
            **joined,
            light=np.concatenate([self.light[:first], light]),
            atlas=atlas,
            prints=builder._prints,
        )


@dataclass(frozen=True, slots=True)
class _SceneParts:
    """What a builder has collected: shapes, their surfaces, and textures."""

    shapes: list[Shape]
    surfaces: list[Surface]
    images: list[Bgr8]


@dataclass
class SceneBuilder:
    """Collects shapes and textures, then bakes the light.

    Attributes
    ----------
    lighting : Lighting
        Lamps, sun and sky.
    sky : (H, W, 3) float32 or None
        What is seen where nothing stands; None: black.
    """

    lighting: Lighting
    sky: Float32s | None = None
    _shapes: list[Shape] = field(default_factory=list)
    _surfaces: list[Surface] = field(default_factory=list)
    _movers: list[tuple[Shape, Surface]] = field(default_factory=list)
    _images: list[Bgr8] = field(default_factory=lambda: [_WHITE])
    _prints: dict[bytes, int] = field(default_factory=lambda: {_print_of(_WHITE): 0})
    _pose: Pose2 = Pose2()
    _labels: list[str] = field(default_factory=list)
    _label: str = ""

    def labelled(self, label: str) -> SceneBuilder:
        """Return a builder of the same scene whose shapes are called so: ``goods``, ``sign``."""
        return replace(self, _label=label)

    def at_pose(self, pose_map_part: Pose2) -> SceneBuilder:
        """Return a builder of the same scene that takes the coordinates of a part: a wing, a street around a corner."""
        return replace(self, _pose=self._pose @ pose_map_part)

    def texture(self, image: Bgr8) -> int:
        """Add a texture (H, W, 3) RGB uint8 and return its number; what is there already is not added again."""
        digest = _print_of(image)
        if digest not in self._prints:
            self._prints[digest] = len(self._prints)
            self._images.append(image)
        return self._prints[digest]

    def add(self, shape: Shape, surface: Surface) -> None:
        """Add a shape."""
        self._shapes.append(shape if self._pose == Pose2() else move(shape, self._pose))
        self._surfaces.append(surface)
        self._labels.append(self._label)

    def add_mover(self, shape: Shape, surface: Surface) -> None:
        """Add a shape that will move; movers come after all that is fixed, in the order they are added."""
        self._movers.append((shape, surface))

    def rectangle(self, corner: Triple, along: Triple, up: Triple, surface: Surface) -> None:
        """Add a rectangle; see `shapes.rectangle`."""
        self.add(rectangle(corner, along, up), surface)

    def cylinder(self, x: float, y: float, z: float, radius_m: float, height_m: float, surface: Surface) -> None:
        """Add an upright cylinder."""
        self.add(cylinder(x, y, z, radius_m, height_m), surface)

    def ellipsoid(
        self, centre: Sequence[float], semi_axes_m: Sequence[float], surface: Surface, yaw_rad: float = 0.0
    ) -> None:
        """Add an ellipsoid."""
        self.add(ellipsoid(centre, semi_axes_m, yaw_rad), surface)

    def box(
        self,
        middle: tuple[float, float, float],
        size: tuple[float, float, float],
        surface: Surface,
        yaw_rad: float = 0.0,
        front: Surface | None = None,
        top: Surface | None = None,
    ) -> None:
        """Add a box that stands at height ``middle[2]``; its front looks along the yaw."""
        for number, side in enumerate(box_sides(middle, size, yaw_rad)):
            look = front if number == 0 else top if number == 4 else None
            self.add(side, look or surface)

    def build(self, threads: int = 1) -> Scene:
        """Bake the light and return the scene."""
        parts = self.parts()
        atlas = build_atlas(parts.images)
        solid = [surface.blocks_light for surface in self._surfaces]
        light, patches = bake_light(parts.shapes, solid, self.lighting, threads)
        return Scene(
            **_columns(parts, atlas, patches),
            light=light,
            atlas=atlas,
            sky=np.zeros((2, 2, 3), np.float32) if self.sky is None else self.sky,
            key=self.lighting.key(),
            n_fixed=len(self._shapes),
            lighting=self.lighting,
            prints=self._prints,
            labels=tuple(self._labels),
            mirrors=mirrors_of(self._shapes, [surface.mirror for surface in self._surfaces]),
        )

    def parts(self) -> _SceneParts:
        """Return all shapes, what moves last, with their surfaces, and the textures."""
        shapes = [*self._shapes, *(shape for shape, _ in self._movers)]
        return _SceneParts(shapes, [*self._surfaces, *(surface for _, surface in self._movers)], self._images)


def _columns(parts: _SceneParts, atlas: Atlas, patches: Int32s) -> dict[str, AnyArray]:
    """Return a row for each shape of what the kernels know of it but its light."""
    shapes, surfaces = parts.shapes, parts.surfaces
    return {
        "kinds": np.array([shape.kind for shape in shapes], np.int8),
        "frames": np.stack([shape.frame for shape in shapes]),
        "origins": np.stack([shape.origin for shape in shapes]),
        "centres": np.stack([shape.centre for shape in shapes]),
        "radii": np.array([shape.radius_m for shape in shapes]),
        "surfaces": np.array([surface_row(*row, atlas) for row in zip(shapes, surfaces, patches)], SURFACE_ROW),
    }


def _print_of(image: Bgr8) -> bytes:
    return hashlib.blake2b(f"{image.shape}".encode() + image.tobytes(), digest_size=16).digest()
