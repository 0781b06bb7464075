"""A run with its page: Stop on the page is Ctrl-C, the page ends with the run, and keeps it from nothing."""

from __future__ import annotations

import json
import re
import signal
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from click.testing import CliRunner

from trailmark.cli.run import run_command
from trailmark.cli.watch import watch_command
from trailmark.errors import ConfigError, DataError
from trailmark.watching.server import listen

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="ends are waited for by pidfd")


def ask(url: str, method: str = "GET", **headers: str) -> bytes:
    request = urllib.request.Request(url, method=method, headers=headers)
    with urllib.request.urlopen(request, timeout=60.0) as answer:
        content: bytes = answer.read()
    return content


def page_of(run: int) -> Path:
    """Return the process that serves the page of a run, as a folder of the system."""
    children = Path(f"/proc/{run}/task/{run}/children").read_text().split()
    (page,) = (child for child in children if b"watching.beside" in Path(f"/proc/{child}/cmdline").read_bytes())
    return Path("/proc") / page


def wait_until_gone(process: Path) -> None:
    until_s = time.monotonic() + 30.0
    while process.exists():
        assert time.monotonic() < until_s, "the page outlives its run"
        time.sleep(0.05)


def test_stop_on_the_page_is_ctrl_c(start, tmp_path: Path) -> None:
    child = start("run", "c.yaml", "--out", "out", "--watch", "--progress", "none")
    url = re.findall(r"watch it at (http://127\.0\.0\.1:\d+/\S+/)", child.process.stderr.readline().decode())[0]
    child.wait_for(lambda: child.is_under_way)
    page = ask(url).decode()
    while b'"status":"running"' not in (state := ask(f"{url}state?after=-1")):
        time.sleep(0.05)
    assert json.loads(state)["can"] == ["stop"]
    served = page_of(child.process.pid)
    token = re.findall(r'data-secret="([^"]+)"', page)[0]

    child.send(0)
    ask(f"{url}press/stop", "POST", **{"X-Trailmark-Token": token, "Content-Length": "0"})
    assert child.end() == 130

    assert "drive Stop" in "\n".join(child.told())
    assert child.told()[-1] == "close"
    assert child.run_document()["status"] == "interrupted"
    assert child.took_less_than(2.0)
    wait_until_gone(served)


def test_a_killed_run_takes_its_page_with_it(start) -> None:
    child = start("run", "c.yaml", "--out", "out", "--watch", "--progress", "none")
    child.process.stderr.readline()
    child.wait_for(lambda: child.is_under_way)
    served = page_of(child.process.pid)

    child.send(signal.SIGKILL)
    child.process.wait()

    wait_until_gone(served)


def test_a_taken_port_is_a_line_before_anything_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text("sources: {robot: {plugin: sim, world: ground_course, sensors: [wheels]}}")
    Path("run").mkdir()
    Path("run/run.json").write_text('{"status": "running"}')
    with listen(0) as taken:
        port = str(taken.getsockname()[1])
        for command, words in (
            (run_command, ["c.yaml", "--out", "out", "--watch", "--port", port]),
            (watch_command, ["run", "--page", "--port", port]),
            (watch_command, ["c.yaml", "--store", "p.trail", "--port", port]),
        ):
            result = CliRunner().invoke(command, words, standalone_mode=False)
            assert isinstance(result.exception, ConfigError), result.exception  # which main() answers with exit code 2
            assert re.fullmatch(rf"--port {port}: [^\n]*", str(result.exception))
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["c.yaml"], "--store is missing"),
        (["c.yaml", "--store", "p.trail"], "has no robot"),
        (["ended", "--page"], "has ended: 'trailmark report ended' makes its report"),
        (["told", "--page"], "has ended: open told/report.html"),
        (["ended", "--store", "p.trail"], "for the config of a robot"),
        (["nowhere", "--page"], "no folder nowhere"),
    ],
)
def test_what_cannot_be_watched_is_said(
    words: list[str], what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text("sources: {film: {plugin: camera}}")
    for folder in ("ended", "told"):
        Path(folder).mkdir()
        Path(folder, "run.json").write_text('{"status": "done"}')
    Path("told/report.html").touch()

    result = CliRunner().invoke(watch_command, words, standalone_mode=False)

    assert isinstance(result.exception, ConfigError | DataError)
    assert what in str(result.exception)


def test_a_port_without_a_page_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.yaml").write_text("sources: {robot: {plugin: sim, world: ground_course, sensors: [wheels]}}")

    result = CliRunner().invoke(run_command, ["c.yaml", "--port", "8000"], standalone_mode=False)

    assert "--port is of the page" in str(result.exception)
