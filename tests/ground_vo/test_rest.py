"""Standing still, or a lens that is covered."""

from __future__ import annotations

from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.rest import RestWatch

STILL, FAST = ImageMotion(0.1, 0.0, 0.0), ImageMotion(20.0, 0.0, 0.0)


def test_a_robot_that_stands_at_the_start_is_believed_where_the_ground_has_texture_in_focus():
    watch = RestWatch()

    assert "no texture in focus" in watch.reason_doubted(STILL, None)
    watch.recognise()
    assert watch.reason_doubted(STILL, None) == ""


def test_what_is_out_of_focus_has_to_move_farther_to_be_ground():
    sharp, blurred = RestWatch(), RestWatch()

    sharp.add(FAST)
    blurred.add(FAST, is_in_focus=False)

    assert sharp.reason_doubted(FAST, None) == ""
    assert blurred.reason_doubted(FAST, None) != ""
    blurred.add(FAST, is_in_focus=False)
    assert blurred.reason_doubted(FAST, None) == ""


def test_what_stands_still_while_others_move_is_not_ground():
    assert "stands still" in RestWatch().reason_doubted(STILL, FAST)


def test_what_has_moved_before_may_stand_still_though_wheels_spin():
    watch = RestWatch()
    watch.add(FAST)

    assert watch.reason_doubted(STILL, FAST) == ""


def test_after_a_loss_standing_still_is_told_by_others_or_by_the_ground_of_before():
    watch = RestWatch()
    watch.add(FAST)
    watch.begin(was_told=True)

    assert "since the track was lost" in watch.reason_doubted(STILL, None)
    assert watch.reason_doubted(STILL, STILL) == ""
    watch.recognise()
    assert watch.reason_doubted(STILL, None) == ""


def test_after_a_loss_what_moves_is_ground():
    watch = RestWatch()
    watch.begin(was_told=True)

    watch.add(FAST)

    assert watch.reason_doubted(FAST, None) == ""


def test_a_camera_mounted_the_other_way_round_is_noticed():
    watch, back = RestWatch(), ImageMotion(-20.0, 0.0, 0.0)

    reasons = [watch.reason_doubted(back, FAST) for _ in range(3)]

    assert reasons[0] == ""
    assert "yaw_deg" in reasons[-1]
