"""The watch for parts that hang: whom it interrupts, and whose handlers it leaves alone."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

import pytest

from trailmark.pipeline.ending.hangs import HangError, HangWatch

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGURG"), reason="the system has no SIGURG")

PATIENCE_S = 0.2
LIMIT_S = 10.0


@pytest.fixture(autouse=True)
def default_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGURG, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGURG, before)


def of_the_program(*_: object) -> None:
    """Handle a signal that is none of Trailmark's business."""


def spin() -> None:
    """Come back too late, but come back, so that a test that fails ends."""
    until_s = time.monotonic() + LIMIT_S
    while time.monotonic() < until_s:
        pass


def test_what_hangs_in_the_main_thread_is_interrupted_and_the_handler_set_back() -> None:
    watch = HangWatch(PATIENCE_S)

    with pytest.raises(HangError), watch:
        time.sleep(LIMIT_S)
    watch.close()

    assert signal.getsignal(signal.SIGURG) == signal.SIG_DFL


def test_a_handler_that_the_program_sets_meanwhile_is_left_alone() -> None:
    watch = HangWatch(PATIENCE_S)
    with watch:
        signal.signal(signal.SIGURG, of_the_program)

    watch.close()

    assert signal.getsignal(signal.SIGURG) is of_the_program


def test_with_a_handler_of_the_program_what_spins_is_interrupted_otherwise() -> None:
    watch = HangWatch(PATIENCE_S)
    with watch:
        signal.signal(signal.SIGURG, of_the_program)

    with pytest.raises(HangError), watch:
        spin()
    watch.close()

    assert signal.getsignal(signal.SIGURG) is of_the_program


def test_a_signal_that_somebody_else_sends_interrupts_nothing() -> None:
    watch = HangWatch(60.0)

    with watch:
        signal.raise_signal(signal.SIGURG)  # as the system does when urgent data come in
        came_back = True
    watch.close()

    assert came_back


def test_what_hangs_in_a_thread_is_interrupted_there_and_not_in_the_main_thread() -> None:
    watch = HangWatch(PATIENCE_S)
    with watch:
        pass  # the first frame is pushed from the main thread
    interrupted = threading.Event()

    def push() -> None:
        try:
            with watch:
                spin()
        except HangError:
            interrupted.set()

    thread = threading.Thread(target=push, daemon=True)
    thread.start()
    thread.join(LIMIT_S)
    watch.close()

    assert interrupted.is_set()


def test_what_drops_the_interruption_is_interrupted_again() -> None:
    """Python drops what is raised in a finalizer, or in the callback of a weak reference."""
    watch = HangWatch(PATIENCE_S)

    def drop_one() -> None:
        with contextlib.suppress(HangError):
            spin()
        spin()

    with pytest.raises(HangError), watch:
        drop_one()
    watch.close()


def test_one_that_cannot_be_interrupted_is_told_once_and_the_next_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    watch = HangWatch(PATIENCE_S)
    interrupt, is_compiled = watch._interrupt, True
    monkeypatch.setattr(watch, "_interrupt", lambda: None if is_compiled else interrupt())
    with watch:
        time.sleep(3.7 * PATIENCE_S)
    is_compiled = False

    with pytest.raises(HangError), watch:
        time.sleep(LIMIT_S)
    watch.close()

    assert caplog.text.count("hangs in compiled code") == 1
