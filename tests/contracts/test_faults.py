"""Every fault that comes with Trailmark passes the checks that the authors of others are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trailmark.plugins import load_plugins
from trailmark.testing import fault_checks
from trailmark.testing.checks.parametrize import parametrize

REGISTRY = load_plugins().registry
BUILT_IN = {spec.name for spec in REGISTRY.specs("fault") if spec.distribution == "trailmark"}

#: The keys with which each does something within the first second; the others do it by default.
KEYS: dict[str, dict[str, Any]] = {
    "basic": {
        "noise": 5.0,
        "blur_px": 1.0,
        "flicker": 0.1,
        "speckle": 0.02,
        "range_noise_m": 0.02,
        "occluders": {},
        "dropped": 0.2,
        "late_s": 0.03,
        "wrong": {"yaw_deg": 1.0},
    },
    "cover": {"contrast": 10.0, "leak": 0.2, "from_s": 0.05},
    "frozen": {"from_s": 0.05, "to_s": 0.2},
    "glints": {"twinkle": 0.5},
    "lens_marks": {"kinds": ["specks", "scratches", "drops"], "share": 0.05},
    "mains": {"readout_ms": 20.0},
    "repeated": {"share": 0.5},
}


def all_checks() -> dict[str, Callable[[], None]]:
    found: dict[str, Callable[[], None]] = {}
    for name in sorted(BUILT_IN):
        spec = REGISTRY.find("fault", name)
        checks = fault_checks(spec.load(), spec.load_config().model_validate(KEYS.get(name, {})))
        found |= {f"{name}-{check}": call for check, call in checks.items()}
    return found


def test_keys_are_of_faults_that_there_are() -> None:
    assert KEYS.keys() <= BUILT_IN


@parametrize(all_checks())
def test_contract(check: Callable[[], None]) -> None:
    check()
