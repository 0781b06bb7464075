"""Whatever a method of a part does, the run ends with an error that names both, and leaves what is known."""

from __future__ import annotations

import json
import signal
import threading
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import trailmark
from trailmark.cli.errors import exit_code_of
from trailmark.errors import RunError
from trailmark.pipeline import RunResult
from trailmark.plugins import Plugins, load_plugins

_FILE = Path(__file__).with_name("wicked.py")

#: The parts as errors call them, and their methods; those that answer, with answers that are not theirs.
_LIFE = ("__init__", "start", "close")
_METHODS: dict[str, tuple[str, ...]] = {
    "source": (*_LIFE, "sensors", "frames", "next", "counters", "accepts", "drive"),
    "fault": (*_LIFE, "believed", "apply", "counters"),
    "localizer": (*_LIFE, "observe", "latency_s", "counters", "finish"),
    "estimator": (*_LIFE, "apply", "belief", "counters"),
    "controller": (*_LIFE, "gives", "step"),
    "path_store": (*(*_LIFE, "path", "localizer_map", "append", "commit", "mark_finished", "set_sensors", "set_meta"),),
    "sink": (*_LIFE, "on_frame", "on_estimate_record", "on_belief", "on_command", "on_end"),
}
_ILL_TYPED: dict[tuple[str, str], tuple[str, ...]] = {
    ("source", "sensors"): ("none", "object", "text", "list"),
    ("source", "frames"): ("none", "object", "text", "list"),
    ("source", "next"): ("object", "text", "list"),
    ("source", "counters"): ("none", "object", "text", "list", "counts"),
    ("source", "accepts"): ("none", "object"),
    ("fault", "believed"): ("none", "object", "text"),
    ("fault", "apply"): ("object", "text", "list"),
    ("fault", "counters"): ("none", "object", "text", "counts"),
    ("localizer", "observe"): ("none", "object", "text", "list", "counts", "class", "complex", "mute", "bare"),
    ("localizer", "latency_s"): ("object", "text", "list"),
    ("localizer", "counters"): ("none", "object", "text", "list", "counts"),
    ("estimator", "apply"): ("none", "object", "text"),
    ("estimator", "belief"): ("none", "object", "text", "complex belief", "far belief"),
    ("estimator", "counters"): ("none", "object", "text", "counts"),
    ("controller", "gives"): ("none", "object"),
    ("controller", "step"): ("none", "object", "text", "class"),
    ("path_store", "path"): ("object", "text"),
    ("path_store", "localizer_map"): ("none", "object", "text"),
}
#: What is told of a method under another name.
_TOLD = {"__init__": "constructed", "next": "frames", "save": "add"}
_RAISES = ("error", "exit", "interrupt", "plain")
_RARE = ("no words", "no str", "exit 3", "cancelled", "generator", "stop", "base", "shape", "endless")
_CASES = [
    *((kind, method, deed) for kind, methods in _METHODS.items() for method in methods for deed in _RAISES),
    *(("localizer", "observe", deed) for deed in _RARE),
    *(("source", "next", deed) for deed in _RARE),
    *((kind, method, deed) for (kind, method), deeds in _ILL_TYPED.items() for deed in deeds),
    ("path_store", "add", "disk full"),
    ("path_store", "save", "disk full"),
]


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return load_plugins(files=[_FILE])


@pytest.fixture(autouse=True)
def _without_provenance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Versions and git take most of the time of so short a run."""
    for room in ("outputs.recorder", "teaching.taught_map"):
        monkeypatch.setattr(f"trailmark.pipeline.{room}.provenance", lambda base_dir: {})


@pytest.fixture
def log(plugins: Plugins) -> list[str]:
    log: list[str] = _module(plugins).LOG
    log.clear()
    return log


def _module(plugins: Plugins) -> ModuleType:
    import sys

    return sys.modules[plugins.registry.find("sink", "wicked").load().__module__]


def config_of(kind: str, method: str, deed: str, **localizer: Any) -> dict[str, Any]:
    """Return a config of a part of each kind, one of which misbehaves."""
    keys: dict[str, dict[str, Any]] = {name: {"plugin": "wicked"} for name in _METHODS}
    keys["fault"] = {}
    keys["localizer"] |= localizer
    keys[kind] |= {"method": method, "deed": deed}
    return {
        "mode": "teach",
        "sources": {"robot": keys["source"] | {"perturb": {"wicked": keys["fault"]}}},
        "localizers": {"floor": keys["localizer"]},
        "estimator": keys["estimator"],
        "path_store": keys["path_store"],
        "controller": keys["controller"],
        "sinks": [keys["sink"]],
    }


def run(config: Mapping[str, Any], out: Path, plugins: Plugins) -> RunResult:
    return trailmark.run(config, out, report=False, plugins=plugins)


def assert_told(error: BaseException, kind: str, method: str, capsys: pytest.CaptureFixture[str]) -> None:
    """See that an error means exit code 1, names part and method, and is not called a bug of ours."""
    assert exit_code_of(error) == 1
    told = capsys.readouterr().err
    assert {"source": "robot"}.get(kind, kind) in told.replace("path store", "path_store")
    assert _TOLD.get(method, method) in told
    assert "This is a bug" not in told


def assert_closed_once(log: list[str]) -> None:
    """See that every part that was started is closed, and once."""
    n = Counter(log)
    for kind in _METHODS:
        assert n[f"{kind} close"] == n[f"{kind} start"], kind


@pytest.mark.parametrize(("kind", "method", "deed"), _CASES)
def test_the_run_fails_naming_part_and_method(
    kind: str,
    method: str,
    deed: str,
    *,
    plugins: Plugins,
    log: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(RunError) as caught:
        run(config_of(kind, method, deed), tmp_path / "out", plugins)

    assert_told(caught.value, kind, method, capsys)
    assert_closed_once(log)
    if "source next" in log:  # it was under way
        about = json.loads((tmp_path / "out/run.json").read_text())
        assert about["status"] == "failed"
        assert about["reason"] in str(caught.value)
        assert (tmp_path / "out/trajectories/fused.tum").stat().st_size > 0


_ASYNC = {"async": True}


@pytest.mark.parametrize("pace", ["step", "realtime"])
@pytest.mark.parametrize(
    ("method", "deed"),
    [
        *(("observe", deed) for deed in ("error", "exit", "interrupt", "base", "none", "list", "many")),
        *(("counters", deed) for deed in ("exit", "counts")),
        *((method, "interrupt") for method in ("__init__", "start", "finish", "close")),
    ],
)
def test_beside_the_run_it_is_the_same(
    method: str,
    deed: str,
    pace: str,
    *,
    plugins: Plugins,
    log: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = config_of("localizer", method, deed, **_ASYNC) | {"pace": pace}
    with pytest.raises(RunError) as caught:
        run(config, tmp_path / "out", plugins)

    assert_told(caught.value, "localizer", method, capsys)
    assert_closed_once(log)


@pytest.mark.parametrize("options", [{}, _ASYNC], ids=["waited for", "beside the run"])
@pytest.mark.parametrize(
    ("method", "deed"), [(method, "exit") for method in ("observe", "latency_s", "counters", "finish", "close")]
)
def test_a_localizer_that_may_be_switched_off_costs_no_run(
    method: str, deed: str, options: dict[str, Any], *, plugins: Plugins, log: list[str], tmp_path: Path, caplog: Any
) -> None:
    config = config_of("localizer", method, deed, on_error="disable", **options)
    config["localizers"]["other"] = {"plugin": "wicked"}
    config["estimator"]["use"] = ["floor", "other"]

    result = run(config, tmp_path / "out", plugins)

    assert result.status == "done"
    assert f"localizer 'floor' failed in {method}" in caplog.text
    assert_closed_once(log)


def test_what_is_no_misbehaviour_is_none(plugins: Plugins, log: list[str], tmp_path: Path) -> None:
    result = run(config_of("sink", "", ""), tmp_path / "out", plugins)

    assert result.status == "done"
    assert result.counters["localizer.floor.accepted"] == 11
    assert_closed_once(log)


def test_a_count_of_the_parts_own_adds_to_none_of_the_pipelines(
    plugins: Plugins, log: list[str], tmp_path: Path
) -> None:
    result = run(config_of("sink", "", ""), tmp_path / "out", plugins)

    assert "localizer.floor.lost" not in result.counters  # it never said Lost
    assert result.counters["localizer.floor.own.lost"] == 3


def test_ground_truth_that_fails_is_a_warning(plugins: Plugins, log: list[str], tmp_path: Path, caplog: Any) -> None:
    result = run(config_of("source", "ground_truth", "exit"), tmp_path / "out", plugins)

    assert result.status == "done"
    assert "source 'robot' gives no ground truth: SystemExit: 0" in caplog.text


def test_ground_truth_that_is_none_is_a_warning(plugins: Plugins, log: list[str], tmp_path: Path, caplog: Any) -> None:
    result = run(config_of("source", "ground_truth", "text"), tmp_path / "out", plugins)

    assert result.status == "done"
    assert "source 'robot' gives no ground truth: TypeError: it gave str, not a Trajectory" in caplog.text


_SLOW = [
    ("source", "next"),
    ("localizer", "observe"),
    ("sink", "on_frame"),
    ("path_store", "commit"),
    ("fault", "apply"),
]


@pytest.mark.parametrize("deed", ["wait", "spin"])
@pytest.mark.parametrize(("kind", "method"), _SLOW)
def test_a_part_that_does_not_come_back_is_interrupted(
    kind: str,
    method: str,
    deed: str,
    *,
    plugins: Plugins,
    log: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = signal.getsignal(signal.SIGURG)
    with pytest.raises(RunError, match="it has not come back for too long") as caught:
        run(config_of(kind, method, deed) | {"patience_s": 0.5}, tmp_path / "out", plugins)

    assert_told(caught.value, kind, method, capsys)
    assert_closed_once(log)
    assert signal.getsignal(signal.SIGURG) == before


@pytest.mark.parametrize(("kind", "method"), [("source", "next"), ("fault", "apply"), ("localizer", "observe")])
def test_in_real_time_too(kind: str, method: str, plugins: Plugins, log: list[str], tmp_path: Path) -> None:
    config = config_of(kind, method, "wait") | {"patience_s": 0.25, "pace": "realtime"}

    with pytest.raises(RunError, match="it has not come back for too long"):
        run(config, tmp_path / "out", plugins)


def test_in_a_thread_of_a_program_what_spins_is_interrupted(plugins: Plugins, log: list[str], tmp_path: Path) -> None:
    told: list[BaseException] = []

    def drive() -> None:
        try:
            run(config_of("localizer", "observe", "spin") | {"patience_s": 0.5}, tmp_path / "out", plugins)
        except RunError as error:
            told.append(error)

    thread = threading.Thread(target=drive, daemon=True)
    thread.start()
    thread.join(20.0)

    assert "localizer 'floor' failed in observe" in str(told)
    assert "it has not come back" in str(told)


@pytest.mark.parametrize("options", [{}, _ASYNC], ids=["waited for", "beside the run"])
def test_one_that_may_be_switched_off_and_hangs_is_left_behind(
    options: dict[str, Any], *, plugins: Plugins, log: list[str], tmp_path: Path, caplog: Any
) -> None:
    config = config_of("localizer", "observe", "wait", on_error="disable", **options)
    config["localizers"]["other"] = {"plugin": "wicked"}
    config["estimator"]["use"] = ["floor", "other"]

    result = run(config | {"patience_s": 0.4, "pace": "realtime"}, tmp_path / "out", plugins)

    assert result.status == "done"
    assert "localizer 'floor' failed in observe" in caplog.text
    assert "it has not come back" in caplog.text
    assert "it is switched off (on_error: disable)" in caplog.text


def test_a_thread_that_hangs_ends_the_run(plugins: Plugins, log: list[str], tmp_path: Path) -> None:
    config = config_of("localizer", "observe", "wait", **_ASYNC) | {"patience_s": 0.4, "pace": "realtime"}
    with pytest.raises(RunError, match=r"failed in observe: it has not come back for 0\.4 s") as caught:
        run(config, tmp_path / "out", plugins)

    assert exit_code_of(caught.value) == 1
    assert json.loads((tmp_path / "out/run.json").read_text())["status"] == "failed"
