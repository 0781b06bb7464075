"""Errors that last, in motions that an estimator takes for independent."""

from __future__ import annotations

__all__ = ["motions_in_stretch"]

_MOST_MOTIONS = 100.0  # in a metre: who creeps is not made ever less sure


def motions_in_stretch(way_m: float, dt_s: float) -> float:
    """Return by how much to raise the variance of a systematic error, so that a second and a metre of it are honest.

    An estimator that adds up n motions takes their errors for independent and gets sqrt(n) times one of them; a
    systematic error is n times as large. So the sigma of one has to be sqrt(n) times its own, n being the motions in a
    second or in a metre, whichever is more.

    Parameters
    ----------
    way_m : float
        Length of the motion [m].
    dt_s : float
        Its duration [s].

    Returns
    -------
    float
        n, at least 1.
    """
    return max(1.0, 1.0 / max(dt_s, 1e-3), min(1.0 / max(way_m, 1e-3), _MOST_MOTIONS))
