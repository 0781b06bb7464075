"""The recipe of the pages of results: what makes a page old, and what making it anew leaves alone."""

from __future__ import annotations

import collections
import json
import os
import subprocess
import sys
import tempfile
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
        "core/tool/__init__.py": "",
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
        ("core/tool/kernel.py", KERNEL.replace("42", "43"), "core/tool/kernel.py changed since"),
        ("core/tool/kernel.py", KERNEL.replace("About", "All about") + "\n# a comment\n", ""),
        ("core/tool/beside.py", "x = 1", ""),
        ("core/elsewhere/plugin.py", "x = 1", ""),
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


@pytest.mark.parametrize(
    ("ends", "why"), [("sys.exit(3)", "said.py ended with code 3"), ("pass", "said.py printed nothing")]
)
def test_a_command_that_fails_leaves_its_block_and_stops_no_other(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str], ends: str, why: str
) -> None:
    (checkout / "benchmarks/said.py").write_text(f"import sys; {ends}")

    assert recipe.main(["make"], checkout) == 1

    page = (checkout / "docs/results/page.md").read_text()
    assert page == "written ![](page_plot.svg)".join(PAGE.rsplit("as it was", 1))
    assert capsys.readouterr().out.splitlines()[-1] == f"page: not made: python benchmarks/{why}"


def test_code_that_changes_meanwhile_is_no_code_of_the_page(recipe: ModuleType, checkout: Path) -> None:
    meddling = "open('core/tool/kernel.py', 'a').write('x = 1')"
    (checkout / "benchmarks/said.py").write_text(SAID + meddling)

    results = recipe.Results(checkout)
    with pytest.raises(recipe.NotMadeError, match=r"core/tool/kernel.py changed while .* ran"):
        results.make(results.blocks()[0])

    assert (checkout / "docs/results/page.md").read_text() == PAGE


def test_code_that_goes_meanwhile_is_no_code_of_the_page(recipe: ModuleType, checkout: Path) -> None:
    (checkout / "benchmarks/said.py").write_text(SAID + "import os; os.remove('core/tool/kernel.py')")

    results = recipe.Results(checkout)
    with pytest.raises(recipe.NotMadeError, match=r"core/tool/kernel.py changed while .* ran"):
        results.make(results.blocks()[0])


def test_what_was_looked_for_and_never_was_there_is_no_code(recipe: ModuleType, checkout: Path) -> None:
    looks = "\ntry: open('core/tool/local.yaml')\nexcept OSError: pass\n"
    (checkout / "benchmarks/said.py").write_text(SAID + looks)

    results = recipe.Results(checkout)
    assert list(results.make(results.blocks()[0]).code) == ["benchmarks/said.py", "core/tool/kernel.py"]


@pytest.mark.parametrize("breaks", ["missing program", "half a file", "no text"])
def test_what_cannot_be_started_or_read_stops_no_other_block(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str], breaks: str
) -> None:
    page = checkout / "docs/results/page.md"
    if breaks == "missing program":
        page.write_text(PAGE.replace("python benchmarks/said.py", "no-such-program"))
    else:
        (checkout / "core/tool/half.py").write_bytes(b"def half(" if breaks == "half a file" else b"x = '\xff\0'")

    code = recipe.main(["make"], checkout)

    assert "written ![](page_plot.svg)" in page.read_text()
    assert code == int(breaks == "missing program")
    assert ("page: not made" in capsys.readouterr().out) == bool(code)


@pytest.mark.parametrize("file", ["model.json", "template.txt", "page.js", "page.css", "tour.ipynb", "floor.svg"])
def test_every_file_that_was_read_makes_a_block_old_whatever_its_kind(
    recipe: ModuleType, checkout: Path, file: str
) -> None:
    (checkout / "core/tool" / file).write_text("1")
    (checkout / "core/tool/__pycache__").mkdir()
    (checkout / "core/tool/__pycache__/cache.nbi").write_text("1")
    reads = f"open('core/tool/{file}').read(); open('core/tool/__pycache__/cache.nbi').read()\n"
    (checkout / "benchmarks/said.py").write_text(SAID + reads)
    results = recipe.Results(checkout)
    said = results.blocks()[0]
    results.make(said)

    (checkout / "core/tool/__pycache__/cache.nbi").write_text("2")
    assert not recipe.Results(checkout).why_old(said)

    (checkout / "core/tool" / file).write_text("2")
    assert recipe.Results(checkout).why_old(said).startswith(f"core/tool/{file} changed since")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become another user")
def test_a_process_that_becomes_another_user_goes_on_noting(load_script: Callable[[str], ModuleType]) -> None:
    work = load_script("benchmarks/results_work.py")
    with tempfile.TemporaryDirectory() as name:  # others may not enter the folders of pytest
        top = Path(name)
        top.chmod(0o755)
        for file in ("first.py", "then.py"):
            (top / file).write_text("")
        notes = work.Work(top / "block", "python first.py", {}).notes
        reads = "import os; open('first.py'); os.seteuid(65534); open('then.py')"
        traced = {
            "PYTHONPATH": str(REPOSITORY / "benchmarks/traced"),
            "TRAILMARK_TRACED_TOP": name,
            "TRAILMARK_TRACED_NOTES": str(notes),
        }
        subprocess.run([sys.executable, "-c", reads], env=traced, cwd=top, check=True)

        assert work.noted_paths(notes) - set(notes.iterdir()) == {top / "first.py", top / "then.py"}


def test_files_are_noted_whose_names_are_no_text(load_script: Callable[[str], ModuleType], tmp_path: Path) -> None:
    code = load_script("benchmarks/results_code.py")
    (tmp_path / "1-0").write_bytes(b"/top/first.py\n/top/caf\xe9\n")

    assert code.noted_paths(tmp_path) == {Path("/top/first.py"), Path(os.fsdecode(b"/top/caf\xe9"))}


@pytest.mark.parametrize("code", [0, 1])
def test_a_page_that_says_that_something_failed_is_put_and_fails_until_it_is_mended(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str], code: int
) -> None:
    page, said = checkout / "docs/results/page.md", checkout / "benchmarks/said.py"
    said.write_text(f"print('| said | 41')\nprint('**Failed: 1 findings.**')\nraise SystemExit({code})")

    assert recipe.main(["make"], checkout) == 1
    assert "| said | 41\n**Failed: 1 findings.**\n<!--" in page.read_text()
    assert capsys.readouterr().out.splitlines()[-1] == "page: **Failed: 1 findings.**"
    assert recipe.main(["check", "--strict"], checkout) == 1
    assert recipe.main(["make"], checkout) == 1

    said.write_text("print('| said | 42')")
    assert recipe.main(["make"], checkout) == 0
    assert recipe.main(["check", "--strict"], checkout) == 0


def test_what_knows_itself_what_holds_keeps_its_minutes_and_forgets_what_it_reads_no_more(
    recipe: ModuleType, checkout: Path
) -> None:
    (checkout / "docs/results/page.md").write_text(PAGE.replace("{out}", "{kept}"))
    written = checkout / "benchmarks/written.py"
    results = recipe.Results(checkout)
    _, block = results.blocks()
    written.write_text("open('benchmarks/other.py'); raise SystemExit(3)")
    with pytest.raises(recipe.NotMadeError):
        results.make(block)
    begun = checkout / "runs/results/page-2.begun.json"
    begun.write_text(json.dumps(json.loads(begun.read_text()) | {"minutes": 90.0}))

    written.write_text(WRITTEN)
    made = results.make(block)

    assert made.minutes >= 90.0
    assert list(made.code) == ["benchmarks/written.py"]


@pytest.mark.parametrize(("folder", "goes_on"), [("{out}", False), ("{kept}", True)])
def test_what_was_begun_with_other_code_is_begun_anew(
    recipe: ModuleType, checkout: Path, folder: str, goes_on: bool
) -> None:
    begins = "with open(sys.argv[2] + '/begun', 'a') as file: file.write('x')\n"
    page = checkout / "docs/results/page.md"
    page.write_text(PAGE.replace("{out}", folder))
    results = recipe.Results(checkout)
    _, written = results.blocks()
    for code in ("sys.exit(3)", "sys.exit(3)", "sys.exit(4)"):
        (checkout / "benchmarks/written.py").write_text(f"import sys\n{begins}{code}")
        with pytest.raises(recipe.NotMadeError):
            results.make(written)

    begun = checkout / "runs/results/page-2/begun"
    assert begun.read_text() == ("xxx" if goes_on else "x")
    with pytest.raises(recipe.NotMadeError):
        results.make(written)
    assert begun.read_text() == ("xxxx" if goes_on else "xx")


def test_a_page_that_is_read_from_pages_is_made_after_them(recipe: ModuleType, checkout: Path) -> None:
    reads = "import pathlib; print(pathlib.Path('docs/results/page.md').read_text().count('42'), 'times')"
    (checkout / "benchmarks/other.py").write_text(reads)
    summary = checkout / "docs/results/a_summary.md"
    summary.write_text("<!-- made by: python benchmarks/other.py -->\n<!-- made: end -->\n")

    assert recipe.main(["make"], checkout) == 0

    assert "1 times" in summary.read_text()
    assert recipe.main(["check", "--strict"], checkout) == 0


def test_a_page_without_a_block_says_that_it_is_written_by_hand(recipe: ModuleType, checkout: Path) -> None:
    recipe.main(["make"], checkout)
    page = checkout / "docs/results/other.md"

    page.write_text("# Other\n\nFigures of nobody.\n")
    assert recipe.main(["check", "--strict"], checkout) == 1

    page.write_text("# Other\n\nWritten by hand: a look at things.\n")
    assert recipe.main(["check", "--strict"], checkout) == 0


def test_every_page_of_ours_is_made_or_says_that_it_is_not(recipe: ModuleType) -> None:
    assert not recipe.Results(REPOSITORY).loose()


def test_what_takes_too_long_is_left_and_said(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recipe.main(["make", "--hours", "0.1"], checkout) == 0

    assert "no time for page, page-2" in capsys.readouterr().out
    assert (checkout / "docs/results/page.md").read_text() == PAGE


def test_names_may_stand_behind_the_hours(
    recipe: ModuleType, checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert recipe.main(["make", "--hours", "0.1", "page"], checkout) == 0

    assert "no time for page" in capsys.readouterr().out


def test_a_page_that_was_never_made_is_reckoned_with_and_then_measured(recipe: ModuleType) -> None:
    block = recipe.Block(Path("toth2015.md"), 0, "trailmark reproduce toth2015")
    made = recipe.Made(block.command, "1234567", "2026-11-23", 33.0)

    assert (recipe._minutes_of(block, {}),) == recipe._RECKONED_MIN["toth2015"]
    assert recipe._minutes_of(block, {"toth2015": made}) == 33.0


def test_somebody_knows_how_long_each_block_takes(recipe: ModuleType) -> None:
    blocks, made = recipe.Results(REPOSITORY).blocks(), recipe.Results(REPOSITORY).made()
    n_blocks = collections.Counter(block.page.stem for block in blocks)

    assert {page: len(minutes) for page, minutes in recipe._RECKONED_MIN.items()}.items() <= n_blocks.items()
    assert not [
        block.name for block in blocks if block.page.stem not in recipe._RECKONED_MIN and block.name not in made
    ]


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
