"""What landmarks were seen on: pixels from bearings, labels from the ray caster, and Fig. 1."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.frames import Omni
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark_omni_surf.circle import BearingCamera
from trailmark_papers.kit import started_source, world_of
from trailmark_papers.tasaki2010.place import supermarket
from trailmark_papers.tasaki2010.signs import Sightings, draw_landmark, pixels_of, sightings_of, spread_sightings

#: In the aisle before a shelf whose sign hangs over its middle.
BEFORE_A_SHELF = Pose2(3.2, 5.6, math.pi / 2)


@pytest.fixture(scope="module")
def camera() -> Iterator[Any]:
    with started_source(supermarket(sensors=["omni"])) as robot:
        yield world_of(robot).sensors[0]


@pytest.mark.parametrize("sense", ["clockwise", "counterclockwise"])
def test_pixels_are_where_the_camera_sees_their_bearings(sense: Any) -> None:
    calibration = Omni(160.0, 118.0, 20.0, 115.0, sense, -90.0)
    look = BearingCamera.of(calibration, None)
    uv = np.array([[200.0, 118.0], [160.0, 60.0], [90.0, 150.0], [130.0, 90.0]])

    pixels = pixels_of(calibration, look.bearings(uv), np.hypot(*(uv - [160.0, 118.0]).T))

    np.testing.assert_allclose(pixels, uv, atol=1e-6)


def test_every_pixel_of_the_place_has_a_name_or_shows_what_nobody_named(camera: Any) -> None:
    view = camera.view_from(BEFORE_A_SHELF, 0.0)

    labels = view.labels()

    assert labels.shape == (240, 320)
    assert {"goods", "sign", "wall"} <= set(labels.ravel().tolist())
    assert labels[0, 0] == ""  # outside of the mirror


def test_a_track_is_named_by_what_most_of_its_pixels_showed(camera: Any) -> None:
    labels = camera.view_from(BEFORE_A_SHELF, 0.0).labels()
    look = BearingCamera.of(camera.info.calibration, None)
    v, u = np.argwhere(labels == "sign")[0]
    uv = np.array([[u, v]], float)
    centre = (look.centre_u, look.centre_v)
    arrays = {"ids": np.array([7]), "bearings": look.bearings(uv), "distances_px": np.hypot(*(uv - centre).T)}

    seen = sightings_of([Keyframe(0.0, 0.0, BEFORE_A_SHELF, arrays)], camera)

    assert seen[7].label == "sign"
    np.testing.assert_allclose(seen[7].uv, uv, atol=1e-6)
    assert Sightings().label == ""


def test_four_positions_are_spread_over_the_way(camera: Any, tmp_path: Path) -> None:
    poses = [Pose2(2.0 + 0.1 * k, 5.6, 0.0) for k in range(10)]
    one = Sightings(poses=poses, uv=[(160.0, 60.0)] * 10)

    draw_landmark(tmp_path / "a.svg", camera, one)

    assert spread_sightings(one, 4) == [0, 3, 6, 9]
    assert (tmp_path / "a.svg").read_text(encoding="utf-8").count("<image") == 4
