"""Short versions of the benchmark, on recordings that are not shipped, held to the bars."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def bench(load_script):
    return load_script("benchmarks/divs.py")


@pytest.fixture(scope="module")
def street(bench, data_folder):
    return bench.read(data_folder / "divs" / "kitti_raw_stereo" / "left")


@pytest.fixture(scope="module")
def ours(bench):
    """Rows of ours only: the peers have tests of their own."""
    return {"divs": bench.make_divs}


def by_item(rows):
    return {row.item: row for row in rows}


def assert_met(rows, n_bars):
    judged = {item: row for item, row in by_item(rows).items() if row.bar is not None}
    assert len(judged) == n_bars
    assert not {item: (row.ours, row.bar) for item, row in judged.items() if not row.met}


def test_known_shifts_of_a_street_meet_their_bars(bench, street, ours, monkeypatch):
    monkeypatch.setattr(bench, "ALL", ours)

    assert_met(bench.crop_rows(street, bench.QUICK_SHIFTS_PX), 8)


@pytest.mark.slow
def test_a_camera_half_a_metre_to_the_right_is_seen_there(bench, street, ours, data_folder, monkeypatch):
    monkeypatch.setattr(bench, "ALL", ours)
    right = bench.read(data_folder / "divs" / "kitti_raw_stereo" / "right")

    assert_met(bench.stereo_rows(street, right), 3)


def test_a_corridor_walked_nearer_the_left_wall_is_positive(bench, ours, data_folder, monkeypatch):
    monkeypatch.setattr(bench, "ALL", ours)
    walks = [bench.read(data_folder / "divs" / "corridor" / walk) for walk in ("ref", "query")]

    assert_met(bench.corridor_rows(*walks), 2)


def test_the_place_is_found_by_appearance_alone(bench, street):
    assert_met(bench.appearance_rows(street), 2)


def test_streams_hold_out_where_a_single_picture_is_fooled_by_yaw(bench, street):
    swerving = street[150:]
    pictures = swerving, bench.degraded(swerving)

    ours = bench.crop_case(bench.make_divs, pictures, 25, (-24,), -3.0, when_blind="silent")
    peer = bench.crop_case(bench.PEERS["phase_shift"], pictures, 25, (-24,), -3.0)

    assert 2 * ours.rates()[0] < peer.rates()[0]
