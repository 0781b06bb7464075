"""What the command line does to logging: nothing that outlives it."""

from __future__ import annotations

import logging

import pytest

from trailmark.cli import main


def test_a_program_that_calls_the_command_line_still_hears_of_broken_plugins(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])

    logging.getLogger("trailmark.plugins.loader").warning("plugin 'x' did not load")

    assert caplog.messages == ["plugin 'x' did not load"]
