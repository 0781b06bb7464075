"""The layout for Foxglove that the manual gives away: its panels name topics and fields that a run writes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark import Session
from trailmark.api import create
from trailmark.estimates import Applied, Belief, Fix, Motion, PathOffset, information_from_sigmas
from trailmark.frames import Frame, Image, Scan
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import RunEnd
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint

pytest.importorskip("foxglove", reason="the extra [foxglove] is not installed")
reading = pytest.importorskip("mcap.reader", reason="mcap is not installed")

LAYOUT = json.loads((Path(__file__).parents[2] / "docs/assets/foxglove-layout.json").read_text(encoding="utf-8"))
PANELS: Mapping[str, Mapping[str, Any]] = LAYOUT["configById"]
GOOD = information_from_sigmas(0.01, 0.01, 0.01)


@pytest.fixture(scope="module")
def topics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, Any]]:
    """Schema of each topic of a run, and its newest message where that is JSON."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    sink = create("sink", "foxglove", path=str(file))
    sink.start(Session(path=TaughtPath([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0))])))
    sink.on_frame(Frame("floor", 1.0, Image(np.zeros((8, 8), np.uint8))))
    sink.on_frame(Frame("laser", 1.0, Scan(np.array([1.0, 3.0]), -0.1, 0.1)))
    sink.on_estimate("laser", Fix(1.0, Pose2(), GOOD), Applied("accepted", nis=2.5, dof=3))
    sink.on_estimate("wheels", Motion(0.9, 1.0, Pose2(0.1), GOOD), Applied("accepted"))
    on_path = PathOffset(1.0, 0.1, 0.02, 0.01, GOOD)
    moving = {"twist": Twist2(0.3, 0.0, 0.1), "travelled_m": 0.5, "fix_age_m": 0.1, "motion_age_s": 0.0}
    sink.on_belief(Belief(1.0, Pose2(), np.eye(3), Pose2(), on_path=on_path, **moving))
    sink.on_end(RunEnd("done"))
    sink.close()
    found = {}
    with file.open("rb") as stream:
        for schema, channel, message in reading.make_reader(stream).iter_messages():
            is_json = channel.message_encoding == "json"
            found[channel.topic] = (schema.name, json.loads(message.data) if is_json else None)
    return found


def panels_in(part: Any) -> Iterator[str]:
    """Yield the panels that a part of the arrangement holds."""
    if isinstance(part, str):
        yield part
    else:
        for side in ("first", "second"):
            yield from panels_in(part[side])


def test_every_panel_has_a_place_and_every_place_a_panel() -> None:
    assert sorted(panels_in(LAYOUT["layout"])) == sorted(PANELS)


def test_panels_of_space_and_pictures_name_topics_that_they_can_show(topics: dict[str, tuple[str, Any]]) -> None:
    in_space = {topics[topic][0] for topic in PANELS["3D!scene"]["topics"]}
    picture = topics[PANELS["Image!camera"]["imageMode"]["imageTopic"]][0]

    assert in_space == {"foxglove.PosesInFrame", "foxglove.PoseInFrame", "foxglove.LaserScan"}
    assert picture == "foxglove.CompressedImage"


@pytest.mark.parametrize(
    "value", [path["value"] for panel in PANELS.values() for path in panel.get("paths", ())], ids=str
)
def test_plots_name_fields_that_are_written(value: str, topics: dict[str, tuple[str, Any]]) -> None:
    topic, _, field = value.rpartition(".")
    name, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", field).groups()  # type: ignore[union-attr]

    found = topics[topic][1][name]

    assert isinstance(found if index is None else found[int(index)], float if name != "status" else str)
