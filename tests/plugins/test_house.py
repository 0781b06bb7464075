"""Guards: every plugin folder is packaged and registered, and listing plugins stays light."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from trailmark.plugins import HookSpecs, load_plugins

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FOLDERS = sorted(path.name for path in (ROOT / "plugins").iterdir() if path.is_dir())

HEAVY = {"cv2", "numba", "sklearn", "scipy", "filterpy", "matplotlib"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_plugin_folder_is_packaged_registered_and_typed(folder):
    package = f"plugins/{folder}/trailmark_{folder}"

    assert (ROOT / package / "py.typed").is_file()
    assert package in PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert PYPROJECT["project"]["entry-points"]["trailmark"].get(folder) == f"trailmark_{folder}.plugin"
    assert f"trailmark_{folder}" in PYPROJECT["tool"]["mypy"]["packages"]


def test_everything_that_is_packaged_stands_in_the_tree():
    for package in PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        assert (ROOT / package / "__init__.py").is_file(), package


def printed_by(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_importing_the_registry_imports_neither_numpy_nor_pydantic():
    heavy = HEAVY | {"numpy", "pydantic"}

    assert printed_by(f"import sys, trailmark.plugins; print(*({heavy} & set(sys.modules)))") == ""


def test_loading_and_listing_all_plugins_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from trailmark.plugins import load_plugins\n"
        "load_plugins().registry.specs()\n"
        f"print(*({HEAVY} & set(sys.modules)))"
    )

    assert printed_by(code) == ""


def test_importing_a_config_imports_nothing_heavy():
    code = (
        "import sys\n"
        "from trailmark.errors import PluginLoadError\n"
        "from trailmark.plugins import load_plugins\n"
        "for spec in load_plugins().registry.specs():\n"
        "    try: spec.load_config()\n"
        "    except PluginLoadError: continue\n"
        f"    heavy = {HEAVY} & set(sys.modules)\n"
        "    if heavy: sys.exit(print(spec.config, 'imports', *sorted(heavy)))"
    )

    assert printed_by(code) == ""


def test_every_hook_carries_the_prefix_and_a_description():
    hooks = [name for name in vars(HookSpecs) if not name.startswith("_")]

    assert "trailmark_register" in hooks
    for name in hooks:
        assert name.startswith("trailmark_")
        assert getattr(HookSpecs, name).__doc__


def test_every_registered_part_has_a_summary_and_unique_name():
    specs = load_plugins().registry.specs()

    assert all(spec.summary for spec in specs)
    assert len({(spec.kind, spec.name) for spec in specs}) == len(specs)


def imported(file: Path) -> set[str]:
    """Return the packages that a module imports anywhere, functions and type checking included."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


#: Who stands above others, and on whom: the experiments of the papers reach into the methods that they take apart.
MAY_IMPORT = {
    "trailmark_papers": {"trailmark_divs", "trailmark_ground_vo", "trailmark_kinect_landmarks", "trailmark_omni_surf"}
}


@pytest.mark.parametrize("package", [ROOT / "core" / "trailmark", *sorted(ROOT.glob("plugins/*/trailmark_*"))])
def test_core_imports_no_plugin_and_a_plugin_no_other(package):
    files = list(package.rglob("*.py"))
    allowed = {package.name} | MAY_IMPORT.get(package.name, set())
    strangers = {
        f"{file.relative_to(package)} imports {name}"
        for file in files
        for name in imported(file)
        if name.startswith("trailmark_") and name not in allowed
    }

    assert files
    assert strangers == set()


def test_nobody_that_others_import_imports_others():
    imported_ones = set().union(*MAY_IMPORT.values())

    assert not imported_ones & set(MAY_IMPORT)


@pytest.mark.parametrize("package", [ROOT / "core" / "trailmark", *sorted(ROOT.glob("plugins/*/trailmark_*"))])
def test_kernels_are_compiled_by_the_decorators_of_core_alone(package):
    compiled_otherwise = {
        f"{file.relative_to(ROOT)}: {word}"
        for file in package.rglob("*.py")
        if file != ROOT / "core" / "trailmark" / "kernels.py"
        for word in ("njit", "numba.jit", "import jit", "vectorize(", "fastmath")
        if word in file.read_text(encoding="utf-8")
    }

    assert compiled_otherwise == set()
