"""Distances between descriptors, on one thread: BLAS starts its own, and waits for them on a busy machine."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["squared_unit_distances"]

Array = npt.NDArray[Any]


@numba.njit(cache=True, nogil=True)
def squared_unit_distances(
    query: Array, query_sign: Array, train_transposed: Array, train_sign: Array, out: Array
) -> None:
    """Write ``2 - 2 q.t`` of unit vectors to `out`, (N, M) float64; infinite between signs that differ.

    Parameters
    ----------
    query : (N, D) float32
        Unit vectors.
    query_sign, train_sign : (N,) and (M,) int8
        Signs; 0 goes with both.
    train_transposed : (D, M) float32
        Unit vectors as columns, so that the inner loop runs along memory.
    out : (N, M) float64
        Squared distances.
    """
    row = np.empty(train_transposed.shape[1], np.float32)
    for n in range(query.shape[0]):
        row[:] = np.float32(0.0)
        for d in range(query.shape[1]):
            value, column = query[n, d], train_transposed[d]
            for m in range(row.shape[0]):
                row[m] += value * column[m]
        for m in range(row.shape[0]):
            differs = query_sign[n] * train_sign[m] < 0
            out[n, m] = np.inf if differs else max(2.0 - 2.0 * row[m], 0.0)
