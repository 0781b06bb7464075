"""Kernels of localization from bearings: the closed form, its refinement, the error of each landmark."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = [
    "bearing_errors",
    "bearing_jacobian",
    "bearing_scales",
    "closed_form",
    "cost_and_step",
    "hypotheses",
    "refine",
    "support",
]


@kernel
def bearing_errors(landmarks: AnyArray, bearings: AnyArray, pose: AnyArray) -> AnyArray:
    """Return measured minus predicted bearing of every landmark, alpha - beta of Eq. (4), in [-pi, pi) [rad]."""
    errors = np.empty(bearings.shape[0])
    for n in range(bearings.shape[0]):
        beta = math.atan2(landmarks[n, 1] - pose[1], landmarks[n, 0] - pose[0]) - pose[2]  # Eq. (6)
        error = bearings[n] - beta
        errors[n] = error - 2.0 * math.pi * math.floor((error + math.pi) / (2.0 * math.pi))
    return errors


@kernel
def bearing_scales(landmarks: AnyArray, covariances: AnyArray, pose: AnyArray, sigma_rad: float) -> AnyArray:
    """Return what makes the error of every landmark comparable: noise of a bearing over that of this one, (N,).

    What a landmark was mismeasured by across the line of sight is seen as an error of its bearing.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map [m].
    covariances : (N, 2, 2) float64
        Of the positions [m^2].
    pose : (3,) float64
        Camera in the map [m, m, rad].
    sigma_rad : float
        Noise of a bearing, one standard deviation [rad].

    Returns
    -------
    (N,) float64
        Factors, at most 1.
    """
    scales = np.empty(landmarks.shape[0])
    for n in range(landmarks.shape[0]):
        dx, dy = landmarks[n, 0] - pose[0], landmarks[n, 1] - pose[1]
        squared = max(dx * dx + dy * dy, 1e-4)
        c = covariances[n]
        across = dy * dy * c[0, 0] - 2.0 * dx * dy * c[0, 1] + dx * dx * c[1, 1]
        scales[n] = sigma_rad / math.sqrt(sigma_rad * sigma_rad + max(across, 0.0) / (squared * squared))
    return scales


@kernel
def closed_form(landmarks: AnyArray, bearings: AnyArray, weights: AnyArray) -> AnyArray:
    """Return the pose (x, y, theta) of at least three bearings; NaN where they do not define one.

    A landmark lies on its ray: ``sin(phi) (x - X) - cos(phi) (y - Y) = 0`` with ``phi = alpha + Theta``. In
    c = cos Theta, s = sin Theta, p = s X - c Y and q = c X + s Y this is linear and homogeneous; p and q are
    eliminated, and the smallest eigenvector of what remains is (c, s) up to its sign, which the landmarks lying
    ahead of their rays, not behind, decide.
    """
    pose = np.full(3, np.nan)
    centre_x, centre_y = landmarks[:, 0].mean(), landmarks[:, 1].mean()
    m = np.zeros((4, 4))
    row = np.empty(4)
    for n in range(bearings.shape[0]):
        x, y = landmarks[n, 0] - centre_x, landmarks[n, 1] - centre_y
        sin, cos = math.sin(bearings[n]), math.cos(bearings[n])
        row[0], row[1], row[2], row[3] = sin * x - cos * y, cos * x + sin * y, -cos, -sin
        for a in range(4):
            for b in range(4):
                m[a, b] += weights[n] * row[a] * row[b]
    determinant = m[2, 2] * m[3, 3] - m[2, 3] * m[3, 2]
    if determinant <= 1e-12 * (m[2, 2] + m[3, 3]) ** 2:  # all bearings alike: p and q stay open
        return pose
    i22, i33, i23 = m[3, 3] / determinant, m[2, 2] / determinant, -m[2, 3] / determinant
    k = np.empty((2, 2))
    for a in range(2):
        for b in range(2):
            k[a, b] = m[a, b] - (m[a, 2] * (i22 * m[2, b] + i23 * m[3, b]) + m[a, 3] * (i23 * m[2, b] + i33 * m[3, b]))
    theta = 0.5 * math.atan2(2.0 * k[0, 1], k[0, 0] - k[1, 1]) + 0.5 * math.pi  # the small axis of k
    c, s = math.cos(theta), math.sin(theta)
    h0, h1 = m[2, 0] * c + m[2, 1] * s, m[3, 0] * c + m[3, 1] * s
    p, q = -(i22 * h0 + i23 * h1), -(i23 * h0 + i33 * h1)
    pose[0], pose[1] = s * p + c * q + centre_x, s * q - c * p + centre_y
    ahead = 0.0
    for n in range(bearings.shape[0]):
        dx, dy = landmarks[n, 0] - pose[0], landmarks[n, 1] - pose[1]
        along = math.cos(bearings[n] + theta) * dx + math.sin(bearings[n] + theta) * dy
        ahead += weights[n] if along > 0.0 else -weights[n]
    if ahead < 0.0:
        theta += math.pi
    pose[2] = theta - 2.0 * math.pi * math.floor((theta + math.pi) / (2.0 * math.pi))
    return pose


@kernel
def hypotheses(landmarks: AnyArray, bearings: AnyArray, gate_rad: float, every: int) -> tuple[AnyArray, AnyArray]:
    """Return closed-form poses (T, 3), NaN where none is defined, and their `support`, (T,).

    The first is the pose of all bearings; the others are those of every `every`-th triple of them.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map [m].
    bearings : (N,) float64
        Directions in camera axes [rad].
    gate_rad : float
        Errors beyond it do not count [rad].
    every : int
        Which share of the triples is tried: one of so many.

    Returns
    -------
    ((T, 3), (T,) float64)
        Poses in the map [m, m, rad] and their support.
    """
    n = bearings.shape[0]
    n_poses = 1 + (n * (n - 1) * (n - 2) // 6 + every - 1) // every
    poses, supports = np.empty((n_poses, 3)), np.empty(n_poses)
    poses[0] = closed_form(landmarks, bearings, np.ones(n))
    supports[0] = support(landmarks, bearings, poses[0], gate_rad)
    weights, idx = np.ones(3), np.empty(3, np.intp)
    count, taken = 0, 1
    for i in range(n - 2):
        for j in range(i + 1, n - 1):
            for k in range(j + 1, n):
                count += 1
                if (count - 1) % every != 0:
                    continue
                idx[0], idx[1], idx[2] = i, j, k
                poses[taken] = closed_form(landmarks[idx], bearings[idx], weights)
                supports[taken] = support(landmarks, bearings, poses[taken], gate_rad)
                taken += 1
    return poses, supports


@kernel
def support(landmarks: AnyArray, bearings: AnyArray, pose: AnyArray, gate_rad: float) -> float:
    """Return how many landmarks agree with a pose, each the less the larger its error; -1 for no pose.

    Wrong matches that agree by chance fill the gate evenly and count two thirds, right ones nearly one.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map [m].
    bearings : (N,) float64
        Directions in camera axes [rad].
    pose : (3,) float64
        Camera in the map [m, m, rad].
    gate_rad : float
        Errors beyond it do not count [rad].

    Returns
    -------
    float
        Weighted number of landmarks.
    """
    if not np.isfinite(pose).all():
        return -1.0
    errors = bearing_errors(landmarks, bearings, pose)
    score = 0.0
    for n in range(errors.shape[0]):
        share = abs(errors[n]) / gate_rad
        if share <= 1.0:
            score += 1.0 - share * share
    return score


@kernel
def bearing_jacobian(landmarks: AnyArray, pose: AnyArray) -> AnyArray:
    """Return how the error of every bearing changes with the pose: minus the derivatives of Eq. (6), (N, 3)."""
    jacobian = np.ones((landmarks.shape[0], 3))
    for n in range(landmarks.shape[0]):
        dx, dy = landmarks[n, 0] - pose[0], landmarks[n, 1] - pose[1]
        squared = max(dx * dx + dy * dy, 1e-4)  # nearer than a centimetre a bearing means nothing
        jacobian[n, 0], jacobian[n, 1] = -dy / squared, dx / squared
    return jacobian


@kernel
def cost_and_step(
    landmarks: AnyArray,
    bearings: AnyArray,
    scales: AnyArray,
    pose: AnyArray,
    corner_rad: float,
    hessian: AnyArray,
    gradient: AnyArray,
) -> float:
    """Accumulate the Gauss-Newton equations of the bearings with Huber weights; return the robust cost [rad^2].

    Errors and their derivatives are multiplied by `scales`, see `bearing_scales`.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map [m].
    bearings : (N,) float64
        Directions in camera axes [rad].
    scales : (N,) float64
        See `bearing_scales`.
    pose : (3,) float64
        Camera in the map [m, m, rad].
    corner_rad : float
        Errors beyond it count linearly (Huber) [rad].
    hessian, gradient : (3, 3), (3,) float64
        Written in place.

    Returns
    -------
    float
        Sum of the Huber losses [rad^2].
    """
    hessian[:] = 0.0
    gradient[:] = 0.0
    errors = bearing_errors(landmarks, bearings, pose)
    jacobians = bearing_jacobian(landmarks, pose)
    cost = 0.0
    for n in range(bearings.shape[0]):
        scale, jacobian = scales[n], jacobians[n]
        size = abs(errors[n]) * scale
        weight = 1.0 if size <= corner_rad else corner_rad / size
        cost += size * size if size <= corner_rad else corner_rad * (2.0 * size - corner_rad)
        for a in range(3):
            gradient[a] += weight * scale * scale * jacobian[a] * errors[n]
            for b in range(3):
                hessian[a, b] += weight * scale * scale * jacobian[a] * jacobian[b]
    return cost


@kernel
def refine(
    landmarks: AnyArray, bearings: AnyArray, scales: AnyArray, start: AnyArray, corner_rad: float, iterations: int
) -> AnyArray:
    """Return the pose of least robust bearing error near the start (Levenberg-Marquardt).

    Undamped steps run away on a few badly placed triples; damped ones never end worse than they began.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map [m].
    bearings : (N,) float64
        Directions in camera axes [rad].
    scales : (N,) float64
        See `bearing_scales`.
    start : (3,) float64
        Pose to start from [m, m, rad].
    corner_rad : float
        Errors beyond it count linearly (Huber) [rad].
    iterations : int
        Steps at the most.

    Returns
    -------
    (3,) float64
        Camera in the map [m, m, rad].
    """
    pose = start.copy()
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    cost = cost_and_step(landmarks, bearings, scales, pose, corner_rad, hessian, gradient)
    damping = 1e-3
    for _ in range(iterations):
        damped = hessian.copy()
        for a in range(3):
            damped[a, a] += damping * (hessian[a, a] + 1e-9)
        trial = pose - np.linalg.solve(damped, gradient)
        trial_hessian, trial_gradient = np.empty((3, 3)), np.empty(3)
        trial_cost = cost_and_step(landmarks, bearings, scales, trial, corner_rad, trial_hessian, trial_gradient)
        if trial_cost < cost:
            converged = cost - trial_cost < 1e-12 + 1e-9 * cost
            pose, cost, hessian, gradient = trial, trial_cost, trial_hessian, trial_gradient
            damping *= 0.1
            if converged:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return pose
