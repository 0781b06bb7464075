"""Which of several writers of a topic is listened to."""

from __future__ import annotations

from trailmark_ros2.writers import WriterChoice


def heard(*messages: tuple[int, float]) -> list[bool]:
    choice = WriterChoice()
    return [choice.counts(writer, came_s) for writer, came_s in messages]


def test_a_program_that_was_started_again_counts_at_once() -> None:
    assert heard((1, 0.0), (1, 0.1), (2, 0.3), (2, 0.4)) == [True] * 4


def test_of_two_that_speak_at_once_the_first_counts() -> None:
    said = heard((1, 0.0), (2, 0.05), (1, 0.1), (2, 0.15), (1, 0.2), (2, 0.25), (1, 0.3))

    assert said == [True, True, False, True, True, False, True]


def test_one_late_message_of_a_program_that_was_started_again_leaves_out_nothing_else() -> None:
    choice = WriterChoice()
    messages = [(1, 0.0), (1, 0.05), (2, 0.1), (1, 0.11), *((2, 0.15 + 0.05 * k) for k in range(80))]

    said = [choice.counts(*message) for message in messages]

    assert said == [True] * 3 + [False] + [True] * 80
    assert not choice.is_contested


def test_when_the_first_is_gone_the_second_counts() -> None:
    alternating = [(1 + k % 2, 0.1 * k) for k in range(10)]
    alone = [(2, 1.0 + 0.1 * k) for k in range(60)]

    said = heard(*alternating, *alone)

    first = said.index(True, 10) - 10
    assert 25 < first < 32  # 3 s after the last message of the first
    assert all(said[10 + first :])


def test_a_third_that_comes_while_two_speak_does_not_take_over() -> None:
    assert heard((1, 0.0), (2, 0.1), (1, 0.2), (1, 0.3), (3, 0.4), (1, 0.5))[-3:] == [True, False, True]
