"""Pieces of the page. Whatever comes from a run is escaped here, and only here."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files
from typing import Any

from trailmark.evaluation import FUSED
from trailmark.report.meanings import meaning_of, meaning_of_counter
from trailmark.report.style import css_variables, embed_svg
from trailmark.report.tables import Column, Table

__all__ = [
    "counters_html",
    "data_html",
    "facts_html",
    "figure_html",
    "folded_meanings_html",
    "notes_html",
    "page_html",
    "script_hash",
    "table_html",
    "text_html",
]

#: Nothing is fetched from anywhere, whatever a name in a run may say.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def page_html(
    title: str, body: Sequence[str], *, style: str = "", script: str | Sequence[str] = "", policy: str = ""
) -> str:
    """Return the whole page; the pieces of its body are HTML already.

    Parameters
    ----------
    title : str
        Of the window.
    body : sequence of str
        In their order.
    style : str
        Rules besides those of all reports.
    script : str or sequence of str
        The only ones that the page lets run.
    policy : str
        What else the page may do, as directives of a content security policy.
    """
    style = css_variables() + files("trailmark.report").joinpath("report.css").read_text(encoding="utf-8") + style
    scripts = [item for item in ([script] if isinstance(script, str) else script) if item]
    allowed = [f"script-src {' '.join(script_hash(item) for item in scripts)}"] if scripts else []
    policy = "; ".join([_POLICY, *allowed, *([policy] if policy else [])])
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            f"<title>{escape(title)}</title>",
            f"<style>\n{style}</style>",
            "</head>",
            "<body>",
            *body,
            *(f"<script>{item}</script>" for item in scripts),
            "</body>",
            "</html>",
            "",
        ]
    )


def script_hash(script: str) -> str:
    """Return how a content security policy names a script that it lets run."""
    return f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'"


def text_html(text: str, tag: str = "p", css_class: str = "") -> str:
    """Return a text in a tag."""
    attribute = f' class="{css_class}"' if css_class else ""
    return f"<{tag}{attribute}>{escape(text)}</{tag}>"


def notes_html(notes: Sequence[str]) -> str:
    """Return what the reader has to know about a table."""
    return "\n".join(text_html(note, css_class="note") for note in notes)


def table_html(table: Table) -> str:
    """Return a table with its notes; the row of the fused trajectory stands out."""
    has_units = any(column.unit for column in table.columns)
    head = "".join(_header_cell(column, has_units) for column in table.columns)
    rows = "\n".join(_row(table.columns, row) for row in table.rows)
    body = f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
    return f'<div class="scroll">{body}</div>\n{notes_html(table.notes)}'


def meanings_html(tables: Sequence[Table]) -> str:
    """Return what the headings of some tables mean, folded, for those who have no mouse to point with."""
    known: dict[str, str] = {}
    for column in (column for table in tables for column in table.columns):
        known.setdefault(column.title, _meaning(column))
    return folded_meanings_html({title: meaning for title, meaning in known.items() if meaning})


def folded_meanings_html(meanings: Mapping[str, str]) -> str:
    """Return what headings mean, by heading, folded; nothing for none."""
    if not meanings:
        return ""
    facts = "".join(f"<dt>{escape(title)}</dt><dd>{escape(meaning)}</dd>" for title, meaning in meanings.items())
    return f"<details>\n<summary>What the columns mean</summary>\n<dl>{facts}</dl>\n</details>"


def figure_html(svg: str, title: str, caption: str) -> str:
    """Return a drawing with its title above it."""
    heading = f"<figcaption>{escape(title)}<span>{escape(caption)}</span></figcaption>"
    return f"<figure>{heading}\n{embed_svg(svg, escape(f'{title}: {caption}'))}</figure>"


def data_html(name: str, document: Any) -> str:
    """Return data for the page's script: no text in it can end the element that holds it."""
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return f'<script type="application/json" id="{escape(name)}">{text}</script>'


def counters_html(counters: Mapping[str, Any]) -> str:
    """Return counters by name; zeros are pale."""
    items = "\n".join(_counter(name, count) for name, count in counters.items())
    return f'<ul class="counters">\n{items}\n</ul>'


def facts_html(facts: Mapping[str, Any]) -> str:
    """Return facts by name, nested as deep as they are."""
    return f"<dl>{''.join(_fact(name, value) for name, value in facts.items())}</dl>"


def _counter(name: str, count: Any) -> str:
    meaning = meaning_of_counter(name)
    attribute = ("" if count else ' class="zero"') + (f' title="{escape(meaning)}"' if meaning else "")
    return f"<li{attribute}><span>{escape(name)}</span><span>{escape(str(count))}</span></li>"


def _fact(name: str, value: Any) -> str:
    return f"<dt>{escape(str(name))}</dt><dd>{_value(value)}</dd>"


def _value(value: Any) -> str:
    if isinstance(value, Mapping) and "base64" in value:  # the numbers themselves are in run.json
        return escape(f"array {value.get('shape', '')} {value.get('dtype', '')}".strip())
    if isinstance(value, Mapping):
        return facts_html(value) if value else escape("none")
    if isinstance(value, list | tuple):
        return ", ".join(_value(item) for item in value)
    return escape("none" if value is None else str(value))


def _header_cell(column: Column, has_units: bool) -> str:
    attribute = ' class="number"' if column.is_number else ""
    unit = f"<span>{escape(column.unit) or '&nbsp;'}</span>" if has_units else ""
    meaning = _meaning(column)
    title = f' title="{escape(meaning)}"' if meaning else ""
    return f'<th scope="col"{attribute}{title}>{escape(column.title)}{unit}</th>'


def _meaning(column: Column) -> str:
    return column.meaning or meaning_of(column.title)


def _row(columns: Sequence[Column], cells: Sequence[str]) -> str:
    texts = [
        f'<td class="number">{escape(cell)}</td>' if column.is_number else f'<th scope="row">{escape(cell)}</th>'
        for column, cell in zip(columns, cells, strict=True)
    ]
    attribute = ' class="fused"' if FUSED in cells[:2] else ""
    return f"<tr{attribute}>{''.join(texts)}</tr>"
