"""Types of arrays, by what is in them. The shape stands in the docstring of who takes or returns one."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = [
    "AnyArray",
    "Bgr8",
    "Bools",
    "Bytes",
    "Depth",
    "Float32s",
    "Floats",
    "Grey8",
    "Grey16",
    "GreyF",
    "Indices",
    "Int32s",
    "Int64s",
]

#: Any dtype; for what only moves arrays about.
AnyArray: TypeAlias = npt.NDArray[Any]
#: Numbers: points (N, 2) or (N, 3), poses (N, 3), matrices, vectors.
Floats: TypeAlias = npt.NDArray[np.float64]
#: Numbers at half the width, where bandwidth decides.
Float32s: TypeAlias = npt.NDArray[np.float32]
#: Rows and columns of other arrays.
Indices: TypeAlias = npt.NDArray[np.intp]
Int32s: TypeAlias = npt.NDArray[np.int32]
Int64s: TypeAlias = npt.NDArray[np.int64]
#: Masks.
Bools: TypeAlias = npt.NDArray[np.bool_]
#: Raw bytes, packed bits, labels.
Bytes: TypeAlias = npt.NDArray[np.uint8]
#: A grey picture (H, W).
Grey8: TypeAlias = npt.NDArray[np.uint8]
Grey16: TypeAlias = npt.NDArray[np.uint16]
GreyF: TypeAlias = npt.NDArray[np.float32]
#: A colour picture (H, W, 3), blue first.
Bgr8: TypeAlias = npt.NDArray[np.uint8]
#: Metres (H, W), NaN where unknown.
Depth: TypeAlias = npt.NDArray[np.float32]
