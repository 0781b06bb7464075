"""Rooms that are all the same tempt to close a loop between two of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from trailmark.geometry import Pose2

REPOSITORY = Path(__file__).resolve().parents[3]


def test_no_room_is_taken_for_another_that_looks_the_same(load_script, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(REPOSITORY / "benchmarks"))
    taught_maps = load_script("benchmarks/taught_maps.py")
    instants = taught_maps.worsened(taught_maps.rooms_alike(0, n_rooms=2), 0, 3.0)

    loops = taught_maps.teach(instants, tmp_path / "taught.trail").loops

    assert len(loops) > 0
    assert taught_maps.count_wrong(loops, instants) == 0
    from_next_door = replace(loops[0], measured=Pose2(3.0, 0.0, 0.0) @ loops[0].measured)
    assert taught_maps.count_wrong([from_next_door], instants) == 1
