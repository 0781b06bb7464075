"""Rules that the paper states in a sentence, each with a test that fails when it is turned round."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark_omni_surf.bearings import BearingFix, BearingNoise
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.flows import FlowOptions, _doubt, by_tracking
from trailmark_omni_surf.landmark_map import measured_candidates
from trailmark_omni_surf.landmarks import measure_landmark
from trailmark_omni_surf.localizer import OmniSurf


def config(**changes: object) -> OmniSurfConfig:
    return OmniSurfConfig.model_validate({"camera": "omni", "confirm_pictures": 1, **changes})


@pytest.fixture(scope="module")
def room(omni: Any) -> Any:
    return omni.room()


@pytest.fixture(scope="module")
def taught(omni: Any, room: Any) -> Any:
    return omni.taught(room, config())


def started(room: Any, localizer_map: Any, **changes: Any) -> OmniSurf:
    localizer = OmniSurf(config(**changes))
    localizer.start(Session("omni", "replay", {"omni": room.sensor()}, map=localizer_map))
    return localizer


def look(localizer: OmniSurf, omni: Any, room: Any, pose: Pose2, stamp_s: float) -> Fix:
    belief = Belief(stamp_s, pose_odom_base=pose)
    (answer,) = localizer.observe(omni.frame(room.render(pose), stamp_s), belief)
    assert isinstance(answer, Fix)
    return answer


@pytest.mark.parametrize(("spare", "n_main"), [(0, 0), (1, 1)])
def test_the_main_flow_needs_more_than_t_n_landmarks(
    omni: Any, room: Any, taught: Any, spare: int, n_main: int
) -> None:
    """Step 5: with exactly T_n landmarks left, features are detected again."""
    n_left = int(look(started(room, taught), omni, room, Pose2(), 0.0).details["agreeing"])
    localizer = started(room, taught, min_tracked=n_left - spare)

    look(localizer, omni, room, Pose2(), 0.0)
    look(localizer, omni, room, Pose2(0.01, 0.0, 0.0), 0.1)

    assert localizer.counters()["main_flow"] == n_main


def test_a_landmark_whose_tracking_error_exceeds_t_p_is_removed(omni: Any, room: Any, taught: Any) -> None:
    """Step 4: two landmarks across the room are taken for each other; their bearings are far off, and they go."""
    localizer = started(room, taught)
    image = room.render(Pose2())
    look(localizer, omni, room, Pose2(), 0.0)
    bearing_localizer = localizer._bearing_localizer
    assert bearing_localizer is not None
    finding, landmarks = bearing_localizer._finding, bearing_localizer._landmarks
    options = bearing_localizer._options
    swapped = finding.landmark_idx.copy()
    swapped[[0, len(swapped) // 2]] = swapped[[len(swapped) // 2, 0]]
    wrong = landmarks.positions[swapped[[0, len(swapped) // 2]]]
    assert np.hypot(*np.diff(wrong, axis=0)[0]) > 2.0
    last = replace(finding, landmark_idx=swapped)

    found = by_tracking(image, image, last, landmarks, localizer._centre.camera, options, Pose2())

    assert found.fix is not None
    assert found.n_seen == len(swapped)
    assert set(found.landmark_idx) == set(np.delete(swapped, [0, len(swapped) // 2]))
    assert (found.fix.errors_rad[found.fix.is_inlier] <= options.noise.gate_rad).all()


@pytest.mark.parametrize("is_enough", [False, True])
def test_a_picture_in_which_half_of_the_landmarks_is_gone_is_no_later_one(
    omni: Any, room: Any, taught: Any, monkeypatch: pytest.MonkeyPatch, is_enough: bool
) -> None:
    """Carried away, a few corners are still followed by chance: they agree, and are not believed."""
    localizer = started(room, taught)
    image = room.render(Pose2())
    look(localizer, omni, room, Pose2(), 0.0)
    bearing_localizer = localizer._bearing_localizer
    assert bearing_localizer is not None
    last, options = bearing_localizer._finding, bearing_localizer._options
    n_left = (len(last.uv) + 1) // 2 - (not is_enough)
    left = np.zeros(len(last.uv), bool)
    left[np.linspace(0, len(left) - 1, n_left).astype(int)] = True
    assert left.sum() == n_left >= 5
    monkeypatch.setattr("trailmark_omni_surf.flows.track_points", lambda *_: (last.uv, left))

    found = by_tracking(image, image, last, bearing_localizer._landmarks, localizer._centre.camera, options, Pose2())

    assert (found.fix is not None) == is_enough


@pytest.mark.parametrize(("rival", "is_doubted"), [(10.0, False), (10.4, True)])
def test_a_place_is_doubted_where_another_agrees_nearly_as_well(rival: float, is_doubted: bool) -> None:
    n = 12
    noise = BearingNoise()
    options = FlowOptions(
        noise=noise,
        descriptor_gate=0.4,
        ratio=0.8,
        min_agreeing=10,
        max_rival_share=0.85,
        min_agreeing_share=0.35,
        max_gap_rad=math.radians(200.0),
    )
    fix = BearingFix(Pose2(), np.eye(3), np.zeros(n), np.ones(n, bool), support=float(n), rival_support=rival)

    doubt = _doubt(fix, np.linspace(-3.0, 3.0, n), options)

    assert ("another place" in doubt) == is_doubted
    assert bool(doubt) == is_doubted


def room_keyframes(lives: list[int]) -> list[Keyframe]:
    """Return keyframes from four places, which all see one track for each life, in the order of their numbers."""
    points = np.array([[3.0 * math.cos(k), 3.0 * math.sin(k)] for k in range(len(lives))])
    poses = [Pose2(x, 0.3 * x * x, 0.2) for x in (-0.9, -0.3, 0.3, 0.9)]
    return [
        Keyframe(
            float(k),
            float(k),
            pose,
            {
                "ids": np.arange(len(lives)),
                "bearings": np.arctan2(*(points - (pose.x, pose.y)).T[::-1]) - pose.theta,
                "distances_px": np.full(len(lives), 60.0),
                "life": np.array(lives),
                "descriptors": np.eye(len(lives), 8, dtype=np.float32),
                "sign": np.ones(len(lives), np.int8),
                "pose_base_camera": np.zeros(3),
            },
        )
        for k, pose in enumerate(poses)
    ]


def test_the_k_longest_lived_points_become_candidates() -> None:
    candidates = measured_candidates(room_keyframes([4, 40, 9, 25, 12]), n_longest=2)

    np.testing.assert_array_equal(candidates.ids, [1, 3])
    np.testing.assert_array_equal(candidates.life, [40, 25])


@pytest.mark.parametrize(("n_sightings", "n_candidates"), [(2, 0), (3, 1)])
def test_a_point_is_measured_from_three_places(n_sightings: int, n_candidates: int) -> None:
    keyframes = room_keyframes([9])[:n_sightings]

    assert len(measured_candidates(keyframes, n_longest=9).ids) == n_candidates


def test_rays_that_do_not_cross_measure_nothing() -> None:
    """A landmark straight ahead of a straight drive may lie anywhere; a weave of a centimetre does not tell."""
    poses = np.array([[-4.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [-2.0, 0.01, 0.0], [-1.0, -0.01, 0.0]])

    assert measure_landmark(poses, np.zeros(4)) is None


def test_k_of_the_config_is_what_the_localizer_teaches_with(omni: Any, room: Any, taught: Any) -> None:
    few = type(taught)()
    for keyframe in taught.keyframes():
        few.add(keyframe)
    localizer = OmniSurf(config(n_longest=3))
    localizer.start(Session("omni", "teach", {"omni": room.sensor()}, map=few))

    localizer.finish()

    by_three = measured_candidates(taught.keyframes(), 3)
    np.testing.assert_array_equal(few.load("candidates")["measured"], by_three.positions)
    assert 0 < len(by_three.ids) < len(taught.load("candidates")["measured"])
