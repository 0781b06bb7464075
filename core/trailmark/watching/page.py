"""The page: the report's map and time axis, a table of the localizers, and buttons where there is a use for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files

from trailmark.report.html import page_html, script_hash, text_html

__all__ = ["BUTTONS", "watch_page"]

#: What a button does, in words for those who point at it.
BUTTONS: Mapping[str, str] = {
    "teach": "remember a path as it is driven; it replaces the one in the store",
    "replay": "follow the path in the store",
    "stop": "stop the robot and end the run, as Ctrl-C does",
}


def watch_page(title: str, secret: str, buttons: Sequence[str]) -> tuple[str, str]:
    """Return the page and its content policy: it may connect to its own server only.

    Parameters
    ----------
    title : str
        What is watched.
    secret : str
        What the buttons are pressed with.
    buttons : sequence of str
        Those of `BUTTONS` that there are.
    """
    explorer, own = (
        files(package).joinpath(name).read_text(encoding="utf-8")
        for package, name in (("trailmark.report", "explorer.js"), ("trailmark.watching", "watch.js"))
    )
    place = files("trailmark.report").joinpath("explorer.html").read_text(encoding="utf-8")
    style = files("trailmark.watching").joinpath("watch.css").read_text(encoding="utf-8")
    body = [
        _header(title, secret, buttons),
        place.replace("<!-- data -->", "").rstrip(),
        '<section id="health" hidden>\n<h2>Localizers</h2>\n<div class="scroll"><table></table></div>\n</section>',
        text_html("This page asks this machine alone, and is there as long as its command.", "footer"),
    ]
    connect = "connect-src 'self'"
    page = page_html(title, body, style=style, script=(explorer, own), policy=connect)
    scripts = " ".join(script_hash(script) for script in (explorer, own))
    policy = f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src {scripts}; {connect}"
    return page, f"{policy}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


def _header(title: str, secret: str, buttons: Sequence[str]) -> str:
    pressed = "".join(
        f'<button type="button" data-press="{escape(name)}" title="{escape(BUTTONS[name])}" disabled>'
        f"{escape(name.capitalize())}</button>"
        for name in buttons
    )
    return (
        f'<header data-secret="{escape(secret)}">\n<h1 id="name">{escape(title)}</h1>\n'
        '<p class="summary"><span id="status" class="status" role="status">waiting</span> <span id="told"></span>'
        ' <span id="report"></span></p>\n'
        f'<p class="buttons">{pressed}</p>\n</header>'
    )
