"""Floors: different everywhere, in zones, on another day, of photographs."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ConfigError
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.photo import load_photo
from trailmark_sim.ground.weather import Weather

Picture = npt.NDArray[np.uint8]


def ground(floor: str = "wood", weather: Weather | None = None, seed: int = 1) -> GroundTexture:
    return GroundTexture([Zone(Floor(floor))], seed, weather)


@pytest.mark.parametrize("floor", sorted(FLOORS))
def test_a_floor_never_repeats(floor: str) -> None:
    here = ground(floor)
    patch = here.paint(0.3, -0.2, 96)[16:80, 16:80]
    itself = here.paint(0.3, -0.2, 96)

    places = [(0.3 + 2.0**n * 0.0871, -0.2 + 3.0**n * 0.031) for n in range(1, 9)]
    elsewhere = [cv2.matchTemplate(here.paint(x, y, 400), patch, cv2.TM_CCOEFF_NORMED).max() for x, y in places]

    assert cv2.matchTemplate(itself, patch, cv2.TM_CCOEFF_NORMED).max() == pytest.approx(1.0, abs=1e-3)
    assert max(elsewhere) < 0.8


def test_another_seed_is_another_floor() -> None:
    first, second = (ground(seed=seed).paint(1.0, 1.0, 64) for seed in (1, 2))

    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.5


def test_zones_lie_over_each_other() -> None:
    zones = [
        Zone(Floor("wood")),
        Zone(Floor("carpet"), (1.0, 1.5, -1.0, 1.0)),
        Zone(Floor("soil"), (1.4, 2.0, -1.0, 1.0)),
    ]
    texel = 2.6e-4
    mixed = GroundTexture(zones, 1)

    seam = mixed.paint(1.0 - 32 * texel + 1e-9, 0.0, 64)

    np.testing.assert_array_equal(seam[:, :32], ground("wood").paint(1.0 - 32 * texel + 1e-9, 0.0, 64)[:, :32])
    np.testing.assert_array_equal(seam[:, 32:], ground("carpet").paint(1.0 - 32 * texel + 1e-9, 0.0, 64)[:, 32:])
    np.testing.assert_array_equal(mixed.paint(1.45, 0.0, 32), ground("soil").paint(1.45, 0.0, 32))
    np.testing.assert_array_equal(mixed.paint(3.0, 0.0, 32), ground("wood").paint(3.0, 0.0, 32))


def test_planks_run_in_the_direction_of_their_zone() -> None:
    along = ground("wood").paint(0.02, 0.02, 200)
    across = GroundTexture([Zone(Floor("wood", yaw_rad=math.pi / 2))], 1).paint(0.02, 0.02, 200)

    def roughness(grey: npt.NDArray[np.float32], axis: int) -> float:
        return float(np.abs(np.diff(cv2.GaussianBlur(grey, (0, 0), 2), axis=axis)).mean())

    assert roughness(along, 0) > 1.5 * roughness(along, 1)
    assert roughness(across, 1) > 1.5 * roughness(across, 0)


def test_dirt_changes_the_floor_by_its_weight_and_not_its_mean() -> None:
    clean = ground("concrete").paint(0.0, 0.0, 700)
    light, heavy = (ground("concrete", Weather(2, dirt=dirt)).paint(0.0, 0.0, 700) - clean for dirt in (0.25, 1.0))

    np.testing.assert_allclose(heavy, 4.0 * light, atol=1e-3)
    assert heavy.std() == pytest.approx(8.5, abs=2.5)
    assert abs(heavy.mean()) < 3.0


def test_dirt_lies_elsewhere_on_another_day() -> None:
    second, third = (ground("concrete", Weather(day, dirt=1.0)).paint(0.0, 0.0, 400) for day in (2, 3))
    clean = ground("concrete").paint(0.0, 0.0, 400)

    assert abs(np.corrcoef((second - clean).ravel(), (third - clean).ravel())[0, 1]) < 0.4


def test_as_many_leaves_lie_as_are_told_and_hide_the_floor() -> None:
    grey = np.zeros((1000, 1000), dtype=np.float32)
    y, x = np.indices(grey.shape) * 2e-3

    Weather(1, leaves_per_m2=10.0).change(grey, x, y)  # 4 m^2

    covered = grey > 20.0
    n_leaves = cv2.connectedComponents(covered.astype(np.uint8))[0] - 1
    assert 25 <= n_leaves <= 50  # 40, some of them overlapping
    # a leaf of half length h: 2 * 0.4 * 4/3 h^2, h between 15 and 35 mm
    assert covered.mean() == pytest.approx(10.0 * 0.8 * 4 / 3 * (0.025**2 + 0.02**2 / 12), rel=0.35)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_wet_ground_is_darker_over_its_share(share: float) -> None:
    grey = np.full((900, 900), 100.0, dtype=np.float32)
    y, x = np.indices(grey.shape) * 0.02  # 18 m

    Weather(1, wet=share).change(grey, x, y)

    assert grey.min() == pytest.approx(65.0)
    assert grey.max() == 100.0
    assert (grey < 82.5).mean() == pytest.approx(share, abs=0.06)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    rng = np.random.default_rng(7)
    picture = cv2.GaussianBlur(rng.normal(0, 60, (240, 320)), (0, 0), 1.5) + np.where(
        rng.random((240, 320)) < 0.02, 60, 0
    )
    path = tmp_path / "flöör.png"
    path.write_bytes(cv2.imencode(".png", np.clip(picture + 90, 0, 255).astype(np.uint8))[1].tobytes())
    return path


def test_a_photograph_becomes_a_floor_that_looks_like_it(photo: Path) -> None:
    original = cv2.imdecode(np.fromfile(photo, np.uint8), cv2.IMREAD_GRAYSCALE)
    texel = 0.2 / 512
    floor = GroundTexture([Zone(Floor(photo=photo))], 1, texel_m=texel).paint(12.0, -5.0, 1000)

    assert floor.mean() == pytest.approx(original.mean(), abs=2.0)
    assert floor.std() == pytest.approx(original.std(), rel=0.1)
    quantiles = [0.01, 0.1, 0.5, 0.9, 0.99]
    np.testing.assert_allclose(np.quantile(floor, quantiles), np.quantile(original, quantiles), atol=8.0)


def test_a_floor_of_a_photograph_does_not_repeat(photo: Path) -> None:
    floor = GroundTexture([Zone(Floor(photo=photo))], 1, texel_m=0.2 / 512).paint(0.0, 0.0, 1300)

    patch = floor[600:664, 600:664]
    match = cv2.matchTemplate(floor, patch, cv2.TM_CCOEFF_NORMED)
    match[580:620, 580:620] = 0.0

    # pieces of the photograph come again, but by chance and blended; a plain tiling gives 1.0 at every period
    assert np.sort(match.ravel())[-1] < 0.995
    assert (match > 0.9).mean() < 1e-4


def test_a_photograph_is_brought_to_the_size_of_the_texels(photo: Path) -> None:
    fine = load_photo(photo, 320 * 1e-4, 2e-4)

    assert fine.grey.shape == (120, 160)
    assert fine.pitch_m == 2e-4


@pytest.mark.parametrize(
    ("name", "content", "story"),
    [
        ("missing.jpg", None, "is not there"),
        ("text.jpg", b"no picture", "is not a picture that OpenCV can read"),
        ("empty.png", b"", "is not a picture that OpenCV can read"),
    ],
)
def test_a_photograph_that_cannot_be_used_is_one_clear_line(
    tmp_path: Path, name: str, content: bytes | None, story: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)

    with pytest.raises(ConfigError, match=story) as caught:
        GroundTexture([Zone(Floor(photo=tmp_path / name))], 1).load()
    assert name in str(caught.value)


def test_a_photograph_of_almost_nothing_is_refused(photo: Path) -> None:
    with pytest.raises(ConfigError, match="is its width right"):
        load_photo(photo, 0.004, 2.6e-4)


def test_a_photograph_of_a_whole_field_is_refused(photo: Path) -> None:
    with pytest.raises(ConfigError, match="more than 200 million"):
        load_photo(photo, 50.0, 2.6e-4)


def test_a_photograph_of_one_grey_is_a_floor_of_one_grey(tmp_path: Path) -> None:
    path = tmp_path / "blank.png"
    path.write_bytes(cv2.imencode(".png", np.full((100, 100), 77, np.uint8))[1].tobytes())

    floor = GroundTexture([Zone(Floor(photo=path))], 1).paint(0.0, 0.0, 50)

    np.testing.assert_allclose(floor, 77.0)
