from __future__ import annotations

import numpy as np
import pytest

from trailmark_divs.tracking import ShiftTracker, evidence_per_score


def peak_at(shift, height=0.6, max_shift=20, background=0.0):
    places = np.arange(-max_shift, max_shift + 1)
    return background + (height - background) * np.exp(-0.5 * (places - shift) ** 2)


def run(tracker, scores, n):
    for _ in range(n):
        tracked = tracker.update(scores)
    return tracked


def test_a_clear_peak_is_believed_after_about_a_window():
    tracker = ShiftTracker(20, 25)

    first = tracker.update(peak_at(4))
    later = run(tracker, peak_at(4), 24)

    assert first.columns == later.columns == pytest.approx(4.0, abs=1e-6)
    assert first.confidence < 0.5
    assert later.confidence > 0.98
    assert later.margin > 0.5


def test_a_margin_of_017_held_for_a_window_is_worth_odds_of_100():
    assert 25 * 0.17 * evidence_per_score(25) == pytest.approx(np.log(100))


def test_a_blank_picture_is_not_believed():
    assert run(ShiftTracker(20, 25), np.zeros(41), 100).confidence < 0.2


def test_a_false_peak_for_part_of_a_window_does_not_move_the_shift():
    tracker = ShiftTracker(20, 25)
    run(tracker, peak_at(3), 50)

    disturbed = peak_at(3, 0.4) + peak_at(-12, 0.7)
    for _ in range(8):
        tracked = tracker.update(disturbed)

    assert tracked.columns == pytest.approx(3.0, abs=0.1)
    assert tracked.margin < 0.0


def test_a_lasting_jump_is_followed_within_two_windows():
    tracker = ShiftTracker(20, 25)
    run(tracker, peak_at(3), 100)

    tracked = run(tracker, peak_at(-12), 50)

    assert tracked.columns == pytest.approx(-12.0, abs=1e-6)
    assert tracked.confidence > 0.98


def test_where_turns_are_measured_a_weak_false_peak_does_not_win_by_lasting():
    blind, knowing = ShiftTracker(20, 25), ShiftTracker(20, 25)
    knowing.are_turns_measured = True
    for tracker in (blind, knowing):
        run(tracker, peak_at(3), 100)

    false = peak_at(3, 0.30) + peak_at(-12, 0.36)
    fooled, held = (run(tracker, false, 200) for tracker in (blind, knowing))

    assert fooled.columns == pytest.approx(-12.0, abs=0.1)
    assert held.columns == pytest.approx(3.0, abs=0.1)


def test_where_turns_are_measured_a_clear_jump_is_still_followed_within_three_windows():
    tracker = ShiftTracker(20, 25)
    tracker.are_turns_measured = True
    run(tracker, peak_at(3), 100)

    tracked = run(tracker, peak_at(-12), 75)

    assert tracked.columns == pytest.approx(-12.0, abs=1e-6)
    assert tracked.confidence > 0.98


def test_a_slow_drift_is_followed_without_lag():
    tracker = ShiftTracker(20, 25)

    for k in range(200):
        shift = -10 + 0.1 * k
        tracked = tracker.update(peak_at(shift))

    assert tracked.columns == pytest.approx(shift, abs=0.1)
    assert tracked.confidence > 0.95


def test_a_known_turn_moves_the_shift_along():
    tracker = ShiftTracker(20, 25)
    run(tracker, peak_at(2), 50)

    tracker.move(-6.5)
    tracked = tracker.update(peak_at(-4.5, 0.4) + peak_at(2, 0.5))

    assert tracked.columns == pytest.approx(-4.5, abs=0.1)


def test_a_turn_beyond_all_shifts_starts_anew():
    tracker = ShiftTracker(20, 25)
    run(tracker, peak_at(2), 50)

    tracker.move(100.0)

    assert run(tracker, peak_at(-7), 25).columns == pytest.approx(-7.0, abs=1e-6)


@pytest.mark.parametrize("shift", [-20, 20])
def test_the_largest_shifts_can_be_tracked(shift):
    tracked = run(ShiftTracker(20, 25), peak_at(shift), 50)

    assert tracked.columns == shift
    assert tracked.confidence > 0.95


def test_mirrored_scores_give_the_mirrored_shift():
    rng = np.random.default_rng(7)
    left, right = ShiftTracker(20, 10), ShiftTracker(20, 10)

    for _ in range(40):
        scores = rng.uniform(-0.2, 0.3, 41) + peak_at(5, 0.3)
        one, other = left.update(scores), right.update(scores[::-1])
        assert one.columns == pytest.approx(-other.columns, abs=1e-9)
        assert one.confidence == pytest.approx(other.confidence, abs=1e-9)


def test_restart_forgets():
    tracker, fresh = ShiftTracker(20, 25), ShiftTracker(20, 25)
    run(tracker, peak_at(9), 50)

    tracker.restart()

    assert tracker.update(peak_at(-3)) == fresh.update(peak_at(-3))
