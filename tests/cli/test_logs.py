"""What the command line does to logging: nothing that outlives it."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

from trailmark.cli import main


def test_a_program_that_calls_the_command_line_still_hears_of_broken_plugins(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])

    logging.getLogger("trailmark.plugins.loader").warning("plugin 'x' did not load")

    assert caplog.messages == ["plugin 'x' did not load"]


@pytest.mark.parametrize(("level", "code"), [("loud", 2), ("INFO", 0), ("", 0)])
def test_a_level_of_the_log_that_does_not_exist_is_refused_in_one_line(level: str, code: int) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "trailmark.cli", "--version"],
        env=os.environ | {"TRAILMARK_LOG": level},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == code
    expected = "trailmark: TRAILMARK_LOG=loud: it takes debug, info, warning, error, critical\n" if code else ""
    assert done.stderr == expected


def test_a_warning_reaches_the_user_on_standard_error(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("raise OSError('no such camera')\n")
    words = [sys.executable, "-m", "trailmark.cli", "--plugin", "broken.py", "init"]

    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert done.stderr == (
        "trailmark: warning: plugin 'broken' (broken.py) did not load: OSError: no such camera;"
        " run 'trailmark plugins doctor'\n"
    )
