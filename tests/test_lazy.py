"""Packages that name what they have and load it late."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

from trailmark.lazy import lazy_names
from trailmark.plugins import load_plugins

OURS = [
    (target, spec.extra)
    for spec in load_plugins().registry.specs()
    if spec.kind in ("source", "localizer", "controller", "sink", "fault")
    and spec.distribution == "trailmark"
    and spec.target.startswith("trailmark_")
    for target in (spec.target, spec.config)
    if target
]


@pytest.mark.parametrize(("target", "extra"), OURS, ids=[target for target, _ in OURS])
def test_every_part_of_ours_can_be_imported_from_its_package(target: str, extra: str | None) -> None:
    home, _, name = target.partition(":")
    package = import_module(home.partition(".")[0])

    assert name in package.__all__
    assert name in dir(package)
    try:
        module = import_module(home)
    except ImportError:
        assert extra is not None
        pytest.skip(f"needs trailmark[{extra}]")
    assert getattr(package, name) is getattr(module, name)


def test_importing_every_plugin_loads_nothing_heavy() -> None:
    packages = sorted({target.partition(".")[0] for target, _ in OURS})
    code = f"import sys, {', '.join(packages)};"
    code += "print(sorted({'cv2', 'numba', 'sklearn', 'scipy', 'numpy', 'matplotlib'} & set(sys.modules)))"

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "[]"


def test_a_name_that_is_not_there_is_said_by_its_package() -> None:
    get, _ = lazy_names("trailmark_ground_vo", {"config": ("GroundVOConfig",)})

    with pytest.raises(AttributeError, match="module 'trailmark_ground_vo' has no attribute 'Nothing'"):
        get("Nothing")
