"""Localizers that do not look at the belief begin with a picture while those before them are at work."""

from __future__ import annotations

import signal
import threading

import pytest

from trailmark import worker
from trailmark.errors import RunError
from trailmark.estimates import Motion
from trailmark.geometry import Pose2
from trailmark.interruption import Interrupted
from trailmark.pipeline import Pipeline
from trailmark.pipeline.localizers import runner

STAMPS = [0.0, 0.1, 0.2, 0.3]


def blind(fakes, say=lambda frame, belief: ()):
    localizer = fakes.Scripted(say)
    localizer.uses_belief, localizer.begins_early = False, True
    return localizer


def run(fakes, localizers, **settings):
    source = fakes.Recording(fakes.image_frames("cam", STAMPS))
    pipeline = Pipeline(fakes.parts({"cam": source}, localizers, **settings))
    return [
        (step.stamp_s, step.belief.pose_map_base, [record.source for record in step.estimates]) for step in pipeline
    ]


def motion(fakes, step_m: float):
    def say(frame, belief):
        return (Motion(frame.stamp_s - 0.1, frame.stamp_s, Pose2(step_m), fakes.GOOD),)

    return say


def test_two_are_at_work_at_once(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    both = threading.Barrier(2, timeout=20.0)  # one alone would wait in vain, and its run fail

    def meet(frame, belief):
        both.wait()
        return ()

    assert len(run(fakes, {"one": fakes.Scripted(meet), "two": blind(fakes, meet)})) == len(STAMPS)


def test_what_they_say_is_taken_in_the_order_of_the_config(fakes, monkeypatch) -> None:
    found = {}
    for n_cores in (1, 2):
        monkeypatch.setattr(worker, "n_cores", lambda n=n_cores: n)
        found[n_cores] = run(
            fakes,
            {
                "first": blind(fakes, motion(fakes, 0.1)),
                "second": fakes.Scripted(motion(fakes, 0.2)),
                "third": blind(fakes, motion(fakes, 0.3)),
            },
            use=frozenset({"third"}),
        )

    assert found[2] == found[1]
    assert found[2][-1][2] == ["first", "second", "third"]


def test_one_that_looks_at_the_belief_waits_for_its_turn(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    threads = {}

    def note(name):
        def say(frame, belief):
            threads[name] = threading.current_thread()
            return ()

        return say

    localizers = {"a": fakes.Scripted(note("a")), "b": fakes.Scripted(note("b")), "c": blind(fakes, note("c"))}
    run(fakes, localizers)

    assert threads["a"] is threads["b"] is threading.current_thread()
    assert threads["c"].name == "localizer c"
    assert not threads["c"].is_alive()


def test_on_one_core_nothing_begins_before_its_turn(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 1)
    threads = []
    own = blind(fakes, lambda frame, belief: threads.append(threading.current_thread()) or ())

    run(fakes, {"one": fakes.Scripted(), "two": own})

    assert set(threads) == {threading.current_thread()}


def test_what_it_raises_names_it_and_the_frame(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)

    def stumble(frame, belief):
        raise ValueError("no corner")

    with pytest.raises(
        RunError, match=r"localizer 'two' failed in observe at the frame of 'cam' at 0\.0+ s: ValueError"
    ):
        run(fakes, {"one": fakes.Scripted(), "two": blind(fakes, stumble)})


def test_one_that_does_not_come_back_is_named(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    monkeypatch.setattr(worker, "_PATIENCE_S", 0.0)
    over = threading.Event()

    with pytest.raises(RunError, match=r"localizer 'two' failed in observe .* not come back"):
        run(fakes, {"one": fakes.Scripted(), "two": blind(fakes, lambda *_: over.wait(60.0) and ())}, patience_s=0.2)
    over.set()


def test_what_has_begun_is_over_before_teaching_ends(fakes, monkeypatch) -> None:
    """Ctrl-C comes while another localizer is at work."""
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    is_at_work, may_end = threading.Event(), threading.Event()
    calls = []

    def interrupt(frame, belief):
        if frame.stamp_s < STAMPS[-1]:
            return motion(fakes, 0.1)(frame, belief)
        is_at_work.wait(20.0)
        threading.Timer(0.1, may_end.set).start()
        raise Interrupted(signal.SIGINT)

    def take_time(frame, belief):
        if frame.stamp_s < STAMPS[-1]:
            return ()
        is_at_work.set()
        may_end.wait(20.0)
        calls.append("observe")
        return ()

    two = blind(fakes, take_time)
    monkeypatch.setattr(two, "finish", lambda: calls.append("finish"))

    run(fakes, {"one": fakes.Scripted(interrupt), "two": two}, mode="teach", disk={})

    assert calls == ["observe", "finish"]


def test_one_that_has_begun_and_hangs_does_not_keep_an_interrupted_run(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    monkeypatch.setattr(worker, "_PATIENCE_S", 0.0)
    monkeypatch.setattr(runner, "_PATIENCE_S", 0.1)
    over = threading.Event()

    def interrupt(frame, belief):
        raise Interrupted(signal.SIGINT)

    source = fakes.Recording(fakes.image_frames("cam", STAMPS))
    two = blind(fakes, lambda *_: over.wait(60.0) and ())
    pipeline = Pipeline(fakes.parts({"cam": source}, {"one": fakes.Scripted(interrupt), "two": two}))

    with pytest.raises(RunError, match=r"localizer 'two' has not come back 0\.1 s after the last frame"):
        list(pipeline)
    over.set()


def test_none_begins_early_unasked(fakes, monkeypatch) -> None:
    monkeypatch.setattr(worker, "n_cores", lambda: 2)
    threads = []
    two = blind(fakes, lambda frame, belief: threads.append(threading.current_thread()) or ())
    two.begins_early = False

    run(fakes, {"one": fakes.Scripted(), "two": two})

    assert set(threads) == {threading.current_thread()}
