"""Tracked LI points: Eqs. (1) and (2), ends, and rejoining."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from trailmark_omni_surf.features import Features
from trailmark_omni_surf.tracking import TrackBook, TrackOptions, track_points

Grey = npt.NDArray[np.uint8]


def picture(shift: tuple[int, int] = (0, 0)) -> Grey:
    coarse = np.random.default_rng(2).integers(0, 255, (40, 50), dtype=np.uint8)
    big = np.kron(coarse, np.ones((6, 6), np.uint8))
    return np.roll(big, shift, axis=(0, 1))


def features(uv: npt.NDArray[np.float64], descriptors: npt.NDArray[np.float32] | None = None) -> Features:
    n = len(uv)
    chosen = np.eye(n, 64, dtype=np.float32) if descriptors is None else descriptors
    ones = np.ones(n, np.float32)
    return Features(uv, chosen, np.ones(n, np.int8), ones, ones, ones)


UV = np.array([[60.0, 60.0], [120.0, 90.0], [200.0, 150.0]])


def test_points_follow_a_shifted_picture() -> None:
    moved, is_tracked = track_points(picture(), picture((3, -5)), UV)

    assert is_tracked.all()
    np.testing.assert_allclose(moved, UV + np.array([-5, 3]), atol=0.1)


def test_points_that_do_not_come_back_are_dropped() -> None:
    other = np.random.default_rng(9).integers(0, 255, (240, 300), dtype=np.uint8)

    _, is_tracked = track_points(picture(), other, UV)

    assert not is_tracked.any()
    assert track_points(picture(), other, np.empty((0, 2)))[0].shape == (0, 2)


def test_a_track_keeps_its_identity_and_grows_older() -> None:
    book = TrackBook()

    first = book.update(picture(), features(UV))
    second = book.update(picture((2, 2)), features(UV + 2))

    assert first.ids.tolist() == second.ids.tolist() == [0, 1, 2]
    assert first.life.tolist() == [1, 1, 1]
    assert second.life.tolist() == [2, 2, 2]


@pytest.mark.parametrize(("miss_px", "survives"), [(1.0, True), (2.5, False)])
def test_a_feature_away_from_the_tracked_point_does_not_count(miss_px: float, survives: bool) -> None:
    book = TrackBook()
    book.update(picture(), features(UV))

    seen = book.update(picture(), features(UV + np.array([miss_px, 0.0])))

    assert (seen.life == 2).any() == survives


def test_a_feature_that_looks_different_does_not_count() -> None:
    book = TrackBook(TrackOptions(descriptor_gate=0.4))
    book.update(picture(), features(UV))

    seen = book.update(picture(), features(UV, np.eye(3, 64, k=10, dtype=np.float32)))

    assert not (seen.life > 1).any()


def test_a_track_missed_too_often_ends_and_is_joined_with_the_same_point_later() -> None:
    book = TrackBook(TrackOptions(max_misses=1, min_life=2))
    nothing = features(np.empty((0, 2)), np.empty((0, 64), np.float32))
    book.update(picture(), features(UV))
    book.update(picture(), features(UV))
    book.update(picture(), nothing)
    book.update(picture(), nothing)

    again = book.update(picture((30, 40)), features(UV + np.array([40, 30])))

    assert again.ids.tolist() == [0, 1, 2]
    assert again.life.tolist() == [3, 3, 3]
    assert book.n_rejoined == 3


def test_no_more_tracks_than_allowed() -> None:
    book = TrackBook(TrackOptions(max_tracks=2))

    assert len(book.update(picture(), features(UV)).ids) == 2


def test_another_picture_size_starts_anew() -> None:
    book = TrackBook()
    book.update(picture(), features(UV))

    seen = book.update(picture()[:200, :250], features(UV))

    assert seen.ids.tolist() == [0, 1, 2]
