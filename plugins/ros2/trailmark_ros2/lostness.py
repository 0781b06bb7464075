"""Whether the robot knows where it is, from what its localizers say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from trailmark.estimates import Belief, EstimateRecord, Fix, Lost, Motion, PathOffset

__all__ = ["Lostness"]


@dataclass(slots=True)
class _LastWord:
    """What a localizer tells, as far as it has told anything, and why it is lost; empty: it is not."""

    tells: Literal["places", "motion", "nothing yet"] = "nothing yet"
    lost: str = ""


class Lostness:
    """Remembers what every localizer said last.

    The robot is lost while nothing is believed, and while every localizer that tells places was lost when it last
    looked. Where none tells places, those that tell motion count. One that has said nothing else but that it is lost
    is taken for one that tells places.
    """

    def __init__(self) -> None:
        self._words: dict[str, _LastWord] = {}

    def note_estimate(self, record: EstimateRecord) -> None:
        """Take note of what a localizer said; a place that was not accepted changes nothing."""
        word = self._words.setdefault(record.source, _LastWord())
        match record.estimate:
            case Lost(reason=reason):
                word.lost = reason or "lost"
            case Motion():
                word.tells = "places" if word.tells == "places" else "motion"
                word.lost = "" if word.tells == "motion" else word.lost
            case Fix() | PathOffset():
                word.tells = "places"
                word.lost = "" if record.outcome.status == "accepted" else word.lost

    def reason(self, belief: Belief) -> str:
        """Return why the robot is lost; empty while it is not."""
        if belief.pose_map_base is None:
            return "no pose is known yet"
        places = {name: word for name, word in self._words.items() if word.tells != "motion"}
        judged = places or self._words
        if judged and all(word.lost for word in judged.values()):
            return "; ".join(f"{name}: {word.lost}" for name, word in sorted(judged.items()))
        return ""
