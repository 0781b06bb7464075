"""Counter-based random numbers and hashes."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from trailmark_sim.hashing import hash2, mix_bits, normal_of, unit_of
from trailmark_sim.rng import frame_rng, stream_key


def test_numbers_depend_on_seed_stream_and_frame_alone() -> None:
    first = frame_rng(7, "floor/noise", 12).standard_normal(5)
    frame_rng(7, "floor/noise", 11).standard_normal(1000)  # what else is drawn does not matter

    again = frame_rng(7, "floor/noise", 12).standard_normal(5)

    np.testing.assert_array_equal(again, first)


def test_other_seeds_streams_and_frames_give_other_numbers() -> None:
    keys = [(7, "a", 0), (8, "a", 0), (7, "b", 0), (7, "a", 1), (7, "a", 2**40)]

    drawn = {tuple(frame_rng(*key).integers(0, 2**63, 4).tolist()) for key in keys}

    assert len(drawn) == len(keys)


def test_frames_of_a_stream_never_meet() -> None:
    long_one = frame_rng(3, "slip", 0).integers(0, 2**63, 100_000)
    next_one = frame_rng(3, "slip", 1).integers(0, 2**63, 1000)

    assert not np.isin(next_one, long_one).any()


def test_stream_keys_are_the_same_in_another_process() -> None:
    code = "from trailmark_sim.rng import stream_key; print(stream_key(5, 'wheels'))"

    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert int(other.stdout) == stream_key(5, "wheels")  # Python's own hash() would differ


def test_keys_stay_what_they_are_so_that_old_runs_can_be_repeated() -> None:
    assert stream_key(1, "floor") == 5366071819178608565


def test_the_hash_is_the_finaliser_of_splitmix() -> None:
    # the published first output of SplitMix64 with seed 0
    assert int(mix_bits(np.uint64(0x9E3779B97F4A7C15))) == 0xE220A8397B1DCDAF


def test_hashes_of_a_lattice_are_uniform_and_normal() -> None:
    hashes = [hash2(i, j, np.uint64(1)) for i in range(-60, 60) for j in range(-60, 60)]

    units = np.array([unit_of(np.uint64(h)) for h in hashes])
    normals = np.array([normal_of(np.uint64(h)) for h in hashes])

    counts = np.histogram(units, bins=10, range=(0, 1))[0]
    assert np.abs(counts - 1440).max() < 5 * np.sqrt(1440)
    assert abs(normals.mean()) < 0.03
    assert abs(normals.std() - 1.0) < 0.03
    neighbours = np.corrcoef(units.reshape(120, 120)[:, 1:].ravel(), units.reshape(120, 120)[:, :-1].ravel())[0, 1]
    assert abs(neighbours) < 0.03
