"""Every controller, estimator, store and sink that comes with Trailmark passes the checks that others are given."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from trailmark.config import PluginConfig
from trailmark.plugins import load_plugins
from trailmark.stores import SqliteStoreConfig
from trailmark.testing import controller_checks, estimator_checks, sink_checks, store_checks
from trailmark.testing.checks.parametrize import parametrize

REGISTRY = load_plugins().registry
OUT = Path(tempfile.gettempdir())

#: The keys that each part's config needs.
CONTROLLERS: dict[str, dict[str, Any]] = {
    "drift_steering": {},
    "goal_seeking": {"goal": [2.363, 0.537], "way": "straight"},
    "path_tracking": {},
    "path_tracking_4ws": {},
}
ESTIMATORS: dict[str, dict[str, Any]] = {"dead_reckoning": {}, "kalman": {}, "smoother": {}}
SINKS: dict[str, dict[str, Any]] = {"jsonl": {"to": str(OUT / "contract.jsonl"), "estimates": True}}
if find_spec("foxglove") is not None:  # an extra
    SINKS["foxglove"] = {"path": str(OUT / "contract.mcap")}
if find_spec("rerun") is not None:  # an extra
    SINKS["rerun"] = {"path": str(OUT / "contract.rrd")}
if find_spec("cyclonedds") is not None and find_spec("rosbags") is not None:  # an extra
    SINKS["ros2"] = {"domain": 101}

#: What is known not to pass, and why.
EXPECTED_FAILURES = {
    "drift_steering-stands_while_lost": "it drives on slowly for as far as `search_m` says, to be found again",
}


def built_in(kind: str) -> set[str]:
    return {spec.name for spec in REGISTRY.specs(kind) if spec.distribution == "trailmark"}


def config_of(kind: str, name: str, keys: dict[str, Any]) -> PluginConfig:
    return REGISTRY.find(kind, name).load_config().model_validate(keys)


def all_checks() -> dict[str, Callable[[], None]]:
    found: dict[str, Callable[[], None]] = {}
    for kind, cases, checks_of in (
        ("controller", CONTROLLERS, controller_checks),
        ("estimator", ESTIMATORS, estimator_checks),
        ("sink", SINKS, sink_checks),
    ):
        for name, keys in cases.items():
            checks = checks_of(REGISTRY.find(kind, name).load(), config_of(kind, name, keys))  # type: ignore[operator]
            found |= {f"{name}-{check}": call for check, call in checks.items()}
    store = REGISTRY.find("path_store", "sqlite").load()
    checks = store_checks(store, lambda file, access: SqliteStoreConfig(path=str(file), access=access))
    return found | {f"sqlite-{check}": call for check, call in checks.items()}


def test_every_built_in_is_checked() -> None:
    assert CONTROLLERS.keys() == built_in("controller")
    assert ESTIMATORS.keys() == built_in("estimator")
    assert SINKS.keys() | {"foxglove", "rerun", "ros2"} == built_in("sink")
    assert {"sqlite"} == built_in("path_store")


@parametrize(all_checks(), EXPECTED_FAILURES)
def test_contract(check: Callable[[], None]) -> None:
    check()
