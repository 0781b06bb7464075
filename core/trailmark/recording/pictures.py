"""Pictures on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.writing import write_whole

__all__ = ["write_png"]


def write_png(path: Path, picture: npt.NDArray[Any]) -> None:
    """Write a picture, lightly compressed: fast, and small enough.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    picture : (H, W) uint8 or uint16, or (H, W, 3) uint8
        Grey levels, or BGR.

    Raises
    ------
    ConfigError
        If it is of another shape or dtype.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        _, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    except cv2.error as error:
        raise ConfigError(f"OpenCV cannot write a picture of {picture.shape} {picture.dtype} as PNG") from error
    write_whole(path, data.tobytes())
