"""Fuzzy rules that choose finders and resolution, and those who fire them.

Zero-order Sugeno: a rule's strength is the least of its conditions, the answer the mean of the conclusions weighted
by strength. Three inputs and a page of rules need no library; the one that exists for Python pulls in networkx.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["RULES", "Fuzzy", "Membership", "Rule", "SearchPlan", "infer"]


@dataclass(frozen=True, slots=True)
class Membership:
    """A trapezium: 0 up to `a`, 1 from `b` to `c`, 0 from `d`.

    Attributes
    ----------
    a, b, c, d : float
        Corners, in increasing order and in the unit of the input.
    """

    a: float
    b: float
    c: float
    d: float

    def of(self, value: float) -> float:
        """Return how far a value belongs to it, 0 to 1."""
        if self.b <= value <= self.c:
            return 1.0
        if value <= self.a or value >= self.d:
            return 0.0
        return (value - self.a) / (self.b - self.a) if value < self.b else (self.d - value) / (self.d - self.c)


_INF = float("inf")

#: light: share of the reference light. landmarks: seen now, as a share of those wanted. time: of the time allowed.
TERMS: Mapping[str, Mapping[str, Membership]] = {
    "light": {
        "dark": Membership(-_INF, -_INF, 0.15, 0.4),
        "bright": Membership(0.15, 0.4, _INF, _INF),
    },
    "landmarks": {
        "few": Membership(-_INF, -_INF, 0.3, 0.6),
        "enough": Membership(0.3, 0.6, 1.0, 1.5),
        "many": Membership(1.0, 1.5, _INF, _INF),
    },
    "time": {
        "short": Membership(-_INF, -_INF, 0.6, 0.9),
        "fair": Membership(0.6, 0.9, 1.0, 1.2),
        "long": Membership(1.0, 1.2, _INF, _INF),
    },
}


@dataclass(frozen=True, slots=True)
class Rule:
    """If all conditions hold, then an output is so much.

    Attributes
    ----------
    when : tuple of (input, term)
        Conditions, joined by "and".
    output : {"effort", "resolution", "colour"}
        How many finders to run, at how fine a picture, and whether to rely on colour; each 0 to 1.
    value : float
        The conclusion.
    """

    when: tuple[tuple[str, str], ...]
    output: str
    value: float

    def __str__(self) -> str:
        conditions = " and ".join(f"{name} is {term}" for name, term in self.when)
        return f"if {conditions} then {self.output} is {self.value:g}"


RULES: tuple[Rule, ...] = (
    Rule((("landmarks", "few"),), "effort", 1.0),
    Rule((("landmarks", "enough"), ("time", "short")), "effort", 1.0),
    Rule((("landmarks", "enough"), ("time", "fair")), "effort", 0.75),
    Rule((("landmarks", "enough"), ("time", "long")), "effort", 0.4),
    Rule((("landmarks", "many"), ("time", "short")), "effort", 0.75),
    Rule((("landmarks", "many"), ("time", "fair")), "effort", 0.5),
    Rule((("landmarks", "many"), ("time", "long")), "effort", 0.25),
    Rule((("time", "short"),), "resolution", 1.0),
    Rule((("time", "fair"),), "resolution", 0.9),
    Rule((("time", "long"), ("landmarks", "few")), "resolution", 0.6),  # the paper: slow, so reduce the picture
    Rule((("time", "long"), ("landmarks", "enough")), "resolution", 0.4),
    Rule((("time", "long"), ("landmarks", "many")), "resolution", 0.2),
    Rule((("light", "bright"),), "colour", 1.0),
    Rule((("light", "dark"),), "colour", 0.0),
)


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """What to do with the next picture.

    Attributes
    ----------
    finders : tuple of str
        Those to run, in order.
    scale : {1.0, 0.5}
        Working resolution of the finders.
    by_colour : bool
        Whether histograms may tell landmarks apart; in the dark colours are noise.
    """

    finders: tuple[str, ...]
    scale: float
    by_colour: bool


class Fuzzy:
    """The controller: a plan from light, number of landmarks and processing time.

    Parameters
    ----------
    finders : tuple of str
        All that may run, the most useful first.
    rules : tuple of Rule
        What to conclude.
    """

    def __init__(self, finders: tuple[str, ...], rules: tuple[Rule, ...] = RULES) -> None:
        self._finders, self._rules = finders, rules
        self._scale = 1.0

    def plan(self, light: float, landmarks: float, time: float) -> SearchPlan:
        """Return the plan; inputs as in `TERMS`. Resolution changes with a hysteresis, so that it does not flutter."""
        outputs = infer(self._rules, {"light": light, "landmarks": landmarks, "time": time})
        n = max(1, round(outputs["effort"] * len(self._finders)))
        by_colour = outputs["colour"] >= 0.5
        ordered = self._finders if by_colour else tuple(sorted(self._finders, key=lambda name: name == "blobs"))
        if outputs["resolution"] < 0.5:
            self._scale = 0.5
        elif outputs["resolution"] > 0.75:
            self._scale = 1.0
        kept = set(ordered[:n])
        return SearchPlan(tuple(name for name in self._finders if name in kept), self._scale, by_colour)


def infer(rules: tuple[Rule, ...], inputs: Mapping[str, float]) -> dict[str, float]:
    """Return the outputs of the rules: conclusions weighted by how far their conditions hold."""
    sums: dict[str, list[float]] = {}
    for rule in rules:
        strength = min(TERMS[name][term].of(inputs[name]) for name, term in rule.when)
        weighted = sums.setdefault(rule.output, [0.0, 0.0])
        weighted[0] += strength * rule.value
        weighted[1] += strength
    return {name: total / weight for name, (total, weight) in sums.items() if weight > 0.0}
