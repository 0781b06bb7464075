"""The median and the solution of a small system are numpy's, and are compiled once."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo import audit
from trailmark_ground_vo.few_numbers import median_of, solve_symmetric
from trailmark_ground_vo.motion import ImageMotion


@pytest.mark.parametrize("n", [1, 2, 5, 16, 25])
def test_the_median_is_that_of_numpy(n):
    values = np.random.default_rng(n).normal(size=n)
    values[n // 2] = values[0]  # equal ones, too
    kept = values.copy()

    assert median_of(values) == np.median(values)
    np.testing.assert_array_equal(values, kept)


def test_a_symmetric_system_is_solved_as_numpy_does():
    rng = np.random.default_rng(3)
    slopes = rng.normal(size=(40, 3)) * (1.0, 30.0, 200.0)
    a, right = slopes.T @ slopes + np.eye(3), rng.normal(size=3)

    solved, variances = solve_symmetric(tuple(a[np.triu_indices(3)].tolist()), tuple(right.tolist()))

    np.testing.assert_allclose(solved, np.linalg.solve(a, right), rtol=1e-9)
    np.testing.assert_allclose(variances, np.diag(np.linalg.inv(a)), rtol=1e-9)


def test_an_audit_is_compiled_once_whether_or_not_pixels_leave_the_picture():
    picture = np.random.default_rng(0).integers(0, 4000, (96, 128)).astype(np.uint16)
    grid = audit.MotionAudit((128, 96), 1.0)

    for u in (0.0, 20.0):
        grid.audit(picture, picture, ImageMotion(u, 0.0, 0.0))

    assert len(audit._equations.signatures) == 1
