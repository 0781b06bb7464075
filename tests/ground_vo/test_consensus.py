"""Votes of the sub-areas."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo.consensus import areas_of, consensus_of, relit
from trailmark_ground_vo.texture import VALUE, X, Y

AREA, CENTRE = (0, 0, 250, 250), (124.5, 124.5)


@pytest.fixture
def texture():
    """Pixels all over the area."""
    rng = np.random.default_rng(3)
    out = np.zeros((8, 2500), np.float32)
    out[X], out[Y] = rng.uniform(0, 250, (2, 2500))
    out[VALUE] = rng.normal(32000.0, 2000.0, 2500)
    return out


def voted(texture, shifts_px, noise=50.0):
    """The consensus where each pixel has moved on by `shifts_px`, (N, 2)."""
    rng = np.random.default_rng(4)
    slopes = tuple(rng.normal(0.0, 1000.0, (2, texture.shape[1])).astype(np.float32))
    differences = -slopes[0] * shifts_px[:, 0] - slopes[1] * shifts_px[:, 1] + rng.normal(0.0, noise, len(shifts_px))
    areas = areas_of(texture, AREA)
    return consensus_of(
        texture, differences.astype(np.float32), slopes, areas=areas, centre=CENTRE, huber=1e9
    ), areas  # fmt: skip


def test_areas_that_say_the_same_agree_wherever_they_lead(texture):
    consensus, _ = voted(texture, np.tile([0.4, -0.2], (2500, 1)))

    assert consensus.n_voting == 25
    assert consensus.share == 1.0


def test_a_share_of_the_areas_may_lie(texture):
    liars = (texture[X] < 100) & (texture[Y] < 100)
    shifts = np.where(liars[:, None], [2.5, 0.0], [0.0, 0.0])

    consensus, areas = voted(texture, shifts)

    assert set(np.flatnonzero(~consensus.agrees)) == set(areas[liars])
    assert consensus.share == pytest.approx(21 / 25)


def test_the_scatter_grows_with_the_square_of_the_noise(texture):
    quiet, loud = (voted(texture, np.zeros((2500, 2)), noise)[0].scatter for noise in (50.0, 200.0))

    np.testing.assert_allclose(np.diag(loud) / np.diag(quiet), 16.0, rtol=0.05)


def test_an_area_in_another_light_is_remembered_in_that_light(texture):
    areas = areas_of(texture, AREA)
    seen = np.where(areas == 12, 0.6 * texture[VALUE] + 3000.0, texture[VALUE])

    out = relit(texture, (seen - texture[VALUE]).astype(np.float32), areas, 1e9)

    np.testing.assert_allclose(out[VALUE], seen, rtol=1e-3)
