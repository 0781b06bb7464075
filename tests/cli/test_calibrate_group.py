"""The group `calibrate`, which plugins share."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.cli import main

PLUGIN = """
import click
from trailmark import hookimpl

@hookimpl
def trailmark_commands(group):
    group.commands["calibrate"].add_command(command)

@click.command("{name}", help="Calibrates {name}.")
def command():
    click.echo("calibrated {name}")
"""


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No installed plugin, so that only those of the test bring commands."""
    monkeypatch.setenv("TRAILMARK_PLUGINS", "baselines")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def test_plugins_share_the_group(tmp_path: Path, capsys):
    chosen = []
    for name in ("sonar", "compass"):
        file = tmp_path / f"{name}_plugin.py"
        file.write_text(PLUGIN.format(name=name))
        chosen += ["--plugin", str(file)]
    code, out, _ = run(capsys, *chosen, "calibrate", "--help")
    assert code == 0
    assert "Calibrates sonar." in out
    assert "Calibrates compass." in out
    assert run(capsys, *chosen, "calibrate", "sonar")[1] == "calibrated sonar\n"
    assert "calibrate" in run(capsys, *chosen, "--help")[1]


def test_nothing_to_calibrate_is_not_offered(capsys):
    assert "calibrate" not in run(capsys, "--help")[1]
    code, _, error = run(capsys, "calibrate", "ground")
    assert code == 2
    assert "no command 'calibrate'" in error
