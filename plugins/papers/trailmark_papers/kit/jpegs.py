"""Photographs in drawings, as JPEGs."""

from __future__ import annotations

import base64
import re

import numpy as np

__all__ = ["with_jpegs"]

_PNG = re.compile(r'data:image/png;base64,([^"]*)')
_JPEG_QUALITY = 85


def with_jpegs(svg: str) -> str:
    """Return a drawing whose pictures are JPEGs: matplotlib embeds PNGs, several times as large for photographs.

    Raises
    ------
    ValueError
        If a picture of it is transparent somewhere, which a JPEG cannot be.
    """
    return _PNG.sub(_as_jpeg, svg)


def _as_jpeg(embedded: re.Match[str]) -> str:
    import cv2

    png = np.frombuffer(base64.b64decode(embedded[1]), np.uint8)
    picture = np.asarray(cv2.imdecode(png, cv2.IMREAD_UNCHANGED), np.uint8)
    if picture.ndim == 3 and picture.shape[2] == 4:
        if picture[..., 3].min() < 255:
            raise ValueError("a picture that is transparent somewhere cannot be a JPEG")
        picture = picture[..., :3]
    jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg.tobytes()).decode()}"
