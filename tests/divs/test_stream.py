from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames import RGBD, Image
from trailmark_divs.averaging import mean_windows, trimmed_mean, trimmed_windows
from trailmark_divs.layout import grey_region, make_layout
from trailmark_divs.stream import ChangeStream

SIZE = (60, 24)


def pictures(n, size=SIZE, seed=7):
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (size[1], size[0]), dtype=np.uint8) for _ in range(n)]


def half(picture):
    return np.ascontiguousarray(picture[: len(picture) // 2])


def reference_sums(pair, n_columns):
    """Column sums as the reference makes them, with OpenCV: upper half, absolute difference, Otsu, sums."""
    difference = cv2.absdiff(half(pair[0]), half(pair[1]))
    _, binary = cv2.threshold(difference, 0, 1, cv2.THRESH_OTSU)
    column_px = difference.shape[1] // n_columns
    return binary[:, : n_columns * column_px].reshape(len(binary), n_columns, column_px).sum(axis=(0, 2))


def make_stream(window=4, n_columns=10, size=SIZE, lens_radius=None, **settings):
    return ChangeStream(make_layout(size, n_columns, (0.0, 0.5), lens_radius), window, **settings)


def test_sums_are_those_of_the_reference_steps():
    stream = make_stream()
    sequence = pictures(6)

    sums = [stream.push(half(picture)) for picture in sequence]

    assert sums[0] is None
    for pair, ours in zip(itertools.pairwise(sequence), sums[1:]):
        np.testing.assert_array_equal(ours, reference_sums(pair, 10))


def test_running_sum_is_the_mean_over_the_window_for_any_length_of_stream():
    stream = make_stream(window=4, average="mean")
    sequence = pictures(12)

    for k, picture in enumerate(sequence):
        stream.push(half(picture))
        assert stream.is_full == (k >= 4)
        if stream.is_full:
            pairs = zip(sequence[k - 4 : k], sequence[k - 3 : k + 1])
            expected = np.mean([reference_sums(pair, 10) for pair in pairs], axis=0)
            np.testing.assert_allclose(stream.vector(), expected, atol=1e-12)


def test_change_vector_is_the_column_sum_of_the_change_image():
    stream = make_stream(window=3, keep_pictures=True)
    for picture in pictures(9):
        stream.push(half(picture))

    columns = stream.change_image()[:, :60].reshape(12, 10, 6).sum(axis=(0, 2))

    np.testing.assert_allclose(stream.vector(), columns, rtol=1e-5)


def test_change_image_before_the_window_is_full_averages_what_there_is():
    stream = make_stream(window=5, keep_pictures=True)
    first, second = pictures(2)
    stream.push(half(first))
    stream.push(half(second))

    _, binary = cv2.threshold(cv2.absdiff(half(first), half(second)), 0, 1, cv2.THRESH_OTSU)
    np.testing.assert_array_equal(stream.change_image(), binary)


def test_change_image_is_refused_when_pictures_are_not_kept():
    with pytest.raises(ShapeError, match="keep_pictures"):
        make_stream().change_image()


def test_vector_is_refused_before_the_window_is_full():
    with pytest.raises(ShapeError, match="0 of 4 differences"):
        make_stream().vector()


def test_a_picture_of_another_size_is_refused():
    with pytest.raises(ShapeError, match=r"\(12, 60\), not \(12, 61\)"):
        make_stream().push(np.zeros((12, 61), dtype=np.uint8))


def test_restart_forgets_the_window_but_not_the_last_picture():
    stream = make_stream(window=2)
    sequence = pictures(5)
    for picture in sequence[:3]:
        stream.push(half(picture))

    stream.restart()
    sums = [stream.push(half(picture)) for picture in sequence[3:]]

    np.testing.assert_array_equal(sums[0], reference_sums(sequence[2:4], 10))
    np.testing.assert_allclose(stream.vector(), np.mean(sums, axis=0))


def test_the_stream_keeps_no_reference_to_the_picture_it_was_given():
    stream, other = make_stream(), make_stream()
    buffer = np.empty((12, 60), dtype=np.uint8)

    for picture in pictures(3):
        buffer[:] = half(picture)
        ours, expected = stream.push(buffer), other.push(half(picture))

    np.testing.assert_array_equal(ours, expected)


def test_p90_lets_at_most_a_tenth_change():
    stream = make_stream(threshold="p90", n_columns=1)
    for picture in pictures(2):
        sums = stream.push(half(picture))

    assert 0 < sums[0] <= 0.1 * 12 * 60


def test_blur_takes_noise_out_of_the_difference():
    rng = np.random.default_rng(7)
    bar = np.zeros((12, 60))
    bar[:, 20:30] = 160.0
    plain, blurred = make_stream(n_columns=6), make_stream(n_columns=6, threshold="blur_otsu")

    for picture in (np.zeros_like(bar), bar):
        noisy = np.clip(picture + rng.normal(60, 40, bar.shape), 0, 255).astype(np.uint8)
        sums, blurred_sums = plain.push(noisy), blurred.push(noisy)

    share_in_bar = [s[2] / s.sum() for s in (sums, blurred_sums)]
    assert share_in_bar[1] > share_in_bar[0]


def test_what_lies_outside_the_lens_circle_does_not_count():
    masked = make_stream(n_columns=10, lens_radius=0.3, average="mean", window=1)
    first, second = pictures(2)
    v, u = np.mgrid[:24, :60]
    outside = np.hypot(u - 29.5, v - 11.5) > 0.3 * 60

    for picture in (first, second):
        masked.push(half(picture))
    before = masked.vector()
    masked.restart()
    noise = np.random.default_rng(1).integers(0, 256, second.shape, dtype=np.uint8)
    masked.push(half(first))
    masked.push(half(np.where(outside, noise, second)))

    np.testing.assert_array_equal(before, masked.vector())
    assert before[0] == before[-1] == 0.0


def test_sums_of_partly_masked_columns_are_scaled_up_to_their_area():
    layout = make_layout((60, 24), 10, (0.0, 0.5), 0.3)

    full = np.where(layout.usable, 12 * 6, 0)
    np.testing.assert_allclose(layout.area * layout.scale, full)
    assert not layout.usable[0]
    assert layout.usable[5]


@given(arrays(np.int64, (9, 4), elements=st.integers(0, 3000)), st.integers(0, 4))
def test_trimmed_mean_agrees_with_numpy(sums, n_trimmed):
    expected = np.sort(sums, axis=0)[n_trimmed : 9 - n_trimmed].mean(axis=0)

    np.testing.assert_allclose(trimmed_mean(sums, n_trimmed), expected)


@given(arrays(np.int64, (9, 4), elements=st.integers(0, 3000)), st.integers(1, 9))
def test_windows_of_a_recording_are_the_average_of_each(sums, window):
    n_cut = window // 4
    pieces = [sums[k : k + window] for k in range(9 - window + 1)]

    np.testing.assert_allclose(mean_windows(sums, window), [piece.mean(axis=0) for piece in pieces])
    np.testing.assert_allclose(trimmed_windows(sums, window, n_cut), [trimmed_mean(piece, n_cut) for piece in pieces])


def test_a_short_disturbance_does_not_reach_the_trimmed_mean():
    sums = np.full((25, 3), 100)
    disturbed = sums.copy()
    disturbed[4:10, 1] = 2800

    np.testing.assert_array_equal(trimmed_mean(disturbed, 6), trimmed_mean(sums, 6))


@pytest.mark.parametrize(
    "payload",
    [
        Image(np.full((24, 60), 40, dtype=np.uint8)),
        Image(np.full((24, 60, 3), 40, dtype=np.uint8)),
        Image(np.full((24, 60), 40 * 256 + 9, dtype=np.uint16)),
        RGBD(np.full((24, 60, 3), 40, dtype=np.uint8), np.ones((24, 60), dtype=np.float32)),
    ],
)
def test_every_kind_of_picture_gives_the_same_grey_region(payload):
    region = grey_region(payload, (0, 12))

    np.testing.assert_array_equal(region, np.full((12, 60), 40))
    assert region.dtype == np.uint8
    assert region.flags.c_contiguous


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (((40, 24), 50, (0.0, 0.5)), "no 50 columns"),
        (((60, 24), 10, (0.5, 0.51)), "no 10 columns in rows 12 to 12"),
        (((60, 24), 10, (0.0, 0.2), 0.01), "leaves no column"),
    ],
)
def test_a_picture_that_cannot_be_laid_out_is_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        make_layout(*settings)


def test_the_top_tenth_is_one_of_the_pixels_that_count():
    """Masked pixels are black in both pictures: counted, they would fill the lower nine tenths and more."""
    size = (60, 60)
    stream = ChangeStream(make_layout(size, 10, (0.0, 0.5), 0.3), 1, "p90", "mean", keep_pictures=True)
    first, second = (half(picture) for picture in pictures(2, size))
    stream.push(first)
    stream.push(second)
    inside = stream._layout.mask > 0

    changed = stream.change_image()[inside] > 0.0

    assert inside.mean() < 0.8
    assert changed.mean() == pytest.approx(0.1, abs=0.02)
