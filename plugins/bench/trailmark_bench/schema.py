"""The JSON schema of bench configs, for editors."""

from __future__ import annotations

from typing import Any

from trailmark.config.schema import run_config_schema
from trailmark.plugins import Plugins
from trailmark_bench.config import BenchSection

__all__ = ["bench_config_schema"]


def bench_config_schema(plugins: Plugins) -> dict[str, Any]:
    """Return the schema of a run config with everything that is installed, and with the section ``bench``."""
    schema = run_config_schema(plugins)
    section = BenchSection.model_json_schema(by_alias=True)
    schema["$defs"] |= section.pop("$defs")
    schema["properties"]["bench"] = section
    return schema | {"title": "Trailmark bench", "required": ["bench"]}
