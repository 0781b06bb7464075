"""One matrix of a bench config, and what its cells are made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from trailmark.config import Document
from trailmark.config.document import Keys
from trailmark.isolation.fingerprint import FileCache
from trailmark.plugins import Plugins
from trailmark_bench.config import BenchSection, CellsSection

__all__ = ["MatrixContext"]


@dataclass(frozen=True, slots=True, eq=False)
class MatrixContext:
    """One matrix of a bench config, and what its cells are made with.

    Attributes
    ----------
    document : Document
        The bench config.
    section, matrix : BenchSection, CellsSection
        The bench and the matrix.
    where : tuple
        Where the matrix stands in the document.
    plugins : Plugins
        What may be named.
    cache : dict
        Digests of files.
    session : mapping
        What the process of every cell is told besides.
    """

    document: Document
    section: BenchSection
    matrix: CellsSection
    where: Keys
    plugins: Plugins
    cache: FileCache
    session: Mapping[str, Any] = field(default_factory=dict)
