"""Colours and type of the plots and the page; one place, so that a localizer has one colour everywhere.

The colours of lines are those of Okabe and Ito, which stay apart for colour-blind readers. Inside the page
each is a CSS variable, so that the same drawing serves light and dark screens; the files in ``plots/`` keep
the light ones.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING, Any

from trailmark.evaluation import FUSED, GROUND_TRUTH
from trailmark.interruption import TELL_S, shielded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "GREEN",
    "INK",
    "MUTED",
    "OUTCOME_COLOURS",
    "PAPER",
    "RED",
    "RULE",
    "TRUTH",
    "WIDTH_INCH",
    "LineStyle",
    "css_variable",
    "css_variables",
    "embed_svg",
    "line_styles",
    "plotting",
    "svg_of",
]

#: Width of a drawing in inches of 72 px: a column of the page, where its text has the size of the page's small text.
WIDTH_INCH = 6.4

INK, MUTED, RULE, PAPER = "#1c1f23", "#626a73", "#dcdfe3", "#fefefe"
TRUTH = "#a3abb5"
BLUE, RED, GREEN = "#0072b2", "#d55e00", "#009e73"
_SERIES = (BLUE, RED, GREEN, "#b4508f", "#c98a00", "#3a9bd9")
_DASHES = ("solid", (0, (5, 1.5)), (0, (1.5, 1.2)))

#: What became of an estimate: the usual is quiet, the rest is not.
OUTCOME_COLOURS: Mapping[str, str] = {
    "accepted": "#9fc1d6",
    "gated": "#e69f01",
    "late": "#a55194",
    "refused": "#d1495b",
    "lost": "#30353c",
    "unused": "#e3e6ea",
}

_DARK = {
    INK: "#e8eaed",
    MUTED: "#9aa3ad",
    RULE: "#363b42",
    PAPER: "#16181b",
    TRUTH: "#757d87",
    BLUE: "#5bb0e8",
    RED: "#ff8d4f",
    GREEN: "#3ecaa0",
    "#b4508f": "#e49ac6",
    "#c98a00": "#f0bd4a",
    "#3a9bd9": "#a3d8ff",
    "#9fc1d6": "#3f6d8a",
    "#e69f01": "#f2b134",
    "#a55194": "#d987c8",
    "#d1495b": "#f0727f",
    "#30353c": "#f4f5f6",
    "#e3e6ea": "#2c3137",
}

#: From small to large errors, after viridis, which stays in order for colour-blind readers.
_HEAT = ("#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
_HEAT_DARK = "".join(f"--heat-{5 - level}:{colour};" for level, colour in enumerate(reversed(_HEAT)))
_HEAT_LIGHT = "".join(
    f"--heat-{level}:{colour};"
    for level, colour in enumerate(("#3b528b", "#21918c", "#5ec962", "#e6c229", "#f17105", "#d11149"))
)

_FONTS = "system-ui, -apple-system, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif"
_SETTINGS = {
    "svg.fonttype": "none",
    "text.parse_math": False,  # names are names
    "path.simplify_threshold": 0.25,
    "font.family": "DejaVu Sans",  # comes with matplotlib, and is wider than what readers have: nothing overlaps
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 8,
    "axes.titlecolor": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": RULE,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.facecolor": PAPER,
    "figure.facecolor": PAPER,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": RULE,
    "ytick.color": RULE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.minor.visible": False,
    "text.color": INK,
    "legend.frameon": False,
    "legend.borderpad": 0.0,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.4,
    "lines.solid_capstyle": "round",
}


@dataclass(frozen=True, slots=True)
class LineStyle:
    """How one trajectory is drawn everywhere.

    Attributes
    ----------
    colour : str
        As matplotlib and SVG read it.
    width : float
        Of the line [pt].
    dashes : str or (float, tuple of float)
        ``"solid"``, or offset and lengths as matplotlib takes them.
    order : int
        What has a larger one is drawn above.
    """

    colour: str
    width: float
    dashes: str | tuple[float, tuple[float, ...]] = "solid"
    order: int = 3


def line_styles(names: Iterable[str]) -> dict[str, LineStyle]:
    """Return the style of each trajectory: truth broad and grey, fused dark, localizers in colours."""
    styles = {GROUND_TRUTH: LineStyle(TRUTH, 4.0, order=2), FUSED: LineStyle(INK, 1.5, order=5)}
    for index, name in enumerate(name for name in names if name not in styles):
        dashes = _DASHES[index // len(_SERIES) % len(_DASHES)]
        styles[name] = LineStyle(_SERIES[index % len(_SERIES)], 1.3, dashes)
    return styles


@contextmanager
def plotting(name: str) -> Iterator[None]:
    """Draw with our settings; ids inside the drawing depend on its name and content alone."""
    with shielded(TELL_S):  # an extension whose import is cut off takes the whole process with it
        import matplotlib as mpl
        import matplotlib.backends.backend_svg
        import matplotlib.figure

    settings: dict[Any, Any] = {**_SETTINGS, "svg.hashsalt": name}
    with mpl.rc_context():
        mpl.rcdefaults()  # the reader's own matplotlibrc changes nothing
        mpl.rcParams.update(settings)
        yield


def svg_of(figure: Figure) -> str:
    """Return the drawing as SVG: text stays text, no date, the same bytes each time."""
    buffer = StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = buffer.getvalue()
    svg = re.sub(r' id="(?:figure|axes|patch|line2d|text|matplotlib\.axis|xtick|ytick|legend)[^"]*"', "", svg)
    svg = re.sub(r' (?:d|x|y|transform)="[^"]*"', _to_hundredths, svg)
    return svg.replace("'DejaVu Sans'", _FONTS)


def _to_hundredths(attribute: re.Match[str]) -> str:
    """Return coordinates with two decimals, a hundredth of a pixel; only these: labels are numbers too."""
    return re.sub(r"(\d\.\d\d)\d+", r"\1", attribute[0])


def embed_svg(svg: str, label: str) -> str:
    """Return a drawing for use inside the page: colours are variables, the size is that of its place.

    Parameters
    ----------
    svg : str
        What `svg_of` gave.
    label : str
        What it shows, for those who cannot see it; escaped by the caller.
    """
    body = svg[svg.index("<svg") :]
    body = re.sub(r' width="[^"]*" height="[^"]*"', "", body, count=1)
    body = re.sub(
        r"<defs>\s*<style.*?</style>\s*</defs>", "", body, count=1, flags=re.DOTALL
    )  # it would style the page
    body = body.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)
    for colour, variable in _variables().items():
        body = body.replace(colour, f"var({variable})")
    return body


def css_variables() -> str:
    """Return the rules that define the colours for light screens and paper, and for dark screens."""
    light = "".join(f"{variable}:{colour};" for colour, variable in _variables().items())
    dark = "".join(f"{variable}:{_DARK[colour]};" for colour, variable in _variables().items())
    light += _HEAT_LIGHT + "--blind:#e69f0130;"
    dark += _HEAT_DARK + "--blind:#f2b13438;"
    return f":root{{{light}}}\n@media screen and (prefers-color-scheme: dark){{:root{{{dark}}}}}\n"


def css_variable(colour: str) -> str:
    """Return the name of the CSS variable of one of our colours."""
    return _variables()[colour]


def _variables() -> dict[str, str]:
    named = {INK: "--ink", MUTED: "--muted", RULE: "--rule", PAPER: "--paper", TRUTH: "--truth"}
    named.update({colour: f"--series-{index}" for index, colour in enumerate(_SERIES)})
    named.update({colour: f"--{outcome}" for outcome, colour in OUTCOME_COLOURS.items()})
    return named
