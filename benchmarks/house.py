"""The house in numbers: what a reader, a frame and a start pass through.

One row a measure, of one checkout or of two side by side::

    python benchmarks/house.py                      # this checkout
    python benchmarks/house.py --before ../old      # another one (its environment: .venv)

The counts of source come from the syntax trees of ``core`` and ``plugins``; those of a run are taken in a
process of the checkout's own interpreter, over the run that README shows (a table of wheel odometry).
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import subprocess
import sys
import tempfile
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

_KERNEL = re.compile(r"kernel|\b(njit|jit|vectorize|guvectorize|intrinsic)\b")

_WHEELS = """
import json, os, sys
from pathlib import Path
top, folder = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
os.chdir(folder)
rows = [f"{0.1 * i:.1f},{0.03 * i:.4f},0,0" for i in range(60)]
Path("wheels.csv").write_text("t,x,y,theta\\n" + "\\n".join(rows) + "\\n")
Path("wheels.yaml").write_text(
    "sources:    {wheels: {plugin: csv_odometry, path: wheels.csv}}\\nlocalizers: {wheels: {plugin: odometry}}\\n"
)
import trailmark

def ours(path):
    return path.startswith((f"{top}/core/", f"{top}/plugins/"))

passed, called = set(), set()
def note_file(frame, event, arg):
    if event == "call" and ours(frame.f_code.co_filename) and not frame.f_code.co_name.startswith("<"):
        called.add(frame.f_code.co_filename)

def profile(frame, event, arg):
    code = frame.f_code
    if event == "call" and ours(code.co_filename) and not code.co_name.startswith("<"):
        passed.add((code.co_filename, code.co_qualname))

sys.setprofile(note_file)
with trailmark.Pipeline("wheels.yaml") as pipeline:
    for index, step in enumerate(pipeline):
        sys.setprofile(profile if index == 39 else note_file)
sys.setprofile(None)
files = {m.__file__ for m in list(sys.modules.values()) if getattr(m, "__file__", None) and ours(m.__file__)}
print(json.dumps({
    "files": len(files), "called": len(called),
    "frame functions": len(passed), "frame files": len({name for name, _ in passed}),
    "names": sorted(f"{Path(name).relative_to(top)}:{function}" for name, function in passed),
    "modules": sorted(str(Path(name).relative_to(top)) for name in files),
}))
"""


def sources(top: Path) -> Iterator[tuple[Path, str, ast.Module]]:
    """Yield path, text and syntax tree of every Python file of core and plugins."""
    for part in ("core", "plugins"):
        for path in sorted((top / part).rglob("*.py")):
            text = path.read_text()
            yield path.relative_to(top), text, ast.parse(text)


def code_lines(text: str, tree: ast.Module) -> int:
    """Return the number of lines that are neither blank nor comment nor docstring."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(iter(text.splitlines(keepends=True)).__next__):
        if token.type not in (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT):
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                lines.difference_update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def n_arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return how many arguments a function takes, ``self`` and ``cls`` apart."""
    arguments = node.args
    names = [a.arg for a in (*arguments.posonlyargs, *arguments.args)]
    return len(names) + len(arguments.kwonlyargs) - (names[:1] in (["self"], ["cls"]))


def is_kernel(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether a function is compiled by numba."""
    return any(_KERNEL.search(ast.unparse(decorator)) for decorator in node.decorator_list)


def imports_between(top: Path, package: str) -> dict[str, set[str]]:
    """Return which room of a package imports which others; a room is a file or a folder directly in it."""
    home = next(top.glob(f"core/{package.replace('.', '/')}"))
    rooms: dict[str, set[str]] = {
        p.stem: set() for p in home.iterdir() if p.suffix == ".py" or (p.is_dir() and any(p.glob("*.py")))
    }
    rooms.pop("__init__", None)
    rooms.pop("__pycache__", None)
    for path in home.rglob("*.py"):
        room = path.relative_to(home).parts[0].removesuffix(".py")
        if room == "__init__":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.ImportFrom) and not node.level and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            for name in names:
                other = name.removeprefix(f"{package}.").split(".")[0] if name.startswith(f"{package}.") else room
                if other in rooms and other != room:
                    rooms[room].add(other)
    return rooms


def n_floors(rooms: dict[str, set[str]]) -> int:
    """Return the number of rooms on the longest way down; 0 where the imports close a circle."""

    def depth(room: str, above: tuple[str, ...]) -> int:
        if room in above:
            raise RecursionError
        return 1 + max((depth(other, (*above, room)) for other in rooms[room]), default=0)

    try:
        return max(depth(room, ()) for room in rooms)
    except RecursionError:
        return 0


def measure(top: Path) -> tuple[dict[str, int], dict[str, list[str]]]:
    """Return the measures of a checkout, and what stands behind each."""
    lines, classes, wide, wide_kernels = 0, defaultdict(list), [], []
    for path, text, tree in sources(top):
        lines += code_lines(text, tree)
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name.lstrip("_")].append(str(path))
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                count = n_arguments(node)
                place = f"{path}:{node.lineno} {node.name} ({count})"
                if is_kernel(node):
                    wide_kernels += [place] if count > 12 else []
                else:
                    wide += [place] if count > 8 else []
    twice = {name: places for name, places in classes.items() if len(set(places)) > 1}
    rooms = imports_between(top, "trailmark.pipeline")
    run = run_of_wheels(top)
    page = top / "docs" / "architecture.md"
    reading = page.read_text().partition("## `trailmark run`")[2].partition("\n## ")[0] if page.exists() else ""
    listed = re.findall(r"^\d+\. \[?`", reading, re.MULTILINE)
    figures = {
        "Python files of ours that README's wheels run calls": run["called"],
        "Python files of ours that README's wheels run imports": run["files"],
        "functions that one later odometry frame passes": run["frame functions"],
        "files that one later odometry frame passes": run["frame files"],
        "files to read to understand `trailmark run`": len(listed),
        "pipeline: rooms": len(rooms),
        "pipeline: floors": n_floors(rooms),
        "pipeline: arrows between rooms": sum(len(others) for others in rooms.values()),
        "functions with more than 8 arguments, kernels aside": len(wide),
        "kernels with more than 12 arguments": len(wide_kernels),
        "class names with two meanings": len(twice),
        "core + plugins, code lines": lines,
    }
    behind = {
        "functions with more than 8 arguments": sorted(wide),
        "kernels with more than 12 arguments": sorted(wide_kernels),
        "class names with two meanings": [f"{name}: {', '.join(places)}" for name, places in sorted(twice.items())],
        "passed by a frame": run["names"],
        "executed": run["modules"],
    }
    return figures, behind


def run_of_wheels(top: Path) -> dict:
    """Return what README's wheels run executes in a checkout, by the checkout's own interpreter."""
    own = top / ".venv" / "bin" / "python"
    with tempfile.TemporaryDirectory() as folder:
        command = [str(own if own.exists() else sys.executable), "-c", _WHEELS, str(top), folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"the wheels run of {top} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--before", type=Path, help="another checkout, beside this one")
    parser.add_argument("--names", action="store_true", help="say what stands behind the figures")
    options = parser.parse_args()
    now, behind = measure(Path(__file__).resolve().parents[1])
    before = measure(options.before.resolve())[0] if options.before else {}
    print("| measure | before | now |\n|---|--:|--:|" if before else "| measure | now |\n|---|--:|")
    for name, value in now.items():
        print(f"| {name} |{f' {before[name]} |' if before else ''} {value} |")
    if options.names:
        for title, names in behind.items():
            print(f"\n## {title}", *names, sep="\n")


if __name__ == "__main__":
    main()
