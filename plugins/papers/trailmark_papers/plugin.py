"""What the plugin offers: an experiment for each paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the experiments."""
    registry.experiment(
        "nagai2015",
        "trailmark_papers.nagai2015:nagai2015",
        summary="Path tracking with only a downward camera: straight lines, indoors, 243 m outdoors, times",
        reference="Nagai & Watanabe 2015, Sec. IV",
    )
    registry.experiment(
        "perroni2014",
        "trailmark_papers.perroni2014:perroni2014",
        summary="Visual streams: shifts of drives turned aside, and a robot that comes back to its path",
        reference="Perroni Filho & Ohya 2014, Sec. V",
    )
    registry.experiment(
        "tasaki2010",
        "trailmark_papers.tasaki2010:tasaki2010",
        summary="Table 1, Figs. 6 and 7, Table 2 and 100 random starts, people, what the selection buys",
        reference="Tasaki et al. 2010",
    )
    registry.experiment(
        "toth2015",
        "trailmark_papers.toth2015:toth2015",
        summary="Landmarks with a Kinect: laboratory and hallway, rates, speeds, things that move, light",
        reference="Toth, Paulovic, Palkova & Vacho 2015",
    )
