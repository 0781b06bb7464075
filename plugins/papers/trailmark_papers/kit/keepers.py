"""What is kept of a run while it goes on, as a pipeline's ``on_step``: pictures, and what localizers say."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from trailmark.estimates import PathOffset

if TYPE_CHECKING:
    from trailmark.pipeline import Pipeline, Step

__all__ = ["AnswerKeeper", "FrameKeeper"]

T = TypeVar("T")


class FrameKeeper(Generic[T]):
    """Keeps a value of every frame of one kind.

    Parameters
    ----------
    kind : type
        Of the payload.
    value_of : callable
        What is kept of a payload.
    """

    def __init__(self, kind: type, value_of: Callable[[Any], T]) -> None:
        self._kind = kind
        self._value_of = value_of
        self.stamps_s: list[float] = []
        self.values: list[T] = []

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Keep the frame of a step, if it is of the kind."""
        if step.frame is not None and isinstance(step.frame.payload, self._kind):
            self.stamps_s.append(step.frame.stamp_s)
            self.values.append(self._value_of(step.frame.payload))


class AnswerKeeper:
    """Keeps who said when where on the path the robot is; None for every other answer, such as `Lost`."""

    def __init__(self, names: Collection[str]) -> None:
        self._names = names
        self.answers: list[tuple[str, float, PathOffset | None]] = []

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Keep the answers of a step."""
        for one in step.estimates:
            if one.source in self._names:
                offset = one.estimate if isinstance(one.estimate, PathOffset) else None
                self.answers.append((one.source, one.estimate.stamp_s, offset))
