"""Distributions that a config requires."""

from __future__ import annotations

from importlib import metadata

from packaging.requirements import InvalidRequirement, Requirement

__all__ = ["unmet"]


def unmet(requirement: str) -> str:
    """Return what is wrong with a requirement as pip writes it; empty when it is installed and fits."""
    try:
        wanted = Requirement(requirement)
    except InvalidRequirement as error:
        reason = str(error).splitlines()[0]
        return f"{requirement!r} is no requirement ({reason}); write for example 'trailmark-mrclam>=0.1'"
    try:
        installed = metadata.version(wanted.name)
    except metadata.PackageNotFoundError:
        return f"{wanted.name} is not installed: pip install '{requirement}'"
    if wanted.specifier.contains(installed, prereleases=True):
        return ""
    return (
        f"{wanted.name} {installed} is installed, {wanted.specifier} is required: install such a version, if there is"
        " one, or change the requirement"
    )
