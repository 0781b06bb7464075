"""SURF: kernels against plain twins, known blobs, and what turning and scaling do to it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames import Image
from trailmark_omni_surf.features import create_features, grey_of, match, squared_distances
from trailmark_omni_surf.matching_kernels import nearest_groups
from trailmark_omni_surf.surf.descriptor import describe, haar, region_weights
from trailmark_omni_surf.surf.detector import Surf, SurfOptions
from trailmark_omni_surf.surf.extrema import find_maxima
from trailmark_omni_surf.surf.hessian import box_derivatives, hessian_layer, integral_image

Grey = npt.NDArray[np.uint8]


def texture(seed: int = 1, size: tuple[int, int] = (240, 320)) -> Grey:
    """Return clouds with structure from a few pixels to a third of the picture."""
    rng = np.random.default_rng(seed)
    total = np.zeros(size)
    for cells in (6, 12, 24, 48, 96):
        coarse = rng.normal(size=(cells * size[0] // size[1] + 1, cells))
        total += cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_CUBIC)
    total = (total - total.min()) / (total.max() - total.min())
    return (255 * total).astype(np.uint8)


def turned(image: Grey, angle_deg: float, scale: float = 1.0) -> tuple[Grey, npt.NDArray[np.float64]]:
    """Return the image turned about its centre, and the (2, 3) matrix that takes pixels there."""
    height, width = image.shape
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), angle_deg, scale)
    return cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REFLECT_101), matrix


def integral_of(image: Grey) -> npt.NDArray[np.int32]:
    out = np.empty((image.shape[0] + 1, image.shape[1] + 1), np.int32)
    integral_image(image, out)
    return out


def plain_filter(size: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the masks Dxx and Dxy of Bay et al., figure 2, written out pixel by pixel."""
    lobe, centre = size // 3, size // 2
    dxx, dxy = np.zeros((size, size)), np.zeros((size, size))
    dxx[centre - lobe + 1 : centre + lobe] = np.repeat([1.0, -2.0, 1.0], lobe)
    dxy[centre - lobe : centre, centre - lobe : centre] = -1.0
    dxy[centre + 1 : centre + lobe + 1, centre + 1 : centre + lobe + 1] = -1.0
    dxy[centre - lobe : centre, centre + 1 : centre + lobe + 1] = 1.0
    dxy[centre + 1 : centre + lobe + 1, centre - lobe : centre] = 1.0
    return dxx, dxy


def plain_determinant(image: Grey, size: int) -> npt.NDArray[np.float64]:
    dxx_mask, dxy_mask = plain_filter(size)
    pixels = image.astype(np.float64)
    dxx, dyy, dxy = (
        cv2.filter2D(pixels, -1, mask, borderType=cv2.BORDER_CONSTANT) / size**2
        for mask in (dxx_mask, dxx_mask.T, dxy_mask)
    )
    determinant = dxx * dyy - 0.81 * dxy**2
    border = size // 2
    inside = np.zeros_like(determinant)
    inside[border : -border or None, border : -border or None] = 1.0
    return np.asarray(determinant * inside)


def test_the_integral_image_is_a_double_cumulative_sum() -> None:
    image = texture(size=(37, 51))

    integral = integral_of(image)

    np.testing.assert_array_equal(integral[1:, 1:], image.astype(np.int64).cumsum(0).cumsum(1))
    assert not integral[0].any()
    assert not integral[:, 0].any()


@pytest.mark.parametrize("size_px", [9, 15, 27, 51])
@pytest.mark.parametrize("step_px", [1, 2, 4])
def test_the_hessian_equals_filters_written_out_pixel_by_pixel(size_px: int, step_px: int) -> None:
    image = texture(size=(97, 130))
    out = np.empty((-(-97 // step_px), -(-130 // step_px)), np.float32)

    hessian_layer(integral_of(image), size_px, step_px, out)

    plain = plain_determinant(image, size_px)[::step_px, ::step_px]
    np.testing.assert_allclose(out, plain, atol=1e-3 * np.abs(plain).max())


def test_derivatives_at_a_pixel_equal_the_masks() -> None:
    image = texture(size=(60, 70))
    dxx_mask, dxy_mask = plain_filter(15)
    window = image[30 - 7 : 30 + 8, 25 - 7 : 25 + 8].astype(np.float64)

    dxx, dyy, dxy = box_derivatives(integral_of(image), 30, 25, 15)

    assert dxx == pytest.approx((window * dxx_mask).sum() / 225)
    assert dyy == pytest.approx((window * dxx_mask.T).sum() / 225)
    assert dxy == pytest.approx((window * dxy_mask).sum() / 225)


def test_a_filter_larger_than_the_image_gives_nothing() -> None:
    out = np.ones((40, 60), np.float32)

    hessian_layer(integral_of(texture(size=(40, 60))), 51, 1, out)

    assert not out.any()


def test_maxima_equal_a_plain_search() -> None:
    layers = np.random.default_rng(5).random((4, 30, 40)).astype(np.float32)
    out = np.empty((2000, 6), np.float32)
    plain = [
        (layer, i, j)
        for layer in (1, 2)
        for i in range(1, 29)
        for j in range(1, 39)
        if layers[layer, i, j] == layers[layer - 1 : layer + 2, i - 1 : i + 2, j - 1 : j + 2].max()
    ]

    n = find_maxima(layers, 9, 6, 1, 0.0, out)

    values = {float(layers[index]) for index in plain}
    assert {float(value) for value in out[:n, 3]} <= values
    assert n >= 0.9 * len(plain)  # those whose parabola has its top elsewhere are dropped


def test_a_parabola_is_located_between_the_grid_points() -> None:
    layer, v, u = np.mgrid[0:4, 0:9, 0:9].astype(np.float64)
    top = 10.0 - (u - 4.3) ** 2 - (v - 3.8) ** 2 - (layer - 1.2) ** 2 - 0.3 * (u - 4.3) * (v - 3.8)
    out = np.empty((10, 6), np.float32)

    n = find_maxima(top.astype(np.float32), 9, 6, 2, 0.0, out)

    assert n == 1
    np.testing.assert_allclose(out[0, :3], [8.6, 7.6, 1.2 / 9 * (9 + 1.2 * 6)], rtol=1e-4)


def test_haar_responses_are_differences_of_halves() -> None:
    image = texture(size=(40, 50))
    square = image[20 - 3 : 20 + 3, 25 - 3 : 25 + 3].astype(int)

    du, dv = haar(integral_of(image), 25, 20, 3)

    assert du == square[:, 3:].sum() - square[:, :3].sum()
    assert dv == square[3:].sum() - square[:3].sum()


@settings(max_examples=20, deadline=None)
@given(u=st.floats(5, 75), v=st.floats(5, 55), scale=st.floats(1.2, 4.0), angle=st.floats(-3.1, 3.1))
@pytest.mark.parametrize("spacing", [1.0, 0.7])
def test_the_descriptor_equals_its_plain_twin(spacing: float, u: float, v: float, scale: float, angle: float) -> None:
    integral = integral_of(texture(size=(60, 80)))
    point, angles = np.array([[u, v, scale]], np.float32), np.array([angle], np.float32)
    out = np.empty((1, 64), np.float32)

    describe(integral, point, angles, region_weights(), np.float32(spacing), out)

    plain = plain_descriptor(integral, point[0], float(angles[0]), spacing)
    np.testing.assert_allclose(out[0], plain, atol=0.05)
    assert np.linalg.norm(out[0]) == pytest.approx(1.0, abs=1e-5)


def plain_descriptor(
    integral: npt.NDArray[np.int32], point: npt.NDArray[np.float32], angle: float, spacing: float
) -> list[float]:
    u0, v0, scale = (float(value) for value in point)
    half, cos, sin = max(1, int(scale + 0.5)), math.cos(angle), math.sin(angle)
    sums = np.zeros((4, 4, 4))
    weights = region_weights()
    for i in range(24):
        for j in range(24):
            along_px, across_px = (j - 11.5) * spacing * scale, (i - 11.5) * spacing * scale
            u = math.floor(u0 + 1 + along_px * cos - across_px * sin)
            v = math.floor(v0 + 1 + along_px * sin + across_px * cos)
            du, dv = haar(integral, u, v, half)
            x, y = cos * du + sin * dv, cos * dv - sin * du
            sums += np.multiply.outer(np.outer(weights[:, i], weights[:, j]), [x, y, abs(x), abs(y)])
    flat = sums.ravel()
    return list(flat / np.linalg.norm(flat))


def test_a_bright_blob_is_found_where_it_is_with_its_scale_and_sign() -> None:
    v, u = np.mgrid[0:120, 0:160]
    blob = np.exp(-((u - 81.4) ** 2 + (v - 60.7) ** 2) / (2 * 5.0**2))
    surf = Surf(SurfOptions(blur_px=0.0))

    bright = surf((40 + 180 * blob).astype(np.uint8))
    dark = surf((220 - 180 * blob).astype(np.uint8))

    np.testing.assert_allclose(bright.uv[0], [81.4, 60.7], atol=0.3)
    np.testing.assert_allclose(dark.uv[0], [81.4, 60.7], atol=0.3)
    assert bright.sign[0] == -1
    assert dark.sign[0] == 1
    assert bright.scale_px[0] == pytest.approx(5.0, rel=0.25)


@pytest.mark.parametrize("mode", ["fast", "compact", "quality"])
@pytest.mark.parametrize(("angle_deg", "scale"), [(90.0, 1.0), (37.0, 1.0), (180.0, 1.2), (-120.0, 0.85)])
def test_most_matches_survive_turning_and_scaling(mode: str, angle_deg: float, scale: float) -> None:
    image = texture()
    other, matrix = turned(image, angle_deg, scale)
    surf = create_features("surf", 200, mode)  # type: ignore[arg-type]
    first, second = surf(image), surf(other)

    i, j, _ = match(first.descriptors, first.sign, second.descriptors, second.sign, 2.0)

    there = first.uv[i] @ matrix[:, :2].T + matrix[:, 2]
    errors = np.linalg.norm(there - second.uv[j], axis=1)
    assert len(i) >= 30
    assert (errors < 3.0).mean() > 0.8


def test_compact_features_survive_a_border_that_changes_where_fast_ones_do_not() -> None:
    image = texture()
    other = texture(seed=9)
    other[80:160, 120:200] = image[80:160, 120:200]  # the same patch on another ground
    shares = {}
    for mode in ("fast", "compact"):
        surf = create_features("surf", 200, mode)  # type: ignore[arg-type]
        first, second = surf(image), surf(other)
        in_patch = (np.abs(first.uv - (159.5, 119.5)) < 28).all(axis=1)
        first = first.select(in_patch)
        i, j, _ = match(first.descriptors, first.sign, second.descriptors, second.sign, 2.0)
        shares[mode] = (np.linalg.norm(first.uv[i] - second.uv[j], axis=1) < 1.0).sum() / len(first)

    assert shares["compact"] > shares["fast"]


def test_orientation_turns_with_the_image() -> None:
    image = texture()
    other = np.ascontiguousarray(np.rot90(image))  # counter-clockwise as seen: u towards -v
    surf = create_features("surf", 100)
    first, second = surf(image), surf(other)

    i, j, _ = match(first.descriptors, first.sign, second.descriptors, second.sign, 0.3)

    turn = np.angle(np.exp(1j * (second.angle_rad[j] - first.angle_rad[i] + math.pi / 2)))
    assert np.median(np.abs(turn)) < math.radians(5)


def test_upright_features_have_no_angle() -> None:
    features = create_features("surf", 50, upright=True)(texture())

    assert not features.angle_rad.any()


def test_up_sampled_positions_are_in_pixels_of_the_image() -> None:
    image = texture()
    fast, quality = create_features("surf", 50)(image), create_features("surf", 400, "quality")(image)

    nearest = np.linalg.norm(fast.uv[:, None] - quality.uv[None], axis=2).min(axis=1)

    assert np.median(nearest) < 0.6


def test_the_strongest_are_kept_in_order() -> None:
    features = create_features("surf", 60)(texture())

    assert len(features) == 60
    assert (np.diff(features.response) <= 0).all()


def test_a_blank_image_has_no_features() -> None:
    features = create_features("surf")(np.full((100, 100), 90, np.uint8))

    assert len(features) == 0
    assert features.descriptors.shape == (0, 64)


@pytest.mark.parametrize("image", [np.zeros((10, 100), np.uint8), np.zeros((99, 99)), np.zeros((99, 99, 3), np.uint8)])
def test_other_images_are_refused(image: npt.NDArray[np.uint8]) -> None:
    with pytest.raises(ShapeError, match="at least 32 x 32"):
        Surf()(image)


@pytest.mark.parametrize("name", ["sift", "orb", "akaze"])
def test_other_features_swap_in_by_name(name: str) -> None:
    image = texture()
    other, matrix = turned(image, 30.0)
    extract = create_features(name, 150)  # type: ignore[arg-type]
    first, second = extract(image), extract(other)

    i, j, distances = match(first.descriptors, first.sign, second.descriptors, second.sign, 1.0)

    errors = np.linalg.norm(first.uv[i] @ matrix[:, :2].T + matrix[:, 2] - second.uv[j], axis=1)
    assert len(first) <= 150
    assert len(i) >= 15
    assert np.median(errors) < 2.0
    assert (distances <= 1.0).all()
    np.testing.assert_allclose(np.linalg.norm(first.descriptors, axis=1), 1.0, atol=1e-4)


def test_the_surf_of_opencv_is_never_used_silently() -> None:
    with pytest.raises(ConfigError, match="OPENCV_ENABLE_NONFREE"):
        create_features("cv2_surf")


def test_an_unknown_feature_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match="available: akaze, cv2_surf, orb, sift, surf"):
        create_features("brisk")  # type: ignore[arg-type]


def test_bright_and_dark_never_match() -> None:
    descriptor = np.eye(1, 8, dtype=np.float32)
    plus, minus = np.array([1], np.int8), np.array([-1], np.int8)

    assert len(match(descriptor, plus, descriptor, plus, 0.5)[0]) == 1
    assert len(match(descriptor, plus, descriptor, minus, 0.5)[0]) == 0
    assert len(match(descriptor, plus, descriptor[:0], minus[:0], 0.5)[0]) == 0


def test_an_ambiguous_match_is_no_match() -> None:
    query = np.eye(1, 4, dtype=np.float32)
    near = query + np.array([[0, 0.1, 0, 0]], np.float32)
    train = np.concatenate([near, query + np.array([[0, 0, 0.105, 0]], np.float32)])
    train /= np.linalg.norm(train, axis=1, keepdims=True)
    signs = np.ones(2, np.int8)

    assert len(match(query, signs[:1], train, signs, 0.5, ratio=0.8)[0]) == 0
    assert len(match(query, signs[:1], train, signs, 0.5, ratio=None)[0]) == 1


def test_pictures_become_grey() -> None:
    colour = np.dstack([np.full((4, 4), value, np.uint8) for value in (10, 20, 30)])

    assert grey_of(Image(colour)).shape == (4, 4)
    assert (grey_of(Image(np.full((4, 4), 0x1234, np.uint16))) == 0x12).all()


def test_descriptor_distances_equal_their_plain_twin() -> None:
    rng = np.random.default_rng(1)
    query, train = (rng.normal(size=(n, 64)).astype(np.float32) for n in (9, 14))
    query /= np.linalg.norm(query, axis=1, keepdims=True)
    train /= np.linalg.norm(train, axis=1, keepdims=True)
    signs = rng.choice(np.array([-1, 0, 1], np.int8), 9), rng.choice(np.array([-1, 0, 1], np.int8), 14)
    plain = ((query[:, None] - train[None]) ** 2).sum(axis=2)
    plain[np.multiply.outer(*signs) < 0] = np.inf

    np.testing.assert_allclose(squared_distances(query, signs[0], train, signs[1]), plain, atol=1e-5)


def test_nearest_groups_are_those_of_the_table_of_all_distances() -> None:
    rng = np.random.default_rng(5)
    query, train = (rng.normal(size=(n, 16)).astype(np.float32) for n in (30, 60))
    query /= np.linalg.norm(query, axis=1, keepdims=True)
    train /= np.linalg.norm(train, axis=1, keepdims=True)
    signs = rng.integers(-1, 2, 30).astype(np.int8), rng.integers(-1, 2, 60).astype(np.int8)
    first = np.array([0, 3, 4, 10, 11, 25, 40, 59])

    found = nearest_groups(query, signs[0], np.ascontiguousarray(train.T), signs[1], first)

    table = np.minimum.reduceat(squared_distances(query, signs[0], train, signs[1]), first, axis=1)
    ordered = np.sort(table, axis=1)
    np.testing.assert_array_equal(found[0], table.argmin(axis=1))
    np.testing.assert_allclose(found[1], ordered[:, 0], atol=1e-6)
    np.testing.assert_allclose(found[2], ordered[:, 1], atol=1e-6)
    np.testing.assert_array_equal(found[3], table.argmin(axis=0))
