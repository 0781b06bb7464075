"""What the sensors of a vehicle look at: a scene, what moves in it, and how its light changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from trailmark.geometry import Pose2
from trailmark_sim.props import Movers
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.viewpoints import Moment

__all__ = ["MomentAt", "Stage", "steady_light"]

MomentAt = Callable[[float, Pose2], Moment]


def steady_light(stamp_s: float) -> float:
    """Return the share of light where it never changes."""
    return 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A scene as sensors see it.

    Attributes
    ----------
    build_scene : callable
        Returns the scene, always the same.
    moment_at : callable
        Takes a stamp [s] and the pose of the vehicle and returns where everything is that moves.
    light_at : callable
        Takes a stamp [s] and returns the light as a share of that in the scene.
    threads : int
        Threads that render; no byte depends on it.
    """

    build_scene: Callable[[], Scene]
    moment_at: MomentAt
    light_at: Callable[[float], float] = steady_light
    threads: int = 1

    @classmethod
    def with_movers(
        cls,
        build_scene: Callable[[], Scene],
        movers: Movers,
        threads: int,
        light_at: Callable[[float], float] = steady_light,
    ) -> Stage:
        """Return the stage of a scene with people and boxes that move; the scene is built when first asked for."""

        @cache
        def scene() -> Scene:
            return build_scene().with_movers(movers.add_to)

        return cls(scene, movers.at, light_at, threads)
