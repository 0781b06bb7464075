"""The built-in floors. Contrast and spectrum follow photographs of real ones; the card has the table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from trailmark_sim.ground.canvas import Canvas

__all__ = ["FLOORS"]


def wood(canvas: Canvas) -> None:
    """Planks of 90 mm with grain, pores and thin joints."""
    canvas.planks(0.9, 0.09, 4.0)
    canvas.bend((0.25, 0.03), 0.004)
    canvas.clouds((0.12, 0.006), 2.5).clouds((0.06, 0.0022), 3.5).clouds((0.03, 0.0011), 5.0)
    canvas.clouds((0.008, 0.0006), 5.0).dust(8.0)
    canvas.specks((0.012, 0.0012), 0.12, -14.0, spread=4.0)
    canvas.joints(0.0006, -30.0)


def asphalt(canvas: Canvas) -> None:
    """Stones of two sizes in a dark binder."""
    canvas.clouds(0.12, 2.0)
    canvas.grains(0.006, 5.0, gap=-5.0, gap_width=0.25, share=0.5)
    canvas.grains(0.0014, 9.0, gap=-7.0, gap_width=0.3, share=0.6)
    canvas.dust(36.0)
    canvas.specks(0.006, 0.15, 60.0, radius=0.15, spread=20.0)


def concrete(canvas: Canvas) -> None:
    """Trowelled: fine sand, clouds, a few pores and the fine streaks of the trowel."""
    canvas.clouds(0.15, 1.5).clouds(0.02, 1.5).clouds(0.004, 2.0)
    canvas.dust(26.3)
    canvas.specks(0.003, 0.012, -220.0, radius=0.20, spread=30.0)
    # Long and thin: edges as in the photograph without more key points than there.
    canvas.bend((0.25, 0.25), 0.02)
    canvas.specks((0.6, 0.0008), 0.175, -75.0, radius=0.3, spread=5.0)


def pavers(canvas: Canvas) -> None:
    """Concrete blocks of 200 x 100 mm in running bond."""
    canvas.planks(0.2, 0.1, 4.0, shift=0.5)
    canvas.clouds(0.03, 3.0)
    canvas.grains(0.004, 18.0, gap=-4.0, gap_width=0.3, share=0.35)
    canvas.grains(0.0014, 18.0, gap=-8.0, gap_width=0.35, share=0.6)
    canvas.dust(36.0)
    canvas.joints(0.004, -45.0)


def gravel(canvas: Canvas) -> None:
    """Loose stones of two sizes with shadows between them."""
    canvas.clouds(0.1, 4.0)
    canvas.grains(0.0034, 22.0, gap=-38.0, gap_width=0.4, shade=10.0)
    canvas.grains(0.010, 24.0, gap=-55.0, gap_width=0.3, shade=14.0, share=0.5)
    canvas.dust(50.0)


def carpet(canvas: Canvas) -> None:
    """Loops of yarn in loose rows."""
    canvas.clouds(0.08, 3.0)
    canvas.grains(0.0016, 28.0, jitter=0.7, gap=-65.0, gap_width=0.5, shade=14.0)
    canvas.dust(65.0)


def terrazzo(canvas: Canvas) -> None:
    """Chips of stone in a polished matrix, tiles of 150 mm."""
    canvas.planks(0.15, 0.15, 2.0, shift=0.0)
    canvas.clouds(0.05, 1.5)
    canvas.grains(0.012, 27.0, jitter=1.0, gap_width=0.04, share=0.13)
    canvas.grains(0.006, 23.0, jitter=1.0, gap_width=0.06, share=0.03)
    canvas.dust(25.6)
    canvas.joints(0.0020, -60.0)


def soil(canvas: Canvas) -> None:
    """Trodden earth with crumbs, small stones and straw."""
    canvas.clouds(0.08, 4.0).clouds(0.025, 4.0).clouds(0.008, 5.0)
    canvas.grains(0.004, 11.0, gap=-14.0, gap_width=0.4, share=0.5)
    canvas.grains(0.0013, 18.0, gap=-14.0, gap_width=0.4, share=0.2)
    canvas.dust(66.0)
    canvas.specks(0.010, 0.15, 60.0, radius=0.25, spread=20.0)
    canvas.specks((0.03, 0.0025), 0.03, 35.0, spread=10.0)


#: Name to (mean grey, painter).
FLOORS: Mapping[str, tuple[float, Callable[[Canvas], None]]] = MappingProxyType(
    {
        "asphalt": (88.0, asphalt),
        "carpet": (95.0, carpet),
        "concrete": (150.0, concrete),
        "gravel": (115.0, gravel),
        "pavers": (150.0, pavers),
        "soil": (105.0, soil),
        "terrazzo": (140.0, terrazzo),
        "wood": (125.0, wood),
    }
)
