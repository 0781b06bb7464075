"""The localizer `phase_correlation`."""

from __future__ import annotations

import math
from functools import cached_property

import cv2
import numpy as np

from trailmark.arrays import Float32s
from trailmark.geometry import Pose2
from trailmark.geometry.rigid import fit_pose2
from trailmark_baselines.ground.camera import Grey, Points
from trailmark_baselines.ground.config import PhaseCorrelationConfig
from trailmark_baselines.ground.localizer import GroundPeer, KeyframeMatch, Unaligned
from trailmark_baselines.ground.rigid import alignment_covariance

__all__ = ["PhaseCorrelation"]


#: Standard deviation that a window's shift has at least [px].
_SIGMA_PX = 0.05
#: Two pictures without any contrast correlate perfectly, wherever they are [grey levels].
_LEAST_CONTRAST = 0.5
#: Angles in which the spectrum is compared: half a turn, in this many rows.
_N_ANGLES = 360


class _Spectrum:
    def __init__(self, image: Grey) -> None:
        self.image = np.asarray(image, np.float32)

    @cached_property
    def spectrum(self) -> Float32s:
        """Magnitudes by direction (half a turn) and logarithm of the frequency: turns with the picture."""
        side = min(self.image.shape)
        top, left = (n - side >> 1 for n in self.image.shape)
        window = np.asarray(cv2.createHanningWindow((side, side), cv2.CV_32F), np.float32)
        part = self.image[top : top + side, left : left + side]
        magnitude = np.fft.fftshift(np.abs(np.fft.fft2((part - part.mean()) * window)))
        full = cv2.warpPolar(
            np.log1p(magnitude).astype(np.float32), (side // 2, 2 * _N_ANGLES), (side / 2, side / 2), side / 2,
            cv2.WARP_POLAR_LOG | cv2.INTER_LINEAR,
        )  # fmt: skip
        return np.ascontiguousarray(full[:_N_ANGLES, side // 8 :])


class PhaseCorrelation(GroundPeer[_Spectrum]):
    """Windows of the key frame, phase-correlated with the picture after it was moved to where it is expected.

    The turn comes from the shifts of the windows, which are finer than the log-polar spectrum; the spectrum serves
    where nothing is known of the turn, or what was expected does not fit.
    """

    config: PhaseCorrelationConfig

    def view(self, image: Grey) -> _Spectrum:
        """Return the picture."""
        return _Spectrum(image)

    def align(self, key: _Spectrum, now: _Spectrum, expected: Pose2) -> KeyframeMatch | Unaligned:
        """Correlate, move by what was found, and correlate again; from the spectrum's turn where that fails."""
        found = self._correlate(key, now, expected)
        if isinstance(found, Unaligned):
            again = self._correlate(key, now, Pose2(expected.x, expected.y, self._coarse_turn(key, now)))
            return found if isinstance(again, Unaligned) else again
        return found

    def _correlate(self, key: _Spectrum, now: _Spectrum, expected: Pose2) -> KeyframeMatch | Unaligned:
        config, size = self.config, (key.image.shape[1], key.image.shape[0])
        unit_m = self.camera.plane.metres_per_pixel[0]
        boxes, pose = _boxes(size, config.windows), expected
        middles = np.array([((left + right - 1) / 2.0, (top + bottom - 1) / 2.0) for left, top, right, bottom in boxes])
        window = cv2.createHanningWindow((boxes[0][2] - boxes[0][0], boxes[0][3] - boxes[0][1]), cv2.CV_32F)
        for _ in range(config.iterations):
            moved = self._as_from_key(now.image, pose, size)
            shifts, responses = np.empty((len(boxes), 2)), np.empty(len(boxes))
            for n, (left, top, right, bottom) in enumerate(boxes):
                here, there = (picture[top:bottom, left:right] for picture in (key.image, moved))
                shifts[n], responses[n] = cv2.phaseCorrelate(here, there, window)
            # what stands at `middles` in the key frame is found `shifts` further in the moved picture
            a = self.camera.on_ground(middles, size)
            b = pose.inverse() @ self.camera.on_ground(middles + shifts, size)
            pose = fit_pose2(a, b)
        left_m = a - pose @ b
        spread_px = math.sqrt(float(np.mean(np.sum(left_m**2, axis=1)))) / unit_m
        response = float(responses.mean())
        details = {"response": response, "spread_px": spread_px}
        if min(float(key.image.std()), float(now.image.std())) < _LEAST_CONTRAST:
            return Unaligned("nothing to see", details)
        if response < config.min_response:
            return Unaligned(f"no peak: response {response:.3f}", details)
        if spread_px > config.tolerance_px:
            return Unaligned(f"windows disagree by {spread_px:.1f} px", details)
        return KeyframeMatch(pose, alignment_covariance(a, pose, b, _SIGMA_PX * unit_m), False, details)

    def _as_from_key(self, image: Float32s, pose_key_now: Pose2, size: tuple[int, int]) -> Float32s:
        """Return the picture as it would look from the key frame."""
        three: Points = np.array([[0.0, 0.0], [size[0], 0.0], [0.0, size[1]]])
        ground = pose_key_now.inverse() @ self.camera.on_ground(three, size)
        matrix = cv2.getAffineTransform(
            three.astype(np.float32), self.camera.in_picture(ground, size).astype(np.float32)
        )
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REFLECT), np.float32)

    def _coarse_turn(self, key: _Spectrum, now: _Spectrum) -> float:
        (_, rows), _ = cv2.phaseCorrelate(key.spectrum, now.spectrum)
        return float(rows * math.pi / _N_ANGLES)


def _boxes(size: tuple[int, int], n: int) -> list[tuple[int, int, int, int]]:
    """Return windows (left, top, right, bottom), n by n, that leave a rim for what moves out of the picture."""
    rim_u, rim_v = size[0] // 10, size[1] // 10
    width, height = (size[0] - 2 * rim_u) // n, (size[1] - 2 * rim_v) // n
    corners = [(rim_u + i * width, rim_v + j * height) for j in range(n) for i in range(n)]
    return [(left, top, left + width, top + height) for left, top in corners]
