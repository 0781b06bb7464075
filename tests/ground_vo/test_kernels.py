"""The choice between vector kernels and plain ones."""

from __future__ import annotations

import logging

from trailmark_ground_vo import kernels
from trailmark_ground_vo.filters import transpose, transpose_plain


def test_vectors_are_taken_where_they_compile():
    assert kernels.load_kernels(True).transpose is transpose
    assert kernels.load_kernels(False).transpose is transpose_plain


def test_where_vectors_do_not_compile_the_plain_kernels_do_the_work(monkeypatch, caplog):
    def refuse(image):
        raise RuntimeError("no such instruction")

    broken = kernels.Kernels(refuse, refuse, lambda search_px: refuse, lambda search_px: refuse)
    monkeypatch.setattr(kernels, "_VECTOR", broken)
    kernels.load_kernels.cache_clear()

    with caplog.at_level(logging.WARNING):
        chosen = kernels.load_kernels(True)

    kernels.load_kernels.cache_clear()
    assert chosen.transpose is transpose_plain
    assert "no such instruction" in caplog.text
