"""Motion that is not believed, on trial: a filter that believes it again, beside the one that does not.

Where no other motion is believed, absolute estimates alone can say whether who has lied is right again. From one of
them to the next, the motion either arrives where they say, or it does not. A trial begins at an absolute estimate and
begins anew at one that contradicts it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from trailmark.estimation.kalman.agreement import is_still, motion_since
from trailmark.estimation.kalman.bank import log_likelihood, log_odds_of_one
from trailmark.estimation.kalman.correction import Correction, innovation_of
from trailmark.estimation.kalman.diagnosis import FaultDiagnosis, Retrial
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import FilterState

__all__ = ["Trials", "acquitted"]

# A trial lasts so long at least: what goes wrong slowly shows after a while only [s].
_LASTS_S = 3.0
# How much more probable it must be that the motion is right.
_CONVINCING = math.log(50.0)
# Probability with which the measurements of a trial of right motion are as near to it as that; one that is restarted
# by chance is only a little longer.
_PASSES = 0.99
# The way that it tells must be so many times what the absolute estimates leave open, or a robot that stands proves it.
_TELLING = 5.0


class Trials:
    """Begins, predicts, measures and ends the trials of localizers whose motion is not believed.

    Parameters
    ----------
    prediction : Prediction
        Of one filter.
    correction : Correction
        Of one filter.
    """

    def __init__(self, prediction: Prediction, correction: Correction) -> None:
        self._prediction = prediction
        self._correction = correction

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return a state with its trials at a stamp that is not earlier."""
        trials = {
            source: trial._replace(state=self._prediction.predict(trial.state, stamp_s))
            for source, trial in state.diagnosis.trials.items()
        }
        return _with_trials(state, trials)

    def measure(self, before: FilterState, after: FilterState, measurement: Measurement) -> FilterState:
        """Return a state after a measurement, with what it says for and against the motion of the accused.

        Parameters
        ----------
        before, after : FilterState
            Without and with the measurement.
        measurement : Measurement
            An absolute estimate.
        """
        accused = before.diagnosis.faults
        if len(accused) < len(before.diagnosis.sums):
            return _with_trials(after, {})  # others are believed: `forgiveness` compares with them
        trials: dict[str, Retrial] = {}
        for source in accused:
            trial = before.diagnosis.trials.get(source)
            held = None if trial is None else self._hear(trial, before, measurement)
            if held is not None:
                trials[source] = held
            elif after.verdicts[-1].status == "accepted":
                trials[source] = _begin(after, source)
        return _with_trials(after, trials)

    def _hear(self, trial: Retrial, before: FilterState, measurement: Measurement) -> Retrial | None:
        """Return a trial after a measurement; None if the motion is wrong."""
        seen = innovation_of(trial.state, measurement)
        if seen is None:
            return None
        nis, dof = trial.nis + seen.nis, trial.dof + len(measurement.root)
        state = replace(trial.state, verdicts=())
        corrected = self._correction.correct(state, measurement, seen)
        if corrected.verdicts[-1].status != "accepted" or nis > threshold(_PASSES, dof):
            return None
        said = log_likelihood(seen) - log_likelihood(innovation_of(before, measurement))
        return trial._replace(state=corrected, nis=nis, dof=dof, log_odds=trial.log_odds + log_odds_of_one(said))


def acquitted(state: FilterState) -> list[str]:
    """Return the localizers whose trials have shown that they are right again."""
    return [source for source, trial in state.diagnosis.trials.items() if _has_convinced(state, source, trial)]


def _has_convinced(state: FilterState, source: str, trial: Retrial) -> bool:
    if state.stamp_s - trial.begun.stamp_s < _LASTS_S or trial.log_odds < _CONVINCING:
        return False
    motion, gaussian = motion_since(trial.state, trial.begun, source), trial.state.gaussian
    if motion is None or gaussian is None or is_still(motion):
        return False
    variances = gaussian.covariance.diagonal()
    sigma_m, sigma_rad = math.sqrt(max(variances[0], variances[1])), math.sqrt(variances[2])
    return math.hypot(motion.x, motion.y) > _TELLING * sigma_m or abs(motion.turn) > _TELLING * sigma_rad


def _begin(state: FilterState, source: str) -> Retrial:
    """Return a trial that begins where the belief without the motion is."""
    faults = {other: fault for other, fault in state.diagnosis.faults.items() if other != source}
    sums = state.diagnosis.sums
    begun = replace(state, diagnosis=FaultDiagnosis(sums=sums, faults=faults), verdicts=())
    return Retrial(begun, begun)


def _with_trials(state: FilterState, trials: Mapping[str, Retrial]) -> FilterState:
    if not trials and not state.diagnosis.trials:
        return state
    return replace(state, diagnosis=state.diagnosis._replace(trials=trials))
