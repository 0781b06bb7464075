"""A downward camera over a floor, rendered exactly: frames, true poses and calibration for tests.

Conventions. The map's x axis runs along the columns of the texture and its y axis against the rows, so that
the texture looks as it would from above; the centre of texel (row 0, column 0) is the map's origin. The
camera's axes are x along +u and y along -v of its picture, with the origin at the picture's centre
``((W - 1) / 2, (H - 1) / 2)``. A mounting yaw of 180 deg makes -u the forward direction.

::

    run = ground_run(straight(0.26), n_frames=200, ground=Ground.procedural(seed=3))
    for frame in run.frames:
        ...                         # rendered when asked for
    run.truth, run.sensor
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import overload

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray, Float32s, Floats, Indices
from trailmark.errors import ShapeError
from trailmark.frames import Frame, GroundPlane, Image, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Pose3, Trajectory
from trailmark.testing.motions import MotionLaw, circle, straight, true_poses

__all__ = [
    "GroundCamera",
    "GroundFrames",
    "GroundRun",
    "MirroredFloor",
    "MotionLaw",
    "circle",
    "ground_run",
    "straight",
]


@dataclass(frozen=True, eq=False)
class MirroredFloor:
    """A floor without end: one picture, mirrored at its edges again and again.

    Attributes
    ----------
    texture : (H, W) uint8 or float32
        Float32s levels of the floor.
    metres_per_texel : float
        Size of a texel on the floor [m].
    """

    texture: AnyArray
    metres_per_texel: float = 3.9e-4

    def __post_init__(self) -> None:
        if self.texture.ndim != 2 or self.texture.size == 0 or self.texture.dtype not in (np.uint8, np.float32):
            raise ShapeError(
                f"a ground texture is (H, W) uint8 or float32, not {self.texture.shape} {self.texture.dtype}"
            )

    @classmethod
    def procedural(
        cls,
        seed: int,
        size_px: int = 1024,
        metres_per_texel: float = 3.9e-4,
        grain_px: float = 2.0,
        contrast: float = 14.0,
    ) -> MirroredFloor:
        """Return a floor of band-limited noise: half fine grain, half patches of eight grains.

        Parameters
        ----------
        grain_px : float
            Standard deviation of the finest blobs [texels]; from 2 on, interpolation errors vanish in noise.
        contrast : float
            Standard deviation of the grey levels.
        """
        import cv2

        rng = np.random.default_rng(seed)
        total = np.zeros((size_px, size_px), np.float32)
        for sigma_px in (grain_px, 8.0 * grain_px):
            white = rng.standard_normal((size_px, size_px), dtype=np.float32)
            layer = cv2.GaussianBlur(white, (0, 0), sigma_px)
            total += np.asarray(layer / layer.std(), np.float32)
        texture = 128.0 + contrast / total.std() * (total - total.mean())
        return cls(np.asarray(np.clip(texture, 0.0, 255.0), np.float32), metres_per_texel)

    def window(self, row: int, column: int, height: int, width: int) -> Float32s:
        """Return a rectangle of the endless texture as float32; rows and columns may be any integers."""
        rows = _mirror_indices(row, height, self.texture.shape[0])
        columns = _mirror_indices(column, width, self.texture.shape[1])
        return np.asarray(self.texture[np.ix_(rows, columns)], np.float32)


def _mirror_indices(start: int, count: int, size: int) -> Indices:
    phase = np.arange(start, start + count) % (2 * size)
    return np.where(phase < size, phase, 2 * size - 1 - phase)


@dataclass(frozen=True, eq=False)
class GroundCamera:
    """A camera that looks straight down; the defaults are the camera of Nagai & Watanabe (2015).

    Attributes
    ----------
    size : (int, int)
        Width and height [px].
    metres_per_pixel : (float, float)
        Ground distance of one pixel along u and along v [m/px].
    mounting : Pose3
        ``pose_base_sensor``, level; see the module for the camera's axes.
    noise_sigma : float
        Standard deviation of the pixel noise [grey levels].
    vignette : float
        Loss of light at the corners, 0 to 1.
    gain, offset : float
        Float32s level = gain * floor + offset, before noise.
    supersample : int
        Samples per pixel and axis: a pixel is the mean over its area.
    lens : Pinhole or None
        Lens distortion to render.
    """

    size: tuple[int, int] = (512, 480)
    metres_per_pixel: tuple[float, float] = (3.9e-4, 3.9e-4)
    mounting: Pose3 = Pose3(yaw=-math.pi)
    noise_sigma: float = 0.0
    vignette: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    supersample: int = 2
    lens: Pinhole | None = None

    def sensor_info(self, name: str = "floor", rate_hz: float | None = None) -> SensorInfo:
        """Return what a source would say of this camera: its true calibration."""
        flat = self.flat_field / np.float32(self.flat_field.mean()) if self.vignette else None
        calibration = GroundPlane(self.metres_per_pixel, self.lens, flat)
        return SensorInfo(name, "image", self.size, rate_hz, self.mounting, calibration)

    @cached_property
    def flat_field(self) -> Float32s:
        """Share of the light that reaches each pixel, (H, W), 1 at the centre."""
        width, height = self.size
        u, v = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
        squared = (u[None, :] ** 2 + v[:, None] ** 2) / (u[0] ** 2 + v[0] ** 2)
        return np.asarray(1.0 - self.vignette * squared, np.float32)

    def view(self, ground: MirroredFloor, pose_map_base: Pose2) -> Float32s:
        """Return the noiseless picture from a pose, not rounded to grey levels, (H, W) float32."""
        matrix = self._texel_from_pixel(ground, pose_map_base)
        shape = (self.size[1], self.size[0])
        corners = matrix @ np.array(
            [[-2.0, shape[1] + 1, -2.0, shape[1] + 1], [-2.0, -2.0, shape[0] + 1, shape[0] + 1], [1, 1, 1, 1]]
        )
        if self.lens is not None:  # distorted pixels see a little more than the corners of the ideal picture
            corners = corners.mean(axis=1, keepdims=True) + 1.3 * (corners - corners.mean(axis=1, keepdims=True))
        low = np.floor(corners.min(axis=1)).astype(int) - 1
        high = np.ceil(corners.max(axis=1)).astype(int) + 2
        window = ground.window(low[1], low[0], high[1] - low[1], high[0] - low[0])
        matrix[:, 2] -= low  # small numbers from here on: exact far from the origin too
        irradiance = self._sample_window(window, matrix)
        return np.asarray(irradiance * (self.gain * self.flat_field) + np.float32(self.offset), np.float32)

    def image(
        self, ground: MirroredFloor, pose_map_base: Pose2, seed: int = 0, index: int = 0
    ) -> npt.NDArray[np.uint8]:
        """Return the picture from a pose with noise seeded by (seed, index), (H, W) uint8."""
        view = self.view(ground, pose_map_base)
        if self.noise_sigma > 0:
            rng = np.random.default_rng([seed, index])
            view = view + np.float32(self.noise_sigma) * rng.standard_normal(view.shape, dtype=np.float32)
        return np.clip(np.rint(view), 0.0, 255.0).astype(np.uint8)

    def _texel_from_pixel(self, ground: MirroredFloor, pose_map_base: Pose2) -> Floats:
        """Return the (2, 3) affine map from (u, v, 1) to (column, row) of the endless texture."""
        pose = pose_map_base @ self.mounting.planar()
        cos, sin = math.cos(pose.theta), math.sin(pose.theta)
        along_u, along_v = (scale / ground.metres_per_texel for scale in self.metres_per_pixel)
        linear = np.array([[cos * along_u, sin * along_v], [-sin * along_u, cos * along_v]])
        centre = np.array([pose.x, -pose.y]) / ground.metres_per_texel
        middle = np.array([(self.size[0] - 1) / 2, (self.size[1] - 1) / 2])
        return np.column_stack([linear, centre - linear @ middle])

    def _sample_window(self, window: Float32s, matrix: Floats) -> Float32s:
        import cv2

        n, (width, height) = self.supersample, self.size
        if self.lens is not None:
            samples = cv2.remap(window, *self._rays(matrix), cv2.INTER_LINEAR)
        else:
            # sample (i, j) of pixel (0, 0) lies at ((i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5)
            fine = matrix.copy()
            fine[:, :2] /= n
            fine[:, 2] += matrix[:, :2].sum(axis=1) * (0.5 / n - 0.5)
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            samples = cv2.warpAffine(window, fine, (n * width, n * height), flags=flags)
        return np.asarray(samples if n == 1 else cv2.resize(samples, (width, height), interpolation=cv2.INTER_AREA))

    def _rays(self, matrix: Floats) -> tuple[Float32s, Float32s]:
        ideal = self._ideal_pixels
        x = matrix[0, 0] * ideal[..., 0] + matrix[0, 1] * ideal[..., 1] + matrix[0, 2]
        y = matrix[1, 0] * ideal[..., 0] + matrix[1, 1] * ideal[..., 1] + matrix[1, 2]
        return np.asarray(x, np.float32), np.asarray(y, np.float32)

    @cached_property
    def _ideal_pixels(self) -> Floats:
        """Where an ideal lens would show what each sample of this one sees, (n H, n W, 2) [px]."""
        import cv2

        assert self.lens is not None
        n, (width, height) = self.supersample, self.size
        u, v = np.meshgrid((np.arange(n * width) + 0.5) / n - 0.5, (np.arange(n * height) + 0.5) / n - 0.5)
        seen = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        matrix, distortion = self.lens.matrix(), np.array(self.lens.distortion)
        ideal = cv2.undistortPoints(seen, matrix, distortion, P=matrix)
        return np.asarray(ideal, np.float64).reshape(n * height, n * width, 2)


@dataclass(frozen=True, eq=False)
class GroundFrames(Sequence[Frame]):
    """The frames of a run, rendered when asked for and never kept.

    Attributes
    ----------
    ground : MirroredFloor
        The floor that the camera looks at.
    camera : GroundCamera
        Size, height and calibration.
    truth : Trajectory
        ``pose_map_base`` at each picture.
    sensor : str
        Name of the camera.
    seed : int
        Of the noise.
    """

    ground: MirroredFloor
    camera: GroundCamera
    truth: Trajectory
    sensor: str
    seed: int

    def __len__(self) -> int:
        return len(self.truth)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | Sequence[Frame]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        position = range(len(self))[index]
        stamp_s, pose = self.truth[position]
        return Frame(self.sensor, stamp_s, Image(self.camera.image(self.ground, pose, self.seed, position)))

    def __iter__(self) -> Iterator[Frame]:
        return (self[index] for index in range(len(self)))


@dataclass(frozen=True, eq=False)
class GroundRun:
    """A synthetic drive over a floor.

    Attributes
    ----------
    frames : sequence of Frame
        Pictures of 8 bits, rendered when asked for.
    truth : Trajectory
        True pose of base in the map, one per frame.
    sensor : SensorInfo
        The camera, with its true mounting and calibration.
    """

    frames: GroundFrames
    truth: Trajectory
    sensor: SensorInfo

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The camera, by its name."""
        return {self.sensor.name: self.sensor}

    def over(self, ground: MirroredFloor) -> GroundRun:
        """Return the same drive over another floor."""
        return replace(self, frames=replace(self.frames, ground=ground))


def ground_run(
    motion: MotionLaw,
    n_frames: int,
    *,
    rate_hz: float = 70.0,
    ground: MirroredFloor | None = None,
    camera: GroundCamera | None = None,
    seed: int = 0,
    sensor: str = "floor",
) -> GroundRun:
    """Return a drive of `n_frames` frames; the same arguments give the same pixels.

    Parameters
    ----------
    motion : callable
        Pose of base at a time, for example `straight` or `circle`.
    ground : MirroredFloor, optional
        The floor; a procedural one from `seed` unless given.
    camera : GroundCamera, optional
        The camera of the paper, with noise of 3 grey levels, unless given.
    seed : int
        Of the noise, and of the procedural floor.
    """
    ground = MirroredFloor.procedural(seed) if ground is None else ground
    camera = GroundCamera(noise_sigma=3.0) if camera is None else camera
    truth = true_poses(motion, n_frames, rate_hz)
    frames = GroundFrames(ground, camera, truth, sensor, seed)
    return GroundRun(frames, truth, camera.sensor_info(sensor, rate_hz))
