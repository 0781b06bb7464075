"""What a localizer remembers tells its format, and a newer one is refused before it starts."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer
from trailmark.paths import Keyframe, Waypoint
from trailmark.pipeline import Pipeline
from trailmark.pipeline.teaching.localizer_maps import FORMAT_NAME, VersionedMap, check_format
from trailmark.testing import MemoryMap

KEYFRAME = Keyframe(0.0, 0.0, Pose2(), {"patch": np.zeros(4, np.uint8)})


class Mapper(Localizer):
    """Remembers a keyframe for every frame."""

    def __init__(self, map_format: int = 1) -> None:
        super().__init__(None)
        self.map_format = map_format  # type: ignore[misc]  # one class stands for several versions
        self.has_started = False

    def start(self, session) -> None:
        self.session, self.has_started = session, True

    def observe(self, frame, belief):
        if self.session.mode == "teach":
            self.session.map.add(KEYFRAME)
        return ()


def pipeline(fakes, mapper: Mapper, disk: dict, mode: str) -> Pipeline:
    source = fakes.Recording(fakes.image_frames("floor", [i / 70 for i in range(60)]))
    return Pipeline(
        fakes.parts({"floor": source}, {"vo": fakes.Mover(Pose2(0.0037)), "map": mapper}, mode=mode, disk=disk)
    )


def test_only_what_holds_something_tells_its_format() -> None:
    localizer_map = MemoryMap()
    formatted = VersionedMap(localizer_map, 3)
    assert localizer_map.is_empty

    formatted.add(KEYFRAME)
    formatted.save("model", {"w": np.ones(2)})

    told = localizer_map.load(FORMAT_NAME)
    assert told is not None
    assert told["version"] == 3
    assert len(formatted.keyframes()) == 1
    assert formatted.load("model") is not None


@pytest.mark.parametrize(("taught", "now"), [(1, 1), (1, 2)])
def test_the_same_and_an_older_format_are_read(fakes, taught: int, now: int) -> None:
    disk: dict = {}
    list(pipeline(fakes, Mapper(taught), disk, "teach"))
    mapper = Mapper(now)

    list(pipeline(fakes, mapper, disk, "replay"))

    assert mapper.has_started


def test_a_newer_format_is_refused_before_the_localizer_starts(fakes) -> None:
    disk: dict = {}
    list(pipeline(fakes, Mapper(2), disk, "teach"))
    mapper = Mapper(1)

    with pytest.raises(StoreError, match=r"localizer 'map': .* has format 2, newer than 1, .*: update the plugin"):
        list(pipeline(fakes, mapper, disk, "replay"))

    assert not mapper.has_started


def test_a_map_of_an_older_format_is_not_gone_on_with() -> None:
    localizer_map = MemoryMap()
    VersionedMap(localizer_map, 1).add(KEYFRAME)

    check_format(localizer_map, "map", Mapper(2))
    with pytest.raises(StoreError, match="has format 1, and this version writes 2: teach the path again"):
        check_format(localizer_map, "map", Mapper(2), is_continued=True)


@pytest.mark.parametrize(
    "told", [{}, {"version": np.array(0)}, {"version": np.array([1])}, {"version": np.array(1.0)}], ids=str
)
def test_what_is_no_format_is_refused(told) -> None:
    localizer_map = MemoryMap()
    localizer_map.save(FORMAT_NAME, told)

    with pytest.raises(StoreError, match="does not tell its format"):
        check_format(localizer_map, "map", Mapper())


def test_a_map_of_a_time_before_formats_is_read(fakes) -> None:
    disk = {"waypoints": [Waypoint(i, 0.05 * i, Pose2(0.05 * i)) for i in range(3)]}
    mapper = Mapper()

    list(pipeline(fakes, mapper, disk, "replay"))

    assert mapper.has_started
