"""Weights of absolute estimates that do not fit, and the cost that belongs to them.

Dynamic covariance scaling (Agarwal et al., "Robust map optimization using dynamic covariance scaling", ICRA 2013) lets
go of what is far off; Huber's loss lets it pull with a bounded force.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.smoother_config import RobustLoss

__all__ = ["bounded_chi_squares", "weights_of"]


def weights_of(loss: RobustLoss, chi_squares: Floats, limits: Floats) -> Floats:
    """Return the weights of estimates, (M,): 1 up to their limit.

    Parameters
    ----------
    loss : {"dcs", "huber", "none"}
        How weight is lost beyond it.
    chi_squares, limits : (M,) float64
        How far each is off, and where its loss begins; ``inf``: nowhere.
    """
    if loss == "none":
        return np.ones(len(chi_squares))
    beyond = np.isfinite(limits) & (chi_squares > limits)
    scale, far = limits[beyond], chi_squares[beyond]
    weights = np.ones(len(chi_squares))
    weights[beyond] = np.sqrt(scale / far) if loss == "huber" else (2.0 * scale / (scale + far)) ** 2
    return weights


def bounded_chi_squares(loss: RobustLoss, chi_squares: Floats, limits: Floats) -> Floats:
    """Return what is least where estimates have the weights of `weights_of`, (M,)."""
    bounded = chi_squares.copy()
    if loss == "none":
        return bounded
    beyond = np.isfinite(limits) & (chi_squares > limits)
    scale, far = limits[beyond], chi_squares[beyond]
    if loss == "huber":
        bounded[beyond] = 2.0 * np.sqrt(scale * far) - scale
    else:
        bounded[beyond] = scale * (3.0 * far - scale) / (scale + far)
    return bounded
