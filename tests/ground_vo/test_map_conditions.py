"""How the page of the conditions judges what `ground_map` says of taught and other ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Fix
from trailmark.geometry import Pose2


@pytest.fixture(scope="module")
def page(load_script):
    return load_script("benchmarks/ground_map_conditions.py")


@pytest.mark.parametrize(
    ("error_deg", "sigma_deg", "counts"),
    [
        (0.9, 0.1, (1, 0, 0)),
        (1.1, 0.9, (0, 1, 0)),
        (1.1, 0.1, (0, 1, 1)),
        (24.0, 5.0, (1, 0, 0)),
        (30.0, 5.0, (0, 1, 1)),
    ],
)
def test_a_heading_is_wrong_beyond_one_degree_or_where_it_is_not_told_beyond_its_sigmas(
    page, error_deg, sigma_deg, counts
):
    fix = Fix(0.0, Pose2(0.0, 0.0, math.radians(error_deg)), np.diag([1e6, 1e6, math.radians(sigma_deg) ** -2]))

    row = page.judged([(page.Look(0, 0, Pose2(), Pose2()), fix)])

    assert tuple(row[key] for key in ("found", "wrong", "sure")) == counts


def test_copies_of_the_taught_ground_have_a_row_of_their_own(page):
    row = {"condition": "nominal", "taught": "clean", "seed": 0, "found": 0, "headings": 0, "worst_mm": 0.0}
    taught = row | {"floor": "turf", "n_taught": 40, "n_other": 0, "found": 40, "wrong": 0, "sure": 0}
    copies = row | {"floor": f"{page.COPIES}, turf", "n_taught": 0, "n_other": 9, "wrong": 7, "sure": 7}

    lines = page.page([taught, copies]).splitlines()

    assert lines[0].startswith("40 searches on 1 floors: 0 wrong")
    assert "9 searches, 7 wrong, 7 of them sure" in lines[0]
    assert lines[-1] == f"| {page.COPIES}, all conditions | both | 0 / 9 | - | - | - | 7 | 7 | - |"
