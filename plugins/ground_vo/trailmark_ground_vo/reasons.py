"""Why the tracker over the ground is lost, in words for the user."""

from __future__ import annotations

import math

from trailmark_ground_vo.motion import ImageMotion

__all__ = ["COVERED", "ENCODED_AGAIN", "FROZEN", "NO_TEXTURE", "REPEATED", "differences", "held", "otherwise"]

NO_TEXTURE = "no texture that moves so is seen in both pictures (lens covered, over-exposed, dark, or blank ground)"
FROZEN = "the same picture again, bit by bit, while others move (camera or driver frozen)"
COVERED = "something moves beneath what stands still (film, sticker or mesh on the lens, scratched glass, passers-by)"
ENCODED_AGAIN = "the same picture again, encoded anew, though the robot was moving (repeated frame?)"
REPEATED = "the same picture again, bit by bit, and nobody else tells whether the robot stands or the camera froze"


def held(seen: str) -> str:
    """Return that content that had moved is not known to stand."""
    return (
        f"the content stands still, though it moved and was lost or doubted since: {seen}"
        " (dirt on the lens holds the match, or the robot stopped at once?)"
    )


def otherwise(seen: str, rival: ImageMotion | None, *, has_grain: bool) -> str:
    """Return that most of the picture does not move as was found, but as a rival does, where there is one."""
    along, cause = "", "dirt on the lens, reflections?"
    if has_grain:
        along, cause = " along its grain", "streaks that look alike, something that passes?"
    but = "" if rival is None else f", but by {rival.u:.0f}, {rival.v:.0f} px{along}"
    return f"most of the picture does not move as its marks do{but}: {seen} ({cause})"


def differences(spread: float, noise: float) -> str:
    """Return what a motion leaves, for a message."""
    if spread == math.inf:
        return f"marks lie on all that both pictures show with noise of {noise:.1f}"
    return f"differences of {spread:.1f} grey levels with noise of {noise:.1f}"
