"""Panoramas that are already unwrapped: bearings, sizes, and a drive in the round room."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Omni, SensorInfo
from trailmark.geometry import Pose2, Pose3, wrap_angle
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_omni_surf.panorama import PanoramaCamera, PanoramaFinder

SIZE = (720, 180)
CONFIG = OmniSurfConfig(camera="omni", confirm_pictures=1, unwrapped=True)


@pytest.mark.parametrize(("turns", "sign"), [("clockwise", -1.0), ("counterclockwise", 1.0)])
def test_bearings_are_counted_from_forward_and_wrap_at_the_edges(turns: Any, sign: float) -> None:
    camera = PanoramaCamera.of(Omni(turns=turns, forward_deg=180.0), (180, 720))
    uv = np.array([[359.5, 10.0], [539.5, 10.0], [179.5, 10.0], [-0.5, 10.0], [719.5, 10.0]])

    bearings = camera.bearings(uv)

    np.testing.assert_allclose(bearings[:3], sign * np.radians([0.0, 90.0, -90.0]), atol=1e-12)
    assert abs(wrap_angle(float(bearings[3] - bearings[4]))) < 1e-12  # both edges show the same


def test_pixels_at_the_edges_are_outside_by_the_margin() -> None:
    camera = PanoramaCamera.of(Omni(), (100, 400))
    uv = np.array([[200.0, 50.0], [1.0, 50.0], [398.0, 50.0], [200.0, 2.0], [200.0, 97.0]])

    assert camera.is_inside(uv).tolist() == [True, False, False, False, False]
    assert camera.is_inside(uv, 0.0).all()


def test_a_picture_that_is_no_panorama_is_refused_with_the_key() -> None:
    assert "unwrapped" in PanoramaFinder.of(None).look(np.zeros((240, 320), np.uint8))


def test_a_picture_of_another_size_is_refused() -> None:
    finder = PanoramaFinder.of(None)

    assert finder.look(np.zeros((100, 400), np.uint8)) == ""
    assert "400 x 100" in finder.look(np.zeros((100, 360), np.uint8))


class Unwrapping:
    """The round room, seen through a camera that unwraps its circle: forward in the middle, left to the left."""

    def __init__(self, room: Any) -> None:
        self.room = room
        v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(np.float32)
        bearing = np.pi - (u + 0.5) / SIZE[0] * 2.0 * np.pi  # counter-clockwise from forward
        distance = room.rim_px - 3.0 - v / SIZE[1] * (room.rim_px - room.hub_px - 6.0)
        # In the room's pictures bearings turn counter-clockwise, with v down, and forward is +u.
        self.maps = room.centre[0] + distance * np.cos(bearing), room.centre[1] - distance * np.sin(bearing)

    def render(self, camera: Pose2, **options: Any) -> np.ndarray:
        image = self.room.render(camera, **options)
        maps = (one.astype(np.float32) for one in self.maps)
        return np.asarray(cv2.remap(image, *maps, interpolation=cv2.INTER_LINEAR))

    def sensor(self, mounting: Pose2 | None = None) -> SensorInfo:
        return SensorInfo("omni", "image", SIZE, 15.0, Pose3.from_planar(mounting or Pose2(), 1.2))


@pytest.fixture(scope="module")
def panoramas(omni: Any) -> Unwrapping:
    return Unwrapping(omni.room())


@pytest.fixture(scope="module")
def taught(omni: Any, panoramas: Unwrapping) -> MemoryMap:
    localizer_map: MemoryMap = omni.taught(panoramas, CONFIG)
    return localizer_map


def test_a_robot_is_found_by_panoramas_anywhere_and_at_any_heading(
    omni: Any, panoramas: Unwrapping, taught: MemoryMap
) -> None:
    rng, off_m, off_deg = np.random.default_rng(4), [], []
    for k in range(12):
        localizer = OmniSurf(CONFIG)
        localizer.start(Session("omni", "replay", {"omni": panoramas.sensor()}, map=taught))
        true = Pose2(*rng.uniform(-1.0, 1.0, 2), float(rng.uniform(-math.pi, math.pi)))
        (answer,) = localizer.observe(omni.frame(panoramas.render(true), float(k)), Belief(float(k)))
        if isinstance(answer, Fix):
            off_m.append(true.distance_to(answer.pose_map_base))
            off_deg.append(abs(math.degrees(true.between(answer.pose_map_base).theta)))

    assert len(off_m) >= 11
    assert np.median(off_m) < 0.04
    assert np.median(off_deg) < 0.6


def test_a_circular_picture_is_lost_where_panoramas_are_promised(omni: Any, taught: MemoryMap) -> None:
    localizer, room = OmniSurf(CONFIG), omni.room()
    localizer.start(Session("omni", "replay", {"omni": room.sensor()}, map=taught))

    (answer,) = localizer.observe(omni.frame(room.render(Pose2()), 0.0), Belief(0.0))

    assert isinstance(answer, Lost)
    assert "no panorama" in answer.reason
