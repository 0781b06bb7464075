"""What a stranger's files may not do: run code, write elsewhere, fill the memory, speak in the reports.

docs/security.md says the same in words, with the names of these tests.
"""

from __future__ import annotations

import ast
import gzip
import os
import sqlite3
import struct
import subprocess
import sys
import time
import zlib
from contextlib import closing
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.config import load_run_config
from trailmark.errors import ConfigError, DataError, ShapeError, SourceError
from trailmark.frames import SensorInfo
from trailmark.interfaces import Session
from trailmark.pipeline.outputs.provenance import git_describe
from trailmark.plugins import load_plugins
from trailmark.sources.pictures import decode_raw, read_raw
from trailmark_bench import Cell, Index, Outcome
from trailmark_bench.merge import merge_benches
from trailmark_bench.page import write_page
from trailmark_datasets.textfiles import lines_of
from trailmark_omni_surf.selection import SelectionModel, shipped_model

ROOT = Path(__file__).parents[2]
CODE = [path for folder in ("core", "plugins") for path in sorted((ROOT / folder).rglob("*.py"))]

WHEELS = "sources:\n  wheels: {plugin: csv_odometry, path: wheels.csv}\nlocalizers:\n  wheels: {plugin: odometry}\n"


def command(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the program as a user does."""
    line = [sys.executable, "-P", "-m", "trailmark.cli", *map(str, arguments)]
    return subprocess.run(
        line, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """A folder with a config and its recording."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    (folder / "wheels.csv").write_text("t,x,y,theta\n" + "".join(f"{0.1 * i},{0.1 * i},0,0\n" for i in range(30)))
    (folder / "config.yaml").write_text(WHEELS)
    return folder


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    """Every module of ours, by its path."""
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in CODE}


# Code that is not ours ------------------------------------------------------------------------------------------------


@cache
def calls(tree: ast.AST) -> list[tuple[str, ast.Call]]:
    """Return calls, each with the dotted name of what is called."""
    return [(ast.unparse(node.func), node) for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_nothing_unpickles_evaluates_or_runs_text(trees: dict[str, ast.Module]) -> None:
    """No module that unpickles, no eval or exec, no shell."""
    modules = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "runpy", "code"}
    modules |= {"yaml", "imp"}  # PyYAML has loaders that make objects
    functions = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "os.execv", "pandas.read_pickle"}
    found = []
    for name, tree in trees.items():
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            found += [f"{name} imports {one}" for one in names if one.partition(".")[0] in modules]
        for called, node in calls(tree):
            keys = {key.arg: ast.unparse(key.value) for key in node.keywords}
            if called in functions or keys.get("shell", "False") != "False":
                found.append(f"{name} calls {called}")
            if called in ("np.load", "numpy.load") and keys.get("allow_pickle") != "False":
                found.append(f"{name} loads arrays that may hold objects")
            if called in ("YAML", "ruamel.yaml.YAML") and keys.get("typ") != "'safe'":
                found.append(f"{name} reads YAML that may make objects")

    assert found == []


def test_modules_are_imported_by_name_in_few_places(trees: dict[str, ast.Module]) -> None:
    """Each of them takes the name from code, from a registration, or from the entry points of a distribution."""
    places = {
        name.rpartition("/")[2]
        for name, tree in trees.items()
        for called, _ in calls(tree)
        if called.rpartition(".")[2] in ("import_module", "exec_module", "spec_from_file_location")
    }

    # Names that stand in the module itself, or in its caller.
    lazy = {"__init__.py", "root.py", "catalogue.py", "deprecation.py", "lazy.py", "notebook.py"}
    # What a bench names to a process of its own.
    warm = {"warm_main.py"}
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


# Much from little -----------------------------------------------------------------------------------------------------


def deflated_zeros(n: int) -> bytes:
    """Return what zlib makes of zeros: a megabyte is packed once, and its packed bytes repeated."""
    packer = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
    megabyte = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    rest = zlib.compress(bytes(n % (1 << 20)), 9, wbits=-zlib.MAX_WBITS)
    adler32 = (n % 65521) << 16 | 1
    return b"\x78\xda" + megabyte * (n >> 20) + rest + adler32.to_bytes(4, "big")


def png(width: int, height: int) -> bytes:
    """Return a PNG of one colour that says it is of a size, with all of its data."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    data = deflated_zeros((1 + width) * min(height, 300))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def tiff(width: int, height: int) -> bytes:
    """Return a TIFF of one strip that says it is of a size."""
    tags = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1)]
    tags += [(278, 4, height), (279, 4, width * height % 2**32)]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in sorted(tags))
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0)


@pytest.mark.parametrize(
    "picture",
    [
        *(png(30000, 30000), png(2**31 - 1, 1), tiff(30000, 30000), tiff(20000, 40000)),
        *(b"P5 30000 30000 255\n", b"P7\nWIDTH 30000\nHEIGHT 30000\nDEPTH 1\nMAXVAL 255\nENDHDR\n" + bytes(100)),
        *(b"BM" + bytes(16) + struct.pack("<ii", 30000, -30000) + bytes(100), b"Pf\n30000 30000\n-1.0\n" + bytes(100)),
    ],
    ids=["png", "png-long", "tiff", "tiff-wide", "pgm", "pam", "bmp", "pfm"],
)
def test_a_picture_that_announces_gigabytes_is_refused(picture: bytes) -> None:
    began_s = time.thread_time()

    with pytest.raises(SourceError):
        decode_raw(picture, "the picture")

    assert time.thread_time() - began_s < 0.5


@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_a_picture_without_end_is_not_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "0.png"
    {"device": lambda: path.symlink_to("/dev/zero"), "pipe": lambda: os.mkfifo(path), "folder": path.mkdir}[kind]()

    with pytest.raises(SourceError, match="is no file"):
        read_raw(path, "the picture")


def test_opencv_itself_refuses_what_is_too_large() -> None:
    """Also for formats whose headers are not looked at before."""
    assert int(os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"]) <= 1 << 27
    data = np.frombuffer(b"P7\nWIDTH 20000\nHEIGHT 20000\nDEPTH 1\nMAXVAL 255\nENDHDR\n" + bytes(100), np.uint8)
    with pytest.raises(cv2.error, match=r"IMAGE_PIXELS|pixels"):
        cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


def test_a_log_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.log.gz"
    with gzip.open(path, "wb", compresslevel=9) as file:
        block = (b"# " + b" " * 997 + b"\n") * 1000
        for _ in range(100):
            file.write(block)
    assert path.stat().st_size < 1 << 20

    with pytest.raises(SourceError, match="unpacks to more than 100 times its size"):
        list(lines_of(path))


def test_a_model_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "bomb.npz", tmp_path / "whole.npz"
    np.savez_compressed(path, support=np.zeros((10_000_000,), np.float64))
    shipped_model().save(whole)
    assert path.stat().st_size < 1 << 20

    with pytest.raises(ConfigError, match="unpacks to more than"):
        SelectionModel.load(path)
    np.save(tmp_path / "array.npy", np.zeros(3))
    damaged = [path.read_bytes()[:1000], (tmp_path / "array.npy").read_bytes(), whole.read_bytes()[:-30]]
    damaged.append(whole.read_bytes()[:200] + bytes(50) + whole.read_bytes()[250:])
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(ConfigError, match="is no selection model"):
            SelectionModel.load(path)


def test_aliases_of_aliases_are_no_bomb(wheels: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    (wheels / "config.yaml").write_text("\n".join(lines) + "\n" + WHEELS)
    began_s = time.thread_time()

    with pytest.raises(ConfigError) as raised:
        load_run_config(wheels / "config.yaml", plugins=load_plugins())

    assert time.thread_time() - began_s < 5.0
    assert len(str(raised.value)) < 20_000


def test_a_value_of_aliases_is_no_bomb(wheels: Path) -> None:
    lines = ["seed: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    for i, key in enumerate(("mode", "start", "pace", "control_hz", "sensors", "sinks", "controller"), 1):
        lines.append(f"{key}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]")
    (wheels / "config.yaml").write_text("\n".join(lines) + "\n" + WHEELS)
    began_s = time.thread_time()

    with pytest.raises(ConfigError) as raised:
        load_run_config(wheels / "config.yaml", plugins=load_plugins())

    assert time.thread_time() - began_s < 5.0
    assert len(str(raised.value)) < 20_000


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
