"""``trailmark data``: recordings that plugins name, from a folder with some of them, whole and damaged."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import pytest

from trailmark.cli import main
from trailmark.config.yaml_text import read_yaml
from trailmark.datasets import Dataset, digest_of
from trailmark.plugins import load_plugins

_NUMBERS = itertools.count()

TABLE = "t,x,y,theta\n" + "".join(f"{0.1 * i:.1f},{0.02 * i:.2f},0,0\n" for i in range(30))
PLUGIN = """
from trailmark import hookimpl
from trailmark.datasets import Dataset

def wheels(name, digest="", **about):
    wheels = {{"plugin": "csv_odometry", "path": "{{data}}/" + name}}
    return Dataset("Wheels of " + name, {{name: digest}},
                   {{"sources": {{"wheels": wheels}}, "localizers": {{"wheels": {{"plugin": "odometry"}}}}}}, **about)

WHOLE = wheels("whole.csv", "{digest}", licence="CC0", cite="Nobody 2001", url="https://example.org")
ABSENT = wheels("absent.csv")
UNTRUE = wheels("untrue.csv", truth="motion capture")
EMPTY = wheels("empty.csv")

@hookimpl
def trailmark_register(registry):
    for name in ("whole", "absent", "untrue", "empty"):
        registry.dataset(name, f":{{name.upper()}}", summary=name)
"""


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of recordings, and beside it a plugin that names four."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "whole.csv").write_text(TABLE)
    (folder / "untrue.csv").write_text(TABLE)
    (folder / "empty.csv").write_text("t,x,y,theta\n")
    plugin = tmp_path / f"sets_{next(_NUMBERS)}.py"  # a process loads a plugin of one name from one file
    plugin.write_text(PLUGIN.format(digest=digest_of(folder / "whole.csv")))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TRAILMARK_DATA", raising=False)
    return folder


def call(*words: str) -> int:
    """Run `trailmark --plugin PLUGIN data ...` in the folder of the plugin, and return its exit code."""
    (plugin,) = Path().glob("sets_*.py")
    with pytest.raises(SystemExit) as left:
        main(["--plugin", f"./{plugin}", "data", *words])
    return int(left.value.code or 0)


def test_the_list_says_what_is_here(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list", "--json", "--data", str(recordings)) == 0

    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert {name: rows[name]["here"] for name in ("whole", "absent", "untrue", "aces")} == {
        "whole": True,
        "absent": False,
        "untrue": True,
        "aces": False,
    }
    assert rows["whole"]["licence"] == "CC0"


def test_without_a_folder_the_list_says_how_to_name_it(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("list") == 0

    said = capsys.readouterr()
    assert "whole" in said.out
    assert "set TRAILMARK_DATA" in said.err


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("whole", 0, "whole     whole"),
        ("absent", 1, "not here: absent.csv"),
        ("untrue", 1, "its ground truth is missing"),
        ("empty", 1, "gave no frame"),
    ],
)
def test_a_recording_is_checked(
    recordings: Path, capsys: pytest.CaptureFixture[str], name: str, code: int, said: str
) -> None:
    assert call("check", name, "--data", str(recordings)) == code

    assert said in capsys.readouterr().out


def test_a_changed_byte_is_found(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (recordings / "whole.csv").write_text(TABLE.replace("0.02", "0.03"))

    assert call("check", "whole", "--data", str(recordings)) == 1

    assert "not the file that it was tried with: whole.csv" in capsys.readouterr().out


def test_all_that_are_here_are_checked_and_what_is_not_is_no_fault(
    recordings: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (recordings / "untrue.csv").unlink()
    (recordings / "empty.csv").unlink()

    assert call("check", "--data", str(recordings)) == 0

    assert "not here  absent" in capsys.readouterr().out


def test_a_folder_with_none_of_them_is_refused(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "nothing").mkdir()

    assert call("check", "--data", str(tmp_path / "nothing")) == 2

    assert "recordings is below" in capsys.readouterr().err


def test_an_unknown_name_gets_the_nearest(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "whol") == 2

    assert "did you mean 'whole'" in capsys.readouterr().err


def test_what_is_shown_is_a_config_that_runs(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "whole", "--config", "--data", str(recordings)) == 0

    config = read_yaml(capsys.readouterr().out)[0]
    assert config["sources"]["wheels"]["path"] == str(recordings / "whole.csv")


def test_without_a_folder_the_config_names_the_variable(recordings: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("show", "whole", "--config") == 0

    assert "path: ${TRAILMARK_DATA}/whole.csv" in capsys.readouterr().out


def test_a_folder_of_files_has_a_digest_of_names_and_contents(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a/one").write_text("1")
    before = digest_of(tmp_path)
    (tmp_path / "a/one").rename(tmp_path / "a/two")

    assert digest_of(tmp_path) != before


@pytest.mark.parametrize("spec", load_plugins().registry.specs("dataset"), ids=lambda spec: spec.name)
def test_every_known_recording_plays_from_the_files_that_it_names(spec, tmp_path: Path) -> None:
    known = spec.load()
    assert isinstance(known, Dataset)
    assert known.files
    assert all(len(digest) == 64 for digest in known.files.values())
    assert known.cite
    assert known.url
    assert known.missing(tmp_path) == tuple(known.files)
    used = json.dumps(known.config_in(Path("/data")))
    assert f"/data/{next(iter(known.files))}" in used


@pytest.mark.slow
@pytest.mark.data
def test_all_shared_recordings_are_whole(data_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["data", "check", "--data", str(data_folder)])

    assert not left.value.code, capsys.readouterr().out
