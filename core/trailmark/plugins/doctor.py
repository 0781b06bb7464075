"""What is wrong with the installed plugins, and how to mend it."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from itertools import groupby
from typing import Literal

from trailmark.errors import PluginError
from trailmark.plugins.candidates import PluginRecord
from trailmark.plugins.loader import Plugins
from trailmark.plugins.registry import NO_PLUGINS
from trailmark.plugins.spec import Spec

__all__ = ["Finding", "examine", "missing_requirements"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One problem with the plugins, or a remark.

    Attributes
    ----------
    severity : {"error", "warning"}
        An error cannot be used; a warning cannot be used as it is, or not yet.
    topic : {"none", "broken", "api", "extra", "duplicate", "target"}
        No plugin at all; did not load; wrong plugin API; a missing extra; a name offered twice; a class that
        cannot be imported.
    subject : str
        The plugin, or the part.
    message, remedy : str
        What is wrong, and what to do.
    traceback : str
        The whole story of an exception.
    """

    severity: Literal["error", "warning"]
    topic: Literal["none", "broken", "api", "extra", "duplicate", "target"]
    subject: str
    message: str
    remedy: str
    traceback: str = ""


def examine(plugins: Plugins, *, deep: bool = False) -> list[Finding]:
    """Return everything that is wrong with the plugins.

    Parameters
    ----------
    plugins : Plugins
        As loaded.
    deep : bool
        Import every class and config too: slow, but nothing is left to find for a run.
    """
    if not plugins.records:
        message, _, remedy = NO_PLUGINS.partition(": ")
        return [Finding("error", "none", "plugins", message, remedy)]
    found = [_finding_of_failure(record) for record in plugins.failed]
    specs = plugins.registry.specs()
    found += _duplicates(specs)
    lacking = list(_missing_extras(specs))
    found += [finding for _, finding in lacking]
    if deep:
        explained = {spec for spec, _ in lacking}
        found += [finding for spec in specs if spec not in explained for finding in _import_all(spec)]
    return found


def missing_requirements(distribution: str, extra: str) -> list[str]:
    """Return what an extra of a distribution asks for and is not installed.

    The installed metadata is asked, not the modules: it knows what the extra needs without a list of ours.
    """
    try:
        requirements = metadata.requires(distribution) or []
    except metadata.PackageNotFoundError:
        return []
    return [name for name in _names_behind(requirements, extra) if not _is_installed(name)]


def _finding_of_failure(record: PluginRecord) -> Finding:
    if record.needs_other_api:
        remedy = f"pip install --upgrade {record.distribution}, or take the release of Trailmark that it is written for"
        return Finding("error", "api", record.origin, record.error, remedy, record.traceback)
    remedy = f"mend or reinstall {record.distribution}, or leave it out: --plugin no:{record.name}"
    return Finding("error", "broken", record.origin, record.error, remedy, record.traceback)


def _duplicates(specs: tuple[Spec, ...]) -> Iterator[Finding]:
    for (kind, name), group in groupby(specs, key=lambda spec: (spec.kind, spec.name)):
        offers = list(group)
        if len(offers) > 1:
            origins = " and ".join(spec.origin for spec in offers)
            choices = sorted({f"{spec.distribution}:{name}" for spec in offers})
            remedy = f"write plugin: {' or '.join(choices)}" if len(choices) == len(offers) else "block one of them"
            yield Finding("warning", "duplicate", f"{kind} {name}", f"offered by {origins}", remedy)


def _missing_extras(specs: tuple[Spec, ...]) -> Iterator[tuple[Spec, Finding]]:
    for spec in specs:
        missing = missing_requirements(spec.distribution, spec.extra) if spec.extra else []
        if missing:
            message = f"needs {', '.join(missing)} (extra {spec.extra!r}), which is not installed"
            yield spec, Finding("warning", "extra", f"{spec.kind} {spec.name}", message, spec.pip_line)


def _import_all(spec: Spec) -> Iterator[Finding]:
    for load in (spec.load, spec.load_config):
        try:
            load()
        except PluginError as error:
            remedy = f"mend or reinstall {spec.distribution}"
            story = "".join(traceback.format_exception(error.__cause__ or error))
            yield Finding("error", "target", f"{spec.kind} {spec.name}", str(error), remedy, story)


def _names_behind(requirements: list[str], extra: str) -> Iterator[str]:
    """Yield the distributions that an extra adds."""
    from packaging.requirements import Requirement

    for line in requirements:
        wanted = Requirement(line)
        marker = wanted.marker
        if marker and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""}):
            yield wanted.name


def _is_installed(distribution: str) -> bool:
    try:
        metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return False
    return True
