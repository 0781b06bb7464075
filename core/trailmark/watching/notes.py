"""What a run that is watched leaves beside its folder while it goes on: belief, truth, surroundings, pictures."""

from __future__ import annotations

import json
import logging
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from trailmark.arrays import Grey8
from trailmark.estimates import Belief
from trailmark.evaluation.belief_table import BELIEFS_FILE, OUTLINES_FILE
from trailmark.evaluation.path_file import PATH_FILE, write_path
from trailmark.failures import is_from_user, words_of
from trailmark.frames import Frame
from trailmark.frames.outlines import Outlines
from trailmark.geometry.tum import tum_text
from trailmark.pipeline.outputs.beliefs import beliefs_text
from trailmark.pipeline.outputs.recorder import outlines_document
from trailmark.pipeline.sources.stream import outlines_of
from trailmark.report.glimpses import FOLDER, jpeg_of, small_picture
from trailmark.watching.thinning import Thinned, every_nth
from trailmark.writing import write_whole

if TYPE_CHECKING:
    from trailmark.geometry import Trajectory
    from trailmark.pipeline import Pipeline, Step

__all__ = ["TRUTH_FILE", "LiveNotes"]

logger = logging.getLogger(__name__)

TRUTH_FILE = "groundtruth.tum"

#: Beliefs, and pictures, between two writings; more are let go: a run in a hurry does not write more, and does not keep
#: more while a disk hangs.
_MAX_WAITING = 200
_WRITE_EVERY_S = 0.5
_PICTURE_EVERY_S = 1.0
#: A source may need so much of the run's time to say the truth so far.
_TRUTH_SHARE = 0.01
_MAX_BELIEFS, _MAX_TRUTH, _MAX_PICTURES = 600, 1000, 40


class LiveNotes:
    """Notes what a page shows of a run that goes on; pass it as ``on_step`` to `trailmark.run`.

    In the run's loop it remembers what came; a thread of its own writes, twice a second. What is written is thinned, so
    that it stays small however long the run is. What cannot be written is a warning, once.

    Parameters
    ----------
    folder : Path
        Is there, and is not the run's folder, which holds no more than that of any other run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._beliefs: list[Belief] = []
        self._pictures: list[tuple[str, float, Grey8]] = []
        self._truth: Trajectory | None = None
        self._around: Callable[[], None] | None = None
        self._kept = Thinned[Belief](_MAX_BELIEFS)
        self._cameras: dict[str, Thinned[str]] = {}
        self._pictured_s: dict[str, float] = {}
        self._began_s: float | None = None
        self._truth_at_s = 0.0
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._write_again_and_again, name="live notes", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._is_over.set()  # it is not waited for: a disk that hangs does not hold up the end of a run

    # --- in the run's loop -----------------------------------------------------------------------------------------

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Take note of a step; of none once the thread that writes has given up."""
        if self._is_over.is_set():
            return
        if self._began_s is None:
            self._began_s = step.stamp_s
            self._look_around(pipeline)
        if len(self._beliefs) < _MAX_WAITING:
            self._beliefs.append(step.belief)
        if step.frame is not None:
            self._take_picture(step.frame)
        if time.monotonic() >= self._truth_at_s:
            self._ask_for_truth(pipeline)

    def _look_around(self, pipeline: Pipeline) -> None:
        """Take the path and the outlines once: they stay as they are."""
        path, outlines = pipeline.path, outlines_of(pipeline.parts.sources)

        def write() -> None:
            if path is not None:
                write_path(path, self._folder / PATH_FILE)
            document = outlines_document(outlines or Outlines(()))  # is there in any case: who reads waits for it
            write_whole(self._folder / OUTLINES_FILE, json.dumps(document))

        self._around = write

    def _take_picture(self, frame: Frame) -> None:
        now_s = time.monotonic()
        if len(self._pictures) >= _MAX_WAITING:
            return
        if now_s - self._pictured_s.get(frame.sensor, -_PICTURE_EVERY_S) < _PICTURE_EVERY_S:
            return
        pixels = frame.payload.picture
        if pixels is None or self._began_s is None:
            return
        self._pictured_s[frame.sensor] = now_s
        self._pictures.append((frame.sensor, frame.stamp_s - self._began_s, small_picture(pixels)))

    def _ask_for_truth(self, pipeline: Pipeline) -> None:
        """Ask the sources for the truth so far; the longer they take, the more seldom."""
        began_s = time.monotonic()
        try:
            known = (source.ground_truth() for source in pipeline.parts.sources)
            self._truth = next((truth for truth in known if truth is not None), None)
        except BaseException as error:
            if is_from_user(error):
                raise
            logger.debug("no ground truth while the run goes on: %s", words_of(error))
            self._truth_at_s = math.inf  # it is asked again, and told, when the run ends
            return
        ended_s = time.monotonic()
        self._truth_at_s = ended_s + max(2 * _WRITE_EVERY_S, (ended_s - began_s) / _TRUTH_SHARE)

    # --- in the thread ---------------------------------------------------------------------------------------------

    def _write_again_and_again(self) -> None:
        while not self._is_over.wait(_WRITE_EVERY_S):
            try:
                self.write()
            except Exception as error:
                why = error.strerror or error if isinstance(error, OSError) else words_of(error)
                logger.warning("the page of this run stands still: %s", why)
                self._is_over.set()
                self._beliefs, self._pictures = [], []

    def write(self) -> None:
        """Write what is new.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        around, self._around = self._around, None
        if around is not None:
            around()
        beliefs, self._beliefs = self._beliefs, []
        for belief in beliefs:
            if belief.pose_map_base is not None and belief.covariance is not None:
                self._kept.add(belief)
        if beliefs and self._kept.kept:
            write_whole(self._folder / BELIEFS_FILE, beliefs_text(self._kept.kept))
        truth, self._truth = self._truth, None
        if truth is not None and len(truth):
            write_whole(self._folder / TRUTH_FILE, tum_text(every_nth(truth, _MAX_TRUTH)))
        pictures, self._pictures = self._pictures, []
        for sensor, time_s, pixels in pictures:
            self._write_picture(sensor, time_s, pixels)

    def _write_picture(self, sensor: str, time_s: float, pixels: Any) -> None:
        folder = self._folder / FOLDER
        folder.mkdir(exist_ok=True)
        name = f"{sensor}_{time_s:.2f}s.jpg"
        write_whole(folder / name, jpeg_of(pixels))
        for gone in self._cameras.setdefault(sensor, Thinned(_MAX_PICTURES)).add(name):
            (folder / gone).unlink(missing_ok=True)
