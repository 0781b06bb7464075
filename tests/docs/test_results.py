"""The recipe of the pages of results: what makes a page old, and what making it anew leaves alone."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

REPOSITORY = Path(__file__).parents[2]

PAGE = """# A page

Prose of ours.

<!-- made by: python benchmarks/said.py -->
as it was
<!-- made: end -->

More prose.

<!-- made by: python benchmarks/written.py --out {out} -> page.md *.svg -->
as it was
<!-- made: end -->
"""
SAID = """
import sys
sys.path[:0] = ["core/tool", "core/elsewhere"]
import kernel, plugin
print("| said |", kernel.answer())
"""
WRITTEN = """
import pathlib, sys
out = pathlib.Path(sys.argv[2])
(out / "page.md").write_text("written ![](plot.svg)\\n")
(out / "plot.svg").write_text("<svg/>")
"""
KERNEL = '''"""About the kernel."""

def answer():
    return 42
'''


@pytest.fixture(scope="session")
def recipe(load_script: Callable[[str], ModuleType]) -> ModuleType:
    """`benchmarks/results.py` as a module."""
    return load_script("benchmarks/results.py")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A small checkout with a page of two blocks."""
    files = {
        "docs/results/page.md": PAGE,
        "benchmarks/said.py": SAID,
        "benchmarks/written.py": WRITTEN,
        "benchmarks/other.py": "",
        "core/tool/kernel.py": KERNEL,
        "core/elsewhere/unused.py": "",
        "core/elsewhere/plugin.py": "",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path)]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run([*git, *words], check=True)
    return tmp_path


def test_both_blocks_are_made_and_the_prose_stays(recipe: ModuleType, checkout: Path) -> None:
    assert recipe.main(["check", "--strict"], checkout) == 1

    assert recipe.main(["make"], checkout) == 0

    page = (checkout / "docs/results/page.md").read_text()
    assert page == PAGE.replace("as it was", "| said | 42", 1).replace("as it was", "written ![](page_plot.svg)")
    assert (checkout / "docs/results/page_plot.svg").read_text() == "<svg/>"
    assert recipe.main(["check", "--strict"], checkout) == 0


@pytest.mark.parametrize(
    ("file", "text", "old"),
    [
        ("core/tool/kernel.py", KERNEL.replace("42", "43"), "core/tool changed since"),
        ("core/tool/kernel.py", KERNEL.replace("About", "All about") + "\n# a comment\n", ""),
        ("core/tool/beside.py", "x = 1", "core/tool changed since"),
        ("core/elsewhere/unused.py", "x = 1", ""),
        ("benchmarks/said.py", SAID + "\nx = 1", "benchmarks/said.py changed since"),
        ("benchmarks/other.py", "x = 1", ""),
        ("docs/results/page.md", PAGE.replace("said.py -->", "said.py --more -->"), "its command has changed"),
    ],
)
def test_what_makes_a_block_old(recipe: ModuleType, checkout: Path, file: str, text: str, old: str) -> None:
    recipe.main(["make"], checkout)

    (checkout / file).write_text(text)

    results = recipe.Results(checkout)
    said, _ = results.blocks()
    assert results.why_old(said).startswith(old)
    assert bool(results.why_old(said)) == bool(old)


@pytest.mark.parametrize("ends", ["sys.exit(3)", "pass"])
def test_a_command_that_fails_or_says_nothing_leaves_the_page(recipe: ModuleType, checkout: Path, ends: str) -> None:
    (checkout / "benchmarks/said.py").write_text(f"import sys; {ends}")

    with pytest.raises(SystemExit, match=r"its page stays as it was"):
        recipe.main(["make", "page"], checkout)

    assert (checkout / "docs/results/page.md").read_text() == PAGE


def test_code_that_changes_meanwhile_is_no_code_of_the_page(recipe: ModuleType, checkout: Path) -> None:
    meddling = "open('core/tool/kernel.py', 'a').write('x = 1')"
    (checkout / "benchmarks/said.py").write_text(SAID + meddling)

    with pytest.raises(SystemExit, match=r"core/tool changed while .* ran; its page stays as it was"):
        recipe.main(["make", "page"], checkout)

    assert (checkout / "docs/results/page.md").read_text() == PAGE


def test_what_takes_too_long_is_left_and_said(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recipe.main(["make", "--hours", "0.1"], checkout) == 0

    assert "no time for page, page-2" in capsys.readouterr().out
    assert (checkout / "docs/results/page.md").read_text() == PAGE


def test_a_page_that_was_never_made_is_reckoned_with_and_then_measured(recipe: ModuleType) -> None:
    block = recipe.Block(Path("toth2015.md"), 0, "trailmark reproduce toth2015")
    made = recipe.Made(block.command, "1234567", "2026-11-23", 33.0)

    assert recipe._minutes_of(block, {}) == recipe._RECKONED_MIN["toth2015"]
    assert recipe._minutes_of(block, {"toth2015": made}) == 33.0
    assert set(recipe._RECKONED_MIN) <= {known.name for known in recipe.Results(REPOSITORY).blocks()}


def test_an_unknown_page_is_refused(recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        recipe.main(["make", "pages"], checkout)

    assert left.value.code == 2
    assert "there are page, page-2" in capsys.readouterr().err


def test_every_block_of_our_pages_names_a_program_of_ours(recipe: ModuleType) -> None:
    blocks = recipe.Results(REPOSITORY).blocks()
    assert blocks
    for block in blocks:
        program, script = block.command.split()[:2]
        assert program == "trailmark" or (REPOSITORY / script).exists() or script == "-m", block
