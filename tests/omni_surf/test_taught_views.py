"""Views of a taught place: what they are, how two of them fit, and a room of the same walls with other posters."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark.arrays import Grey8
from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Omni
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_omni_surf.circle import BearingCamera
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_omni_surf.panorama import PanoramaCamera
from trailmark_omni_surf.taught_views import VIEW, TaughtViews, unwrapped_view, view_fit

CIRCULAR = BearingCamera(160.0, 120.0, -1.0, 0.4, 20.0, 115.0)
PANORAMA = PanoramaCamera.of(Omni(turns="clockwise", forward_deg=180.0), (168, 720))


def config(**changes: Any) -> OmniSurfConfig:
    return OmniSurfConfig.model_validate({"camera": "omni", **changes})


@pytest.fixture(scope="module")
def taught(omni: Any) -> MemoryMap:
    taught_map: MemoryMap = omni.taught(omni.room(), config())
    return taught_map


def posters(seed: int) -> Grey8:
    """Return a view of blurred blocks."""
    blocks = np.random.default_rng(seed).integers(30, 220, (12, 60)).astype(np.uint8)
    return np.asarray(cv2.resize(blocks, (360, 72), interpolation=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize("camera", [CIRCULAR, PANORAMA])
def test_pixels_look_under_the_bearings_that_were_asked_for(camera: Any) -> None:
    bearings = np.linspace(-3.0, 3.0, 13)

    uv = camera.pixels(bearings, np.linspace(0.0, 1.0, 13))

    np.testing.assert_allclose(camera.bearings(uv), bearings, atol=1e-9)
    assert (np.diff(camera.distances(uv)) > 0).all()


def test_a_view_shows_forward_in_its_middle_and_left_on_its_left() -> None:
    picture = np.zeros((240, 320), np.uint8)
    ahead, left = CIRCULAR.pixels(np.array([0.0, math.pi / 2.0]), np.array([0.5, 0.5]))
    cv2.circle(picture, tuple(np.round(ahead).astype(int).tolist()), 3, 255, -1)
    cv2.circle(picture, tuple(np.round(left).astype(int).tolist()), 3, 120, -1)

    view = unwrapped_view(picture, CIRCULAR)

    assert abs(int((view == view.max()).sum(axis=0).argmax()) - 180) <= 3
    assert abs(int(np.where(view > 0, view, 0)[:, :170].sum(axis=0).argmax()) - 90) <= 3


def test_a_view_fits_itself_under_other_light_and_no_other_posters() -> None:
    view = posters(1)
    darker = (0.5 * view + 10.0).astype(np.uint8)
    shifted = np.roll(view, 3, axis=1)

    assert view_fit(view, darker) > 0.99
    assert view_fit(view, shifted) > 0.99
    assert view_fit(view, posters(2)) < 0.8


def test_lamps_have_no_say_and_a_bare_view_tells_nothing() -> None:
    view = posters(1)
    lit = view.copy()
    cv2.circle(lit, (100, 30), 12, 255, -1)

    assert view_fit(view, lit) > 0.97
    assert math.isnan(view_fit(np.full((72, 360), 128, np.uint8), view))


def test_a_share_of_what_neighbours_fit_is_told_near_the_way_alone(omni: Any, taught: MemoryMap) -> None:
    views = TaughtViews.of(taught.keyframes())
    pose, room = omni.loop()[30], omni.room()
    camera = BearingCamera(*room.centre, -1.0, 0.0, 23.0, 115.0)
    seen = unwrapped_view(room.render(pose), camera)

    assert views.share(pose, seen) == pytest.approx(1.02, abs=0.03)  # nearer than neighbours are
    assert math.isnan(views.share(Pose2(), seen))  # 1.2 m from the loop
    assert math.isnan(TaughtViews.of(()).share(pose, seen))


class _SameCorners:
    """The round room of the tests with other posters on half of its wall."""

    def __init__(self, omni: Any) -> None:
        self.room, other = omni.room(), omni.room(seed=77)
        for first in range(0, self.room.texture.shape[1], 512):
            self.room.texture[:, first : first + 256] = other.texture[:, first : first + 256]


def answers_in(room: Any, omni: Any, localizer_map: MemoryMap, belief_pose: bool = False, **changes: Any) -> list[Any]:
    """Return what is said on 12 pictures along the taught way in a room."""
    localizer = OmniSurf(config(**changes))
    localizer.start(Session("omni", "replay", {"omni": room.sensor()}, map=localizer_map))
    answers = []
    for k, pose in enumerate(omni.loop()[20:32]):
        told = pose if belief_pose else None
        belief = Belief(k / 15.0, told, pose_odom_base=pose)
        answers += localizer.observe(omni.frame(room.render(pose), k / 15.0), belief)
    return answers


def test_a_room_of_the_same_plan_with_other_posters_is_not_believed(omni: Any, taught: MemoryMap) -> None:
    twin = _SameCorners(omni).room

    by_landmarks = answers_in(twin, omni, taught, place_fit=0.0)
    answers = answers_in(twin, omni, taught)

    assert any(isinstance(answer, Fix) for answer in by_landmarks)  # half of the landmarks are there
    assert all(isinstance(answer, Lost) for answer in answers)
    assert any("of what it could" in answer.reason for answer in answers)


def test_its_own_room_is_believed_in_the_second_picture(omni: Any, taught: MemoryMap) -> None:
    first, *others = answers_in(omni.room(), omni, taught)

    assert isinstance(first, Lost)
    assert all(isinstance(answer, Fix) for answer in others)


def test_a_place_that_was_told_is_not_doubted(omni: Any, taught: MemoryMap) -> None:
    answers = answers_in(_SameCorners(omni).room, omni, taught, belief_pose=True)

    assert any(isinstance(answer, Fix) for answer in answers)


def test_a_map_without_views_is_believed_by_its_landmarks(omni: Any, taught: MemoryMap) -> None:
    old = MemoryMap()
    for keyframe in taught.keyframes():
        arrays = {name: array for name, array in keyframe.arrays.items() if name != VIEW}
        old.add(type(keyframe)(keyframe.station_m, keyframe.stamp_s, keyframe.pose_map_base, arrays))
    landmarks = taught.load("landmarks")
    assert landmarks is not None
    old.save("landmarks", landmarks)

    assert any(isinstance(answer, Fix) for answer in answers_in(_SameCorners(omni).room, omni, old))


def test_where_near_things_pass_by_at_once_another_building_does_not_do() -> None:
    """Nothing of the lower half of a view is seen again in the next: what is asked must not fall to nothing."""
    above = posters(0)
    views = [np.vstack([above[:36], posters(k + 1)[36:]]) for k in range(6)]
    taught = TaughtViews(np.array([[0.2 * k, 0.0, 0.0] for k in range(6)]), views)

    for beside_m in (0.0, 0.2, 0.4, 0.49):
        assert taught.share(Pose2(0.4, beside_m, 0.0), posters(99)) < OmniSurfConfig(camera="omni").place_fit
        assert taught.share(Pose2(0.4, beside_m, 0.0), views[2]) >= 1.0
