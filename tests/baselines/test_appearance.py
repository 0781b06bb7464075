"""Single pictures compared with a taught sequence."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ConfigError, StoreError
from trailmark.estimates import Belief, Lost, PathOffset
from trailmark.frames import RGBD, Frame, Image, Pinhole, Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint
from trailmark.testing import MemoryMap
from trailmark_baselines.appearance.config import ColumnNCCConfig, PatchNCCConfig, PhaseShiftConfig
from trailmark_baselines.appearance.kernels import column_scores, patch_normalised, patch_scores, peak, phase_shift
from trailmark_baselines.appearance.localizer import ColumnNCC, PatchNCC, PhaseShift

KINDS = {
    "column_ncc": (ColumnNCC, ColumnNCCConfig),
    "patch_ncc": (PatchNCC, PatchNCCConfig),
    "phase_shift": (PhaseShift, PhaseShiftConfig),
}
SIZE = (320, 160)
FOCAL_PX = 300.0
INFO = SensorInfo("front", "image", size=SIZE, calibration=Pinhole(FOCAL_PX, FOCAL_PX, 159.5, 79.5))
PATH = Path([Waypoint(k, 0.5 * k, Pose2(0.5 * k)) for k in range(11)])


def scene(seed):
    noise = np.random.default_rng(seed).normal(0, 1, (160, 640)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 4)
    return cv2.normalize(smooth, None, 20, 230, cv2.NORM_MINMAX).astype(np.uint8)


def view(seed, shift_px=0):
    """What stands at place `seed`, moved to the right."""
    return np.ascontiguousarray(scene(seed)[:, 160 - shift_px : 480 - shift_px])


def session(mode, localizer_map):
    return Session(
        name="peer", mode=mode, sensors={"front": INFO}, path=PATH if mode == "replay" else None, map=localizer_map
    )


def started(kind, mode, localizer_map, **settings):
    cls, config = KINDS[kind]
    localizer = cls(config(camera="front", **settings))
    localizer.start(session(mode, localizer_map))
    return localizer


def at(station_m):
    on_path = PathOffset(0.0, station_m, 0.0, 0.0, np.zeros((3, 3)))
    return Belief(0.0, Pose2(station_m), travelled_m=station_m, on_path=on_path)


def taught(kind, **settings):
    localizer_map = MemoryMap()
    localizer = started(kind, "teach", localizer_map, **settings)
    for k in range(11):
        assert localizer.observe(Frame("front", 0.1 * k, Image(view(k))), at(0.5 * k)) == ()
    return localizer_map


def answer(localizer, picture, station_m):
    return localizer.observe(Frame("front", 1.0, Image(picture)), at(station_m))[0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shift_px", [-40, -7, 0, 12, 40])
def test_a_picture_that_moved_right_is_a_turn_to_the_left(kind, shift_px):
    localizer = started(kind, "replay", taught(kind))

    offset = answer(localizer, view(4, shift_px), 2.1)

    assert offset.details["shift_px"] == pytest.approx(shift_px, abs=1.5)
    assert offset.heading_rad == pytest.approx(math.atan(shift_px / FOCAL_PX), abs=1.5 / FOCAL_PX)
    assert (offset.station_m, offset.lateral_m, offset.stamp_s) == (2.0, 0.0, 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_another_light_changes_little(kind):
    localizer = started(kind, "replay", taught(kind))
    dark = (255 * (view(4, 20) / 255.0) ** 1.6).astype(np.uint8)

    assert answer(localizer, dark, 2.0).details["shift_px"] == pytest.approx(20, abs=2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shift_is_told_as_one_number(kind):
    offset = answer(started(kind, "replay", taught(kind)), view(4), 2.0)

    assert np.linalg.matrix_rank(offset.information) == 1
    assert offset.information[2, 2] == pytest.approx(1 / math.radians(1) ** 2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_blank_picture_is_lost(kind):
    lost = answer(started(kind, "replay", taught(kind)), np.full((160, 320), 90, dtype=np.uint8), 2.0)

    assert isinstance(lost, Lost)
    assert lost.reason == "no clear match"


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_place_on_the_path_it_is_lost(kind):
    localizer = started(kind, "replay", taught(kind))

    answers = localizer.observe(Frame("front", 1.0, Image(view(4))), Belief(0.0))

    assert answers[0].reason == "the place on the path is not known"


def test_pictures_are_remembered_by_the_way_driven():
    assert len(taught("column_ncc", spacing_m=1.0).keyframes()) == 6


def test_only_the_region_is_looked_at():
    localizer = started("column_ncc", "replay", taught("column_ncc", region=(0.0, 0.5)), region=(0.0, 0.5))
    picture = view(4, 10)
    picture[80:] = view(9)[80:]

    assert answer(localizer, picture, 2.0).details["shift_px"] == pytest.approx(10, abs=1)


def test_colour_depth_and_16_bit_pictures_are_taken():
    localizer = started("column_ncc", "replay", taught("column_ncc"))
    grey = view(4, 10)
    colour = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    payloads = [
        Image(colour),
        RGBD(colour, np.ones((2, 2), dtype=np.float32)),
        Image(grey.astype(np.uint16) << 8),
    ]

    for payload in payloads:
        offset = localizer.observe(Frame("front", 1.0, payload), at(2.0))[0]
        assert offset.details["shift_px"] == pytest.approx(10, abs=1)
    assert localizer.observe(Frame("front", 1.0, Scalar(1.0)), at(2.0)) == ()


def test_the_field_of_view_wins_over_the_calibration():
    told = started("column_ncc", "replay", taught("column_ncc"), field_of_view_deg=90.0)
    unknown = started("column_ncc", "replay", taught("column_ncc"))
    unknown.start(replace(session("replay", taught("column_ncc")), sensors={}))

    for localizer, focal_px in ((told, 160.0), (unknown, 160.0 / math.tan(math.radians(30)))):
        offset = answer(localizer, view(4, 30), 2.0)
        assert offset.heading_rad == pytest.approx(math.atan(30 / focal_px), abs=0.01)


@given(st.integers(-30, 30), st.integers(0, 1000))
def test_column_scores_are_plain_correlations(shift, seed):
    taught, seen = np.random.default_rng(seed).uniform(0, 255, (2, 80))
    first, stop = max(0, -shift), min(80, 80 - shift)

    expected = np.corrcoef(taught[first:stop], seen[first + shift : stop + shift])[0, 1]

    assert column_scores(taught, seen, 30)[shift + 30] == pytest.approx(expected, abs=1e-9)


def test_flat_profiles_do_not_correlate():
    assert not column_scores(np.full(50, 9.0), np.arange(50.0), 10).any()


def plain_patch_normalised(picture, patch_px):
    half, out = patch_px // 2, np.zeros(picture.shape)
    for v in range(picture.shape[0]):
        for u in range(picture.shape[1]):
            patch = picture[max(0, v - half) : v + half + 1, max(0, u - half) : u + half + 1].astype(float)
            if patch.std() > 0:
                out[v, u] = (picture[v, u] - patch.mean()) / patch.std()
    return np.clip(out, -1, 1)


def test_patch_normalisation_agrees_with_plain_loops():
    picture = np.random.default_rng(7).integers(0, 256, (20, 30)).astype(np.uint8)
    picture[:10, :12] = 77

    np.testing.assert_allclose(patch_normalised(picture, 9), plain_patch_normalised(picture, 9), atol=1e-5)


def test_patch_scores_are_correlations_over_a_zero_padded_picture():
    taught, seen = np.random.default_rng(7).uniform(-1, 1, (2, 6, 21)).astype(np.float32)
    padded = np.pad(seen, ((0, 0), (10, 10)))

    expected = [np.corrcoef(padded[:, k : k + 21].ravel(), taught.ravel())[0, 1] for k in range(21)]

    np.testing.assert_allclose(patch_scores(taught, seen), expected, atol=1e-4)


def test_phase_correlation_finds_a_fraction_of_a_pixel():
    big = cv2.GaussianBlur(np.random.default_rng(7).normal(0, 1, (128, 1600)).astype(np.float32), (0, 0), 9)
    reduced = [np.ascontiguousarray(big[::4, start : start + 1024 : 4]) for start in (300, 290)]

    shift_px, response = phase_shift(*reduced)

    assert shift_px == pytest.approx(2.5, abs=0.2)
    assert response > 0.5


@pytest.mark.parametrize(
    ("scores", "expected"), [([0, 1, 0], (0.0, 1)), ([0, 0, 0, 1, 1], (1.5, 1)), ([3, 0, 0], (-1.0, 3))]
)
def test_peaks_worked_by_hand(scores, expected):
    assert peak(np.array(scores, dtype=float)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"path": None}, ConfigError, "needs a taught path"),
        ({"map": None}, ConfigError, "give the run --store"),
        ({"map": MemoryMap()}, StoreError, "nothing of this path is remembered"),
    ],
)
def test_what_it_cannot_do_without_is_asked_for(change, error, message):
    with pytest.raises(error, match=message):
        ColumnNCC(ColumnNCCConfig(camera="front")).start(replace(session("replay", taught("column_ncc")), **change))


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match=r"not 0\.5 to 0\.5"):
        ColumnNCCConfig(camera="front", region=(0.5, 0.5))
    with pytest.raises(ValueError, match="odd, not 8"):
        PatchNCCConfig(camera="front", patch_px=8)
