"""``trailmark calibrate odometry``, ``mounting`` and ``delay``. What is heavy is imported on use."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from trailmark.errors import ConfigError, DataError

if TYPE_CHECKING:
    from trailmark.plugins import Plugins
    from trailmark_calibration.telling import Question

__all__ = ["COMMANDS"]

What = Literal["odometry", "mounting", "delay"]

_HELP: dict[What, str] = {
    "odometry": """Scales of wheel odometry: way, turn, and the bend of a straight way.

    CONFIG is a config, or the folder of a run. The motions that one localizer tells are compared with those of another
    one, over one ordinary drive: straight ways, and turns both ways. Every figure comes with its uncertainty (95 %),
    and what the drive does not tell is said. Prints the localizer's line for the config.""",
    "mounting": """The place of a sensor on the robot: x, y and yaw.

    CONFIG is a config, or the folder of a run. The motions that the sensor's localizer tells are compared with those of
    another one, over one ordinary drive: x and y need turns, the yaw straight ways. Every figure comes with its
    uncertainty (95 %), and what the drive does not tell is said. Prints the sensor's line for the config.""",
    "delay": """How far the stamps of two sources are apart.

    CONFIG is a config, or the folder of a run. The motions that two localizers tell are compared over one ordinary
    drive that begins and ends many turns. Prints the source's line for the config.""",
}


def _command(what: What) -> click.Command:
    @click.command(what, help=_HELP[what])
    @click.argument("config", metavar="CONFIG|RUN", type=click.Path(path_type=Path))
    @click.option("--of", metavar="LOCALIZER", help="The localizer that is calibrated.")
    @click.option("--against", metavar="LOCALIZER", help="The one that it is compared with.")
    @click.option("--sensor", hidden=what != "mounting", help="Which sensor of that localizer, if it has several.")
    @click.option("--track", "track_m", type=float, help="Distance of the wheels that the driver takes [m].")
    @click.option("--interval", "interval_s", default=0.5, show_default=True, help="Length of what is compared [s].")
    @click.option("--longest-delay", "longest_delay_s", default=1.0, show_default=True, help="Looked for [s].")
    @click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
    @click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
    @click.pass_context
    def command(context: click.Context, /, config: Path, **options: Any) -> None:
        from trailmark.cli.root import plugins_of

        _run(what, config, plugins_of(context), options)

    return command


def _run(what: What, path: Path, plugins: Plugins, options: dict[str, Any]) -> None:
    _check(what, options)
    from trailmark.config.document import read_document
    from trailmark_calibration.drive import choose_two, observe_drive, read_localizers, read_run, restricted_to
    from trailmark_calibration.telling import Question, answer

    is_run = path.is_dir()
    file = path / "config.yaml" if is_run else path
    if is_run and not (path / "estimates.csv").is_file():
        raise ConfigError(f"{path} is no folder of a run: it has no estimates.csv")
    config = read_localizers(file, plugins, options["overrides"])
    two = choose_two(config, options["of"], options["against"], of_wheels=what == "odometry")
    if is_run:
        drive = read_run(path, config, two)
    else:
        alone = restricted_to(config, two, read_document(file).data.get("estimator"))
        with _said_if_cut_short():
            drive = observe_drive(alone, two)
    question = Question(
        what, two, options["sensor"], options["track_m"], options["interval_s"], options["longest_delay_s"]
    )
    _print(answer(question, drive), question, options["as_json"])


@contextmanager
def _said_if_cut_short() -> Iterator[None]:
    """Say of a drive that is interrupted that nothing comes of it."""
    from trailmark.cli.errors import say
    from trailmark.interruption import TELL_S, shielded

    try:
        yield
    except KeyboardInterrupt:
        with shielded(TELL_S):
            say("the drive was cut short, so nothing is calibrated: let it come to its end")
        raise


def _print(found: Any, question: Question, as_json: bool) -> None:
    if not found.is_told:
        raise DataError("; ".join(" ".join(line.split()) for line in found.lines))
    if as_json:
        click.echo(json.dumps(found.document, indent=1))
        return
    for line in [*found.lines, "for the config:" if found.config_lines else "", *found.config_lines]:
        if line:
            click.echo(line)


def _check(what: What, options: dict[str, Any]) -> None:
    if what != "mounting" and options["sensor"] is not None:
        raise ConfigError(f"--sensor says whose mounting is asked for; 'calibrate {what}' takes none")
    for name, low, high in (("interval_s", 0.05, 60.0), ("longest_delay_s", 0.05, 30.0), ("track_m", 0.01, 100.0)):
        value = options[name]
        if value is not None and not low <= value <= high:
            option = {"interval_s": "--interval", "longest_delay_s": "--longest-delay", "track_m": "--track"}[name]
            raise ConfigError(f"{option} must be between {low:g} and {high:g}, not {value:g}")


COMMANDS = tuple(_command(what) for what in _HELP)
