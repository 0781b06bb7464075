"""What a localizer may say at a frame: nothing of the future, nothing twice, and no place while it is lost."""

from __future__ import annotations

from trailmark.estimates import Lost
from trailmark.testing.checks.lives import LocalizerCase, document_of, true_belief
from trailmark.testing.checks.parametrize import Check
from trailmark.testing.memory_map import MemoryMap

__all__ = ["freshness_checks"]

# Stamps that went through decimals differ by this from the frame's.
_SLACK_S = 1e-6


def freshness_checks(case: LocalizerCase) -> dict[str, Check]:
    """Return the check by name; it is one check, because a localizer's life costs seconds."""
    return {"answers_are_new": lambda: _are_new(case)}


def _are_new(case: LocalizerCase) -> None:
    """Check that an estimate is of a past instant, comes once, and is not of an instant at which it was `Lost`."""
    localizer = case.make()
    localizer.start(case.session("teach", MemoryMap()))
    told: set[str] = set()
    for frame in case.frames_asked_for():
        said = list(localizer.observe(frame, true_belief(case.run, frame.stamp_s)))
        at = f"at the frame of {frame.stamp_s} s"
        for one in said:
            assert one.stamp_s <= frame.stamp_s + _SLACK_S, f"{at} it told of {one.stamp_s} s: nobody has seen that yet"
        answers = [one for one in said if not isinstance(one, Lost)]
        new = {str(document_of(one)) for one in answers}
        assert not told & new, f"{at} it told again, so that it counts twice: {min(told & new)}"
        told |= new
        both = {one.stamp_s for one in said if isinstance(one, Lost)} & {one.stamp_s for one in answers}
        assert not both, f"{at} it was lost, and told of {min(both)} s all the same"
    localizer.close()
