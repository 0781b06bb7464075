"""``trailmark bench watch``, and ``trailmark watch`` of a bench's folder: a bench while it goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from click import format_filename

from trailmark.cli.watch import Look
from trailmark_bench.index import Index

__all__ = ["look_at_bench"]


def look_at_bench(folder: Path) -> Look:
    """Return what looks once at the bench of a folder."""
    from rich.text import Text

    def look() -> tuple[bool, Any]:
        with Index(folder) as index:
            records = index.records()
        counts: dict[str, int] = {}
        for record in records:
            counts[record.state] = counts.get(record.state, 0) + 1
        states = ", ".join(f"{count} {state}" for state, count in counts.items()) or "no cell has begun"
        running = "".join(f"\n  {record.label}" for record in records if record.state == "running")
        goes_on = bool(counts.get("running"))
        return goes_on, Text(f"{format_filename(folder.resolve().name)}: {states}{running}")

    return look
