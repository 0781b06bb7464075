"""``trailmark doctor``: does this installation have what it needs."""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version

import click

from trailmark import PLUGIN_API, __version__
from trailmark.cli.root import plugins_of

__all__ = ["doctor_command"]


@dataclass(frozen=True, slots=True)
class _MachineCheck:
    name: str
    ok: bool
    found: str
    advice: str = ""


@click.command("doctor")
@click.option("--json", "as_json", is_flag=True, help="Print the checks as JSON.")
@click.pass_context
def doctor_command(context: click.Context, as_json: bool) -> None:
    """Check this installation: versions, plugins, writable folders. Exit code 1 when something is wrong."""
    checks = [_python(), *_packages(), _plugins(context), _numba_cache(), _output_folder()]
    if as_json:
        click.echo(json.dumps([asdict(check) for check in checks], indent=1))
    else:
        for check in checks:
            mark = "ok  " if check.ok else "FAIL"
            click.echo(f"{mark} {check.name:<34}{check.found}")
            if not check.ok:
                click.echo(f"     -> {check.advice}")
    if not all(check.ok for check in checks):
        raise click.exceptions.Exit(1)


def _python() -> _MachineCheck:
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    return _MachineCheck("python", sys.version_info >= (3, 11), found, "Trailmark needs Python 3.11 or newer")


def _packages() -> list[_MachineCheck]:
    checks = [_MachineCheck("trailmark", True, f"{__version__} (plugin API {PLUGIN_API})")]
    for requirement in requires("trailmark") or []:
        specification, _, marker = requirement.partition(";")
        name = "".join(_leading_name(specification))
        try:
            checks.append(_MachineCheck(name, True, version(name)))
        except PackageNotFoundError:
            if not marker:
                checks.append(_MachineCheck(name, False, "missing", f"pip install '{specification.strip()}'"))
    unique = {check.name: check for check in checks}
    return list(unique.values())


def _leading_name(specification: str) -> str:
    for index, character in enumerate(specification):
        if not (character.isalnum() or character in "-_."):
            return specification[:index]
    return specification


def _plugins(context: click.Context) -> _MachineCheck:
    records = plugins_of(context).records
    failed = [record.name for record in records if record.status == "failed"]
    found = f"{len(records)} found, {len(failed)} broken"
    return _MachineCheck("plugins", not failed, found, f"'trailmark plugins doctor' says why: {', '.join(failed)}")


def _numba_cache() -> _MachineCheck:
    folder = os.environ.get("NUMBA_CACHE_DIR") or os.path.dirname(os.path.dirname(__file__))
    advice = "compiled kernels cannot be kept; set NUMBA_CACHE_DIR to a writable folder for fast starts"
    fallback = os.access(os.path.expanduser("~"), os.W_OK)  # numba then caches per user
    return _MachineCheck("compiled kernels are kept", os.access(folder, os.W_OK) or fallback, folder, advice)


def _output_folder() -> _MachineCheck:
    folder = os.getcwd()
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return _MachineCheck("working folder is writable", False, str(error), "give --out DIR a writable folder")
    return _MachineCheck("working folder is writable", True, folder)
