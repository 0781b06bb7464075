"""How much of what a localizer says of its own certainty is believed, and what is refused.

========================================  =======================================================================
information                               rule
========================================  =======================================================================
NaN or infinite                           refused
negative in a direction, not symmetric    refused (rounding is forgiven)
zero in a direction                       normal: that direction is not measured
zero altogether                           refused: it says nothing
more certain than `floor_m`, `floor_deg`  repaired: reduced to the floor in that direction
========================================  =======================================================================

A config's `sigmas` replace the information whatever it is; `sigma_scale` divides it first of all. Neither does so to a
motion that was not measured (`Motion.is_guess`).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Motion, PathOffset
from trailmark.estimation.information import checked_information
from trailmark.estimation.kalman_config import KalmanConfig, Loss
from trailmark.estimation.symmetric import NOTHING, Sym3, diagonal, scaled, to_matrix

__all__ = ["Trust", "root_of"]

# Relative to the diagonal: below this a pivot or an eigenvalue is rounding, not a measurement.
_UNMEASURED = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """How the estimates of one localizer are taken.

    Attributes
    ----------
    gate : float or None
        Probability with which a right estimate passes; None: no test.
    loss : {"none", "huber", "cauchy"}
        How weight is lost with distance.
    timeout_s : float
        Silence that is worth a word [s].
    sigma_scale : float
        Factor on stated standard deviations.
    floors : (float, float)
        Smallest standard deviations believed, of position and heading [m, rad].
    override : Sym3 or None
        Information in place of what is stated.
    correlation_s : float or None
        Time in which the errors of its absolute poses last, in place of what it says [s].
    """

    gate: float | None
    loss: Loss
    timeout_s: float
    sigma_scale: float
    floors: tuple[float, float]
    override: Sym3 | None
    correlation_s: float | None = None

    @classmethod
    def of(cls, config: KalmanConfig, source: str) -> Trust:
        """Return what a config says of a localizer."""
        own = config.sources.get(source)
        gate = config.gate if own is None or own.gate is None else own.gate
        floor_m = own.floor_m if own and own.floor_m else config.floor_m
        floor_deg = own.floor_deg if own and own.floor_deg else config.floor_deg
        return cls(
            None if gate == "off" else gate,
            own.loss if own and own.loss else config.loss,
            own.timeout_s if own and own.timeout_s else config.timeout_s,
            own.sigma_scale if own else 1.0,
            (floor_m, math.radians(floor_deg)),
            _information_of_sigmas(own.sigmas) if own and own.sigmas else None,
            own.correlation_s if own else None,
        )

    def floored_information(self, estimate: Motion | Fix | PathOffset, counted: Counter[str]) -> Sym3 | str:
        """Return the information that is believed, or why the estimate is refused; `counted` takes what was done."""
        is_guess = isinstance(estimate, Motion) and estimate.is_guess
        override = None if is_guess else self.override
        checked = override or checked_information(estimate.information)
        if isinstance(checked, str):
            counted["refused_information"] += 1
            return checked
        if self.sigma_scale != 1.0 and not is_guess:
            checked = scaled(checked, 1.0 / (self.sigma_scale * self.sigma_scale))
        xx, _, _, yy, _, tt = checked
        if not (xx > NOTHING or yy > NOTHING or tt > NOTHING):
            counted["refused_no_information"] += 1
            return "it has no information"
        floor_m, floor_rad = self.floors
        if (xx + yy) * (floor_m * floor_m) + tt * (floor_rad * floor_rad) > 1.0:
            checked, is_repaired = _reduce_to_floors(checked, np.array([floor_m, floor_m, floor_rad]))
            counted["repaired_too_certain"] += is_repaired
        return checked


def root_of(information: Sym3) -> Floats:
    """Return ``A`` with ``A^T A`` the information: one row for each direction that was measured, (k, 3).

    With ``A z`` as the measurement its noise is the identity, whatever was measured, and a direction without
    information costs nothing and hurts nothing.
    """
    xx, xy, xt, yy, yt, tt = information
    if xy == xt == yt == 0.0:
        rows = [(math.sqrt(value), i) for i, value in enumerate((xx, yy, tt)) if value > NOTHING]
        root = np.zeros((len(rows), 3))
        for k, (value, i) in enumerate(rows):
            root[k, i] = value
        return root
    if xx > NOTHING:  # L D L^T, in plain floats
        l21, l31 = xy / xx, xt / xx
        d2, rest, d3 = yy - l21 * xy, yt - l31 * xy, tt - l31 * xt
        if d2 > _UNMEASURED * yy:
            l32 = rest / d2
            d3 -= l32 * rest
            if d3 > _UNMEASURED * tt:
                r1, r2, r3 = math.sqrt(xx), math.sqrt(d2), math.sqrt(d3)
                return np.array([[r1, r1 * l21, r1 * l31], [0.0, r2, r2 * l32], [0.0, 0.0, r3]])
    return _root_of_singular(information)


def _root_of_singular(information: Sym3) -> Floats:
    roots = np.sqrt([information[0], information[3], information[5]])
    inverse = np.divide(1.0, roots, out=np.zeros(3), where=roots > math.sqrt(NOTHING))
    values, vectors = np.linalg.eigh(inverse[:, None] * to_matrix(information) * inverse)
    is_measured = values > _UNMEASURED
    return np.asarray((vectors[:, is_measured] * np.sqrt(values[is_measured])).T * roots)


def _reduce_to_floors(information: Sym3, floors: Floats) -> tuple[Sym3, bool]:
    values, vectors = np.linalg.eigh(floors[:, None] * to_matrix(information) * floors)
    if values[-1] <= 1.0:
        return information, False
    reduced = (vectors * np.clip(values, 0.0, 1.0)) @ vectors.T / np.outer(floors, floors)
    xx, xy, xt, _, yy, yt, _, _, tt = reduced.ravel().tolist()
    return (xx, xy, xt, yy, yt, tt), True


def _information_of_sigmas(sigmas: tuple[float | None, float | None, float | None]) -> Sym3:
    x, y, turn_deg = (math.inf if sigma is None else sigma for sigma in sigmas)
    return diagonal(x**-2, y**-2, math.radians(turn_deg) ** -2)
