"""The command line. Commands are imported when they are called, so that ``--help`` stays fast."""

from __future__ import annotations

import logging
import os
import sys

__all__ = ["main"]

_LEVELS = ("debug", "info", "warning", "error", "critical")


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 the run failed, 2 the request was wrong, 128 + N ended by signal N."""
    from trailmark.cli.signals import call_until_signal

    words = sys.argv[1:] if arguments is None else arguments
    sys.exit(call_until_signal(lambda: _exit_code(words), is_whole_program=arguments is None))


def _exit_code(arguments: list[str]) -> int | str | None:
    """Run a command and return what to exit with."""
    from trailmark.cli.errors import exit_code_of, has_lost_its_reader
    from trailmark.cli.root import refuse_named_pipes, root, split_plugin_options
    from trailmark.interruption import shielded
    from trailmark.isolation.orphan import ENDS_WITH_STDIN, end_with_stdin

    try:
        _log_to_stderr(os.environ.get("TRAILMARK_LOG") or "warning")
        if os.environ.pop(ENDS_WITH_STDIN, ""):
            end_with_stdin()
        chosen, rest = split_plugin_options(arguments)
        refuse_named_pipes(rest)
        code = root.main(rest, prog_name="trailmark", obj=chosen, standalone_mode=False)
        sys.stdout.flush()  # a reader that has gone away shows now, and not when Python ends
    except SystemExit as error:
        return 0 if has_lost_its_reader() else error.code
    except BaseException as error:
        if os.environ.get("TRAILMARK_DEBUG"):
            raise
        with shielded():
            return exit_code_of(error)
    return code if isinstance(code, int) else 0  # click hands the code of an early exit back


def _log_to_stderr(level: str) -> None:
    from trailmark.errors import ConfigError

    if level.lower() not in _LEVELS:
        raise ConfigError(f"TRAILMARK_LOG={level}: it takes {', '.join(_LEVELS)}")
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("trailmark: %(levelname)s: %(message)s"))
    handler.addFilter(_is_news)
    logging.basicConfig(handlers=[handler], level=level.upper())


def _is_news(record: logging.LogRecord) -> bool:
    """Whether the log says what the command line does not: it names broken plugins itself."""
    return record.levelno >= logging.ERROR or not record.name.startswith("trailmark.plugins")
