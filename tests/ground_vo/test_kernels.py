"""The choice between vector kernels and plain ones."""

from __future__ import annotations

import logging

import numba
import pytest

from trailmark.interfaces import Session
from trailmark_ground_vo import kernels
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.filters import transpose, transpose_plain
from trailmark_ground_vo.first_kernels import FIRST_KERNELS
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.map_localizer import GroundMap


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


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_the_kernels_listed_for_two_processes_are_those_that_a_start_calls(camera, localizer_map):
    sensors = {"floor": camera.sensor_info("floor")}

    GroundVO(GroundVOConfig(camera="floor")).start(Session(name="floor", sensors=sensors))
    patches = GroundMap(GroundMapConfig(camera="floor"))
    patches.start(Session(name="floor_map", mode="teach", sensors=sensors, map=localizer_map))

    uncalled = [(kernel.__name__, types) for kernel, types in FIRST_KERNELS if types not in kernel.overloads]
    assert not uncalled
