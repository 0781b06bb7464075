"""Localizers at work, and the estimator that takes what they say.

A localizer is waited for, works beside the run on the virtual clock, or has a thread of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

from trailmark.frames import SensorInfo
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.localizers.runner import LocalizerFailedError, LocalizerRunner, ObserveResult, SyncRunner
from trailmark.pipeline.parts import LocalizerPart

__all__ = ["LocalizerFailedError", "LocalizerRunner", "ObserveResult", "new_runner"]


def new_runner(
    part: LocalizerPart, sensors: Mapping[str, SensorInfo], is_realtime: bool, instruments: Instruments
) -> LocalizerRunner:
    """Return what runs a localizer: waited for, or beside the run if its options say ``async`` or ``delay_ms``.

    Parameters
    ----------
    part : LocalizerPart
        The localizer.
    sensors : mapping of str to SensorInfo
        The sensors of the run.
    is_realtime : bool
        Whether what runs beside the run has a thread, or a modelled latency.
    instruments : Instruments
        Of the run.
    """
    times = instruments.times.stage(f"localizer.{part.name}")
    if not part.options.answers_later or (is_realtime and not part.options.is_async):
        return SyncRunner(part, sensors, times, is_realtime)
    if is_realtime:
        from trailmark.pipeline.localizers.threaded import ThreadedRunner

        return ThreadedRunner(part, sensors, times, instruments)
    from trailmark.pipeline.localizers.modelled import ModelledRunner

    return ModelledRunner(part, sensors, times, instruments.counters)
