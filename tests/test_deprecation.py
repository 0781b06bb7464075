"""Old public names stay importable, and say what they are called now."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from collections.abc import Sequence

import pytest

from trailmark.clock import live_stamp_s
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.interfaces import LocalizerMap, Session
from trailmark.testing import MemoryMap

KALMAN = "trailmark.estimation.kalman"


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("trailmark.interfaces", "Drawer", LocalizerMap),
        (f"{KALMAN}.clock_offsets", "ClockOffset", TimeOffset),
        (f"{KALMAN}.motions", "Step", MotionStep),
        (f"{KALMAN}.state", "Consistency", FaultDiagnosis),
        (f"{KALMAN}.state", "Fault", DetectedFault),
        (f"{KALMAN}.state", "Rival", RivalFilter),
    ],
)
def test_an_old_name_is_the_new_class_and_warns(module: str, old: str, new: type) -> None:
    with pytest.warns(DeprecationWarning, match=f"{old} is called {new.__name__} now"):
        assert getattr(importlib.import_module(module), old) is new


KIT = "trailmark_papers.kit"


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("trailmark.interruption", "asked", "ending_signal"),
        (KIT, "simulated", "sim_source"),
        (KIT, "grouped", "group_by"),
        (KIT, "timed", "observe_timed"),
        (f"{KIT}.runs", "simulated", "sim_source"),
        (f"{KIT}.sweeps", "grouped", "group_by"),
        (f"{KIT}.watching", "timed", "observe_timed"),
        ("trailmark_faults.calibration", "misjudged", "with_wrong_calibration"),
        ("trailmark_faults.depth", "shifted", "shift_depth"),
    ],
)
def test_an_old_function_is_the_new_one_and_warns(module: str, old: str, new: str) -> None:
    home = importlib.import_module(module)

    with pytest.warns(DeprecationWarning, match=f"{old} is called {new} now"):
        assert getattr(home, old) is getattr(home, new)


def test_what_has_moved_says_where_it_is() -> None:
    with pytest.warns(DeprecationWarning, match="live_stamp_s is called trailmark.clock.live_stamp_s now"):
        assert importlib.import_module("trailmark.pipeline.clock").live_stamp_s is live_stamp_s


LASER, SCANS = "trailmark_laser_maps", "trailmark.geometry.scans"


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        (f"{LASER}.odometry.lines", f"{SCANS}.lines", ("scan_normals",)),
        (f"{LASER}.odometry.things", f"{SCANS}.things", ("few_small_things",)),
        (f"{LASER}.odometry.matching", f"{SCANS}.local_map", ("LocalMap", "LocalMatch")),
        (f"{LASER}.uncertainty", f"{SCANS}.uncertainty", ("errors_in_common", "match_information", "step_information")),
        ("trailmark_omni_surf.laser.following", "trailmark_omni_surf.laser.told_fit", ("told_fit",)),
    ],
)
def test_what_matches_scans_is_found_in_the_plugin_that_had_it(old: str, new: str, names: Sequence[str]) -> None:
    home, before = importlib.import_module(new), importlib.import_module(old)

    for name in names:
        with pytest.warns(DeprecationWarning, match=re.escape(f"{old}.{name} is called {new}.{name} now")):
            assert getattr(before, name) is getattr(home, name)


def test_a_name_that_never_was_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Draver'"):
        importlib.import_module("trailmark.interfaces").Draver


def test_the_sessions_map_is_found_by_its_old_name() -> None:
    session = Session(map=MemoryMap())

    with pytest.warns(DeprecationWarning, match="Session.map"):
        assert session.drawer is session.map


OLD_IMPORTS = """
import sys, warnings
import trailmark.bench
assert "trailmark_bench" not in sys.modules
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    from trailmark.bench import Executor, Index
    from trailmark.bench.executors.local import LocalExecutor
    import trailmark.bench.process
    import trailmark.bench.merge as merge
    from trailmark.bench.process import CellProcess, run_cell
print(*dict.fromkeys(f"{word.filename}: {word.message}" for word in told), sep="\\n")
import trailmark_bench.merge, trailmark_bench.executors.local as local, trailmark.isolation.executor as executor
assert (Executor, Index) == (executor.Executor, trailmark_bench.Index)
assert LocalExecutor is local.LocalExecutor
assert merge is trailmark_bench.merge and merge.__spec__.name == "trailmark_bench.merge"
"""


def test_the_bench_is_found_by_its_old_name_and_says_the_new_one() -> None:
    done = subprocess.run([sys.executable, "-c", OLD_IMPORTS], capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        f"<string>: trailmark.bench.{old} now"
        for old in (
            "Executor is called trailmark_bench.Executor",
            "Index is called trailmark_bench.Index",
            "executors is called trailmark_bench.executors",
            "executors.local is called trailmark_bench.executors.local",
            "process is called trailmark_bench.process",
            "merge is called trailmark_bench.merge",
        )
    ] + ["<string>: trailmark_bench.process.CellProcess is called IsolatedProcess now"]


def test_a_module_that_the_bench_never_had_is_an_import_error() -> None:
    with (
        pytest.raises(ModuleNotFoundError, match=r"trailmark_bench\.grid"),
        pytest.warns(DeprecationWarning, match="called trailmark_bench"),
    ):
        importlib.import_module("trailmark.bench.grid")
