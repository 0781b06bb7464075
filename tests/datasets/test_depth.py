"""Depth pictures and the pairing of stamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import SourceError
from trailmark.sources.rgbd_pairs import RgbdPairs, StampedMessage
from trailmark_datasets.depth import depth_in_metres, pair_nearest

STAMPS = st.lists(st.floats(0.0, 2.0), max_size=12, unique=True).map(sorted)


def test_integer_depth_is_divided_and_zero_is_unknown():
    depth_m = depth_in_metres(np.array([[0, 5000, 12500]], np.uint16), 5000.0, "d")

    assert depth_m.dtype == np.float32
    np.testing.assert_array_equal(depth_m, np.array([[np.nan, 1.0, 2.5]], np.float32))


def test_metres_stay_and_what_is_no_distance_is_unknown():
    raw = np.array([[1.5, np.inf, np.nan, -1.0, 0.0]], np.float32)

    np.testing.assert_array_equal(
        depth_in_metres(raw, 1.0, "d"), np.array([[1.5, np.nan, np.nan, np.nan, np.nan]], np.float32)
    )


@pytest.mark.parametrize("raw", [np.zeros((2, 2, 3), np.uint16), np.zeros((2, 2), np.uint8)])
def test_a_colour_or_8_bit_picture_is_no_depth(raw):
    with pytest.raises(SourceError, match=r"d: a depth picture is \(H, W\) of uint16 or float32, not "):
        depth_in_metres(raw, 1.0, "d")


def test_the_nearest_are_paired_first():
    pairs = pair_nearest(np.array([0.00, 0.03, 0.06]), np.array([0.028, 0.031, 0.2]), 0.05)

    assert pairs == [(0, 0), (1, 1)]


@given(STAMPS, STAMPS)
def test_pairs_are_one_to_one_and_within_the_difference(first, second):
    pairs = pair_nearest(np.array(first), np.array(second), 0.1)

    assert len({i for i, _ in pairs}) == len({j for _, j in pairs}) == len(pairs)
    assert all(abs(first[i] - second[j]) <= 0.1 + 1e-12 for i, j in pairs)
    free = [i for i in range(len(first)) if i not in dict(pairs)]
    taken = {j for _, j in pairs}
    assert not any(abs(first[i] - second[j]) < 0.1 - 1e-12 for i in free for j in range(len(second)) if j not in taken)


def streamed(colour: list[float], depth: list[float], max_difference_s: float = 0.02, lag_s: float = 0.0):
    """Push two streams in the order in which they are recorded, depth late by `lag_s`."""
    pairs = RgbdPairs(max_difference_s)
    arriving = sorted([(t, False, t) for t in colour] + [(t + lag_s, True, t) for t in depth])
    out = []
    for _, is_depth, stamp_s in arriving:
        out += list(pairs.push(StampedMessage(stamp_s, "", None), is_depth))
    out += list(pairs.flush())
    return [(c.stamp_s, d.stamp_s) for c, d in out], pairs.unpaired


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.5])
def test_streams_are_paired_however_late_one_is_recorded(lag_s):
    colour = [0.0, 0.033, 0.066, 0.1]
    depth = [0.005, 0.03, 0.07, 0.15]

    pairs, unpaired = streamed(colour, depth, lag_s=lag_s)

    assert pairs == [(0.0, 0.005), (0.033, 0.03), (0.066, 0.07)]
    assert unpaired == 2  # one of each


def test_a_stream_without_partner_is_not_kept_for_ever():
    pairs, unpaired = streamed([0.01 * i for i in range(1000)], [])

    assert pairs == []
    assert unpaired == 1000


@given(STAMPS, STAMPS, st.sampled_from([0.0, 0.3]))
def test_every_streamed_picture_is_paired_once_or_counted(colour, depth, lag_s):
    pairs, unpaired = streamed(colour, depth, 0.1, lag_s)

    assert 2 * len(pairs) + unpaired == len(colour) + len(depth)
    assert all(abs(c - d) <= 0.1 + 1e-12 for c, d in pairs)
    assert [c for c, _ in pairs] == sorted({c for c, _ in pairs})
