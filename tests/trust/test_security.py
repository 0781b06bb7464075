"""What a stranger's files may not do: run code, write elsewhere, speak in the reports. Memory: `test_bombs.py`.

docs/security.md says the same in words, with the names of these tests.
"""

from __future__ import annotations

import ast
import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tests.trust.conftest import WHEELS

from trailmark.errors import ConfigError, DataError, ShapeError
from trailmark.frames import SensorInfo
from trailmark.interfaces import Session
from trailmark.pipeline.outputs.provenance import git_describe
from trailmark_bench import Cell, Index, Outcome
from trailmark_bench.merge import merge_benches
from trailmark_bench.page import write_page

ROOT = Path(__file__).parents[2]
CODE = [path for folder in ("core", "plugins") for path in sorted((ROOT / folder).rglob("*.py"))]


def command(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the program as a user does."""
    line = [sys.executable, "-P", "-m", "trailmark.cli", *map(str, arguments)]
    return subprocess.run(
        line, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """Every module of ours, by its path."""
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in CODE}


# Code that is not ours ------------------------------------------------------------------------------------------------


@cache
def nodes(tree: ast.AST) -> list[ast.AST]:
    """Return what calls or imports."""
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call | ast.Import | ast.ImportFrom)]


def calls(tree: ast.AST) -> list[tuple[str, ast.Call]]:
    """Return calls, each with the dotted name of what is called."""
    return [(dotted(node.func), node) for node in nodes(tree) if isinstance(node, ast.Call)]


def dotted(node: ast.expr) -> str:
    """Return a dotted name; of what is no name, as an item or an answer, what is asked of it, after the dot."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def test_nothing_unpickles_evaluates_or_runs_text(trees: dict[str, ast.Module]) -> None:
    """No module that unpickles, no eval or exec, no shell."""
    modules = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "runpy", "code"}
    modules |= {"yaml", "imp"}  # PyYAML has loaders that make objects
    functions = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "os.execv", "pandas.read_pickle"}
    told = {"shell", "allow_pickle", "typ"}
    found = []
    for name, tree in trees.items():
        for node in nodes(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            found += [f"{name} imports {one}" for one in names if one.partition(".")[0] in modules]
        for called, node in calls(tree):
            keys = {key.arg: ast.unparse(key.value) for key in node.keywords if key.arg in told}
            if called in functions or keys.get("shell", "False") != "False":
                found.append(f"{name} calls {called}")
            if called in ("np.load", "numpy.load") and keys.get("allow_pickle") != "False":
                found.append(f"{name} loads arrays that may hold objects")
            if called in ("YAML", "ruamel.yaml.YAML") and keys.get("typ") != "'safe'":
                found.append(f"{name} reads YAML that may make objects")

    assert found == []


def test_modules_are_imported_by_name_in_few_places(trees: dict[str, ast.Module]) -> None:
    """Each of them takes the name from code, from a registration, or from the entry points of a distribution."""
    sharing = "core/trailmark/isolation/compiling.py"  # the simulator has a module of the same name
    places = {
        name.rpartition("/")[2] if name != sharing else sharing
        for name, tree in trees.items()
        for called, _ in calls(tree)
        if called.rpartition(".")[2] in ("import_module", "exec_module", "spec_from_file_location")
    }

    # Names that stand in the module itself, or in its caller.
    lazy = {"__init__.py", "root.py", "catalogue.py", "deprecation.py", "lazy.py", "notebook.py"}
    # What a bench names to a process of its own, and a first start to the one that compiles with it: notes in a folder
    # that nobody else can write to.
    warm = {"warm_main.py", sharing}
    assert places <= lazy | warm | {"spec.py", "candidates.py", "plain.py", "call.py"}


@pytest.mark.parametrize(
    "text",
    [
        "seed: !!python/object/apply:os.system ['touch ran']\n",
        "seed: !!python/name:os.system\n",
        "localizers: {a: {plugin: 'os:system'}}\n",
        "localizers: {a: {plugin: ./evil.py}}\n",
        "localizers: {a: {plugin: evil:Evil}}\n",
        "plugins: {files: [evil.py]}\n",
    ],
)
def test_a_config_names_no_code(wheels: Path, text: str) -> None:
    (wheels / "evil.py").write_text("open('ran', 'w')\n")
    (wheels / "config.yaml").write_text(text)

    done = command("run", "config.yaml", "--out", "out", cwd=wheels)

    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert not (wheels / "ran").exists()


def test_code_beside_a_config_is_not_imported(wheels: Path) -> None:
    """Neither a module with the name of a library, nor what looks like an installed plugin."""
    for name in ("numpy", "cv2", "trailmark_evil", "sitecustomize", "conftest"):
        (wheels / f"{name}.py").write_text(f"open({str(wheels / 'ran')!r}, 'w')\n")
    info = wheels / "trailmark_evil-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: trailmark-evil\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[trailmark]\nevil = trailmark_evil\n")

    done = command("run", "config.yaml", "--out", "out", "--no-report", cwd=wheels)

    assert done.returncode == 0, done.stderr
    assert not (wheels / "ran").exists()


def test_a_cell_does_not_import_what_lies_where_the_bench_was_started(wheels: Path) -> None:
    (wheels / "numpy.py").write_text(f"open({str(wheels / 'ran')!r}, 'w')\n")
    (wheels / "bench.yaml").write_text(WHEELS + "bench: {code: version, cells: {seeds: 1}}\n")

    done = command("bench", "bench.yaml", "--out", "out", "--no-report", "--json", cwd=wheels)

    assert '"ok"' in done.stdout, done.stderr
    assert not (wheels / "ran").exists()


@pytest.mark.parametrize("how", ["fsmonitor", "filter"])
def test_a_repository_around_a_config_runs_no_commands(tmp_path: Path, how: str) -> None:
    theirs, ran = tmp_path / "theirs", tmp_path / "ran"
    theirs.mkdir()
    (theirs / "config.yaml").write_text(WHEELS)
    (theirs / ".gitattributes").write_text("*.yaml filter=evil\n" if how == "filter" else "")
    git = ["git", "-C", str(theirs), "-c", "user.name=t", "-c", "user.email=t@example.org"]
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-qm", "one"]):
        subprocess.run([*git, *arguments], check=True)
    key = {"fsmonitor": "core.fsmonitor", "filter": "filter.evil.clean"}[how]
    subprocess.run([*git, "config", key, f"touch {ran}; cat"], check=True)
    os.utime(theirs / "config.yaml", (1, 1))

    assert git_describe(theirs) is not None
    assert not ran.exists()

    subprocess.run([*git, "describe", "--always", "--dirty"], check=False, capture_output=True, timeout=20)
    assert ran.exists()  # git itself would have run it


def test_a_name_of_a_message_type_does_not_become_code(tmp_path: Path) -> None:
    """The library that reads bags makes Python source of their message definitions."""
    rosbags = pytest.importorskip("rosbags.typesys")
    ran = tmp_path / "ran"
    payloads = [
        (f"int32 x\n', open({str(ran)!r}, 'w'), '\n", "a/msg/B"),
        ("int32 x\n", f"a/msg/B:\n    open({str(ran)!r}, 'w')\nclass C"),
        (f"string X='''+str(open({str(ran)!r}, 'w'))+'''\n", "a/msg/B"),
        (f"int32[__import__('os').open({str(ran)!r}, 65)] x\n", "a/msg/B"),
        (f'string X="""\n"+str(open({str(ran)!r}, "w"))+"\n', "a/msg/B"),
    ]
    for text, name in payloads:
        try:
            types = rosbags.get_types_from_msg(text, name)
            rosbags.get_typestore(rosbags.Stores.EMPTY).register(types)
        except Exception:  # refused, in whatever way
            continue
    assert not ran.exists()


# Files elsewhere ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("to", ["../elsewhere", "{elsewhere}", "~/elsewhere", "link/elsewhere"])
def test_a_config_writes_only_in_its_folder(wheels: Path, tmp_path: Path, to: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    (wheels / "link").symlink_to(tmp_path)
    text = WHEELS + f"sinks: [{{plugin: jsonl, to: '{to.format(elsewhere=elsewhere)}'}}]\n"
    (wheels / "config.yaml").write_text(text)

    done = command("run", "config.yaml", "--out", "out", cwd=wheels, HOME=str(tmp_path))

    assert done.returncode == 2
    assert "lies outside of the config's folder; to write there, say --set sinks.0.to=" in done.stderr
    assert elsewhere.read_text() == "mine"


def test_the_user_may_write_anywhere(wheels: Path, tmp_path: Path) -> None:
    (wheels / "config.yaml").write_text(WHEELS + "sinks: [{plugin: jsonl, to: here.jsonl}]\n")
    elsewhere = tmp_path / "said.jsonl"

    done = command("run", "config.yaml", "--out", "out", "--no-report", "--set", f"sinks.0.to={elsewhere}", cwd=wheels)

    assert done.returncode == 0, done.stderr
    assert elsewhere.exists()


@pytest.mark.parametrize("name", ["../x", "/x", "a/b", "..", "x\0y"])
def test_a_sensor_is_not_called_like_a_path(name: str) -> None:
    """Names of sensors become names of files when a recording is written."""
    with pytest.raises(ShapeError, match="use lower-case letters"):
        SensorInfo(name, "image")


def bench(folder: Path, address: str = "a" * 20) -> Path:
    """Make a bench with one finished cell."""
    with Index(folder, write=True) as index:
        index.enter([Cell("a" * 20, "", {"localizer": "<img src=x onerror=alert(1)>", "seed": 1}, {})])
        index.mark_finished(
            "a" * 20, Outcome("failed", "</script><script>alert(1)</script>"), {"metrics": {"<b>": 1.0}}
        )
    place = folder / "cells" / ("a" * 20)
    place.mkdir(parents=True)
    (place / "result.json").write_text("{}")
    with closing(sqlite3.connect(folder / "index.sqlite")) as connection:
        connection.execute("UPDATE cells SET id = ?", (address,))
        connection.commit()
    return folder


@pytest.mark.parametrize("address", ["../../victim", "/tmp/victim", "..", "", "a/../../../victim"])
def test_a_bench_that_is_merged_replaces_nothing_elsewhere(tmp_path: Path, address: str) -> None:
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "mine").touch()
    theirs = bench(tmp_path / "theirs", address)

    with pytest.raises(DataError, match="no cell is called"):
        merge_benches([theirs], tmp_path / "out")

    assert [file.name for file in victim.iterdir()] == ["mine"]


def test_links_and_pipes_of_a_bench_are_not_merged(tmp_path: Path) -> None:
    theirs = bench(tmp_path / "theirs")
    cell = theirs / "cells" / ("a" * 20)
    (tmp_path / "secret").write_text("mine")
    (cell / "link").symlink_to(tmp_path / "secret")
    (cell / "folder").symlink_to(tmp_path)
    (cell / "endless").symlink_to("/dev/zero")
    os.mkfifo(cell / "pipe")

    merge_benches([theirs], tmp_path / "out")

    merged = tmp_path / "out" / "cells" / ("a" * 20)
    assert [file.name for file in merged.iterdir()] == ["result.json"]


@pytest.mark.parametrize("name", ["index.sqlite", ".lock", "cells"])
def test_a_bench_is_not_written_through_a_link(tmp_path: Path, name: str) -> None:
    theirs, victim = tmp_path / "theirs", tmp_path / "victim"
    theirs.mkdir()
    victim.write_text("mine")
    (theirs / name).symlink_to(victim)

    with pytest.raises(ConfigError, match="is a link"):
        Index(theirs, write=True)

    assert victim.read_text() == "mine"


def test_a_report_is_not_written_through_a_link(tmp_path: Path) -> None:
    theirs, victim = bench(tmp_path / "theirs"), tmp_path / "victim"
    victim.write_text("mine")
    (theirs / "report.html").symlink_to(victim)

    with Index(theirs) as index:
        write_page(index)

    assert victim.read_text() == "mine"
    assert not (theirs / "report.html").is_symlink()


@pytest.mark.parametrize("name", ["../x", "/x", "x/../../y", "..", "${HOME}"])
def test_a_new_plugin_lies_where_it_was_asked_for(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "here"
    folder.mkdir()

    done = command("plugins", "new", name, "--into", ".", cwd=folder)

    assert done.returncode == 2
    assert os.listdir(folder) == []
    assert os.listdir(tmp_path) == ["here"]


# Reports --------------------------------------------------------------------------------------------------------------


class Tags(HTMLParser):
    """The tags of a page and the handlers on them; what stands in scripts is no tag."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.handlers: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]


def test_names_in_the_page_of_a_bench_are_text(tmp_path: Path) -> None:
    with Index(bench(tmp_path)) as index:
        text = write_page(index).read_text(encoding="utf-8")
    page = Tags(text)

    assert page.handlers == []
    assert not {"img", "b", "iframe", "object", "link"} & set(page.tags)
    assert page.tags.count("script") == text.count("</script>")
    assert "alert(1)</script>" not in text
    assert "script-src 'sha256-" in text  # the page's own and no other


def test_names_in_the_report_of_a_run_are_text(wheels: Path) -> None:
    evil = "</style><script>alert(1)</script><img src=x onerror=alert(1)>"
    (wheels / "config.yaml").write_text(WHEELS + f"# {evil}\n")
    name = "a<img src=x onerror=alert(1)>b"

    done = command("run", "config.yaml", "--out", name, cwd=wheels)

    assert done.returncode == 0, done.stderr
    text = (wheels / name / "report.html").read_text(encoding="utf-8")
    page = Tags(text)
    assert page.handlers == []
    assert "img" not in page.tags
    assert page.tags.count("script") == text.count("</script>") == 2  # the data, and our program
    assert "<script>alert(1)" not in text


def test_a_session_needs_no_network(wheels: Path, trees: dict[str, ast.Module]) -> None:
    """A run with a config from a file opens no socket: the only parts that do are asked for by name."""
    opening = {
        name
        for name, tree in trees.items()
        for called, node in calls(tree)
        if called in ("socket.socket", "socket.create_connection", "urllib.request.urlopen", "distributed.Client")
        or called.endswith("start_server")
        if "fileno" not in {key.arg for key in node.keywords}  # a pair that its parent has made, without a network
    }
    # sources, sinks and executors that a config names; the page of --watch
    asked_for = ("viewers", "dask", "trailmark_lines", "watching")
    assert all(any(part in name for part in asked_for) for name in opening)
    assert Session().mode == "track"
