"""Distances between descriptors, on one thread: BLAS starts its own, and waits for them on a busy machine."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = ["nearest_groups", "squared_unit_distances"]


@kernel
def squared_unit_distances(
    query: AnyArray, query_sign: AnyArray, train_transposed: AnyArray, train_sign: AnyArray, out: AnyArray
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


@kernel
def nearest_groups(
    query: AnyArray, query_sign: AnyArray, train_transposed: AnyArray, train_sign: AnyArray, first: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """Find for every query the group of vectors that has the nearest one, and the other way round.

    Parameters
    ----------
    query : (N, D) float32
        Unit vectors, N >= 1.
    query_sign, train_sign : (N,) and (M,) int8
        Signs; 0 goes with both.
    train_transposed : (D, M) float32
        Unit vectors as columns, those of one group in a row.
    first : (L,) intp
        Where each group begins, L >= 1.

    Returns
    -------
    nearest : (N,) intp
        Nearest group of each query.
    squared, second : (N,) float64
        Squared distance to it and to the second nearest group; infinite where signs differ from all.
    nearest_query : (L,) intp
        Nearest query of each group.
    """
    n_queries, n_train, n_groups = query.shape[0], train_transposed.shape[1], first.shape[0]
    nearest, nearest_query = np.zeros(n_queries, np.intp), np.zeros(n_groups, np.intp)
    squared, second = np.full(n_queries, np.inf), np.full(n_queries, np.inf)
    nearest_squared = np.full(n_groups, np.inf)
    row = np.empty(n_train, np.float32)
    for n in range(n_queries):
        row[:] = np.float32(0.0)
        for d in range(query.shape[1]):
            value, column = query[n, d], train_transposed[d]
            for m in range(n_train):
                row[m] += value * column[m]
        for group in range(n_groups):
            end = first[group + 1] if group + 1 < n_groups else n_train
            likeness = -np.inf
            for m in range(first[group], end):
                if query_sign[n] * train_sign[m] >= 0:
                    likeness = max(likeness, row[m])
            distance = max(2.0 - 2.0 * likeness, 0.0)
            if distance < nearest_squared[group]:
                nearest_squared[group], nearest_query[group] = distance, n
            if distance < squared[n]:
                second[n], squared[n], nearest[n] = squared[n], distance, group
            elif distance < second[n]:
                second[n] = distance
    return nearest, squared, second, nearest_query
