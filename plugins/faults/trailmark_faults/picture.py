"""The base of faults of pictures, and grids over a picture."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from trailmark.arrays import AnyArray, Float32s, GreyF
from trailmark.frames import RGBD, Frame, Image
from trailmark.interfaces import Fault
from trailmark_faults.image import white_of

__all__ = ["PictureFault", "add_window", "per_channel", "radius_over"]


class PictureFault(Fault):
    """A fault of pictures: `worsen` gets and returns grey levels, whatever the pixels are made of.

    Depth stays as it is.
    """

    kinds = frozenset({"image", "rgbd"})

    @abstractmethod
    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return a picture as the fault leaves it.

        Parameters
        ----------
        levels : (H, W) or (H, W, 3) float32
            Grey levels, 0 black and 255 white; may be written to.
        rng : numpy.random.Generator
            For this picture alone.
        since_s : float
            Time since the first frame [s].

        Returns
        -------
        (H, W) or (H, W, 3) float32
            Rounded and cut off at black and white by the caller.
        """

    def is_on(self, since_s: float) -> bool:
        """Return whether pictures are worse at all now."""
        return True

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame with the picture as `worsen` leaves it."""
        payload = frame.payload
        if not self.is_on(since_s):
            return frame
        match payload:
            case Image(pixels):
                return Frame(frame.sensor, frame.stamp_s, Image(self._worsen_pixels(pixels, rng, since_s)))
            case RGBD(bgr, depth_m):
                return Frame(frame.sensor, frame.stamp_s, RGBD(self._worsen_pixels(bgr, rng, since_s), depth_m))
        return frame

    def _worsen_pixels(self, pixels: AnyArray, rng: np.random.Generator, since_s: float) -> AnyArray:
        white = white_of(pixels)
        levels = pixels.astype(np.float32)
        if white != 255.0:
            levels *= np.float32(255.0 / white)
        levels = self.worsen(levels, rng, since_s)
        if white != 255.0:
            levels = levels * np.float32(white / 255.0)
        worse: AnyArray = np.clip(np.rint(levels), 0.0, white).astype(pixels.dtype)
        return worse


def per_channel(mask: GreyF, levels: Float32s) -> Float32s:
    """Return a mask (H, W) in a shape that multiplies a grey or a colour picture."""
    return mask if levels.ndim == 2 else mask[:, :, None]


def radius_over(shape: tuple[int, ...]) -> GreyF:
    """Return the distance of every pixel from the centre, (H, W), 1 in the corners."""
    height, width = shape[:2]
    v = (np.arange(height, dtype=np.float32) - (height - 1) / 2)[:, None]
    u = (np.arange(width, dtype=np.float32) - (width - 1) / 2)[None, :]
    corner = max(float(np.hypot((height - 1) / 2, (width - 1) / 2)), 1.0)
    radius: GreyF = (np.hypot(u, v) / corner).astype(np.float32)
    return radius


def add_window(shape: tuple[int, ...], size: tuple[int, int], corner_uv: tuple[int, int]) -> tuple[slice, ...] | None:
    """Return where a patch lies in a picture: rows and columns of the picture, then of the patch; None: outside.

    Parameters
    ----------
    shape : tuple of int
        Of the picture.
    size : (int, int)
        Height and width of the patch [px].
    corner_uv : (int, int)
        Where its first pixel falls, column and row [px].
    """
    (height, width), (u, v) = shape[:2], corner_uv
    rows = slice(max(v, 0), min(v + size[0], height))
    columns = slice(max(u, 0), min(u + size[1], width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return None
    return rows, columns, slice(rows.start - v, rows.stop - v), slice(columns.start - u, columns.stop - u)
