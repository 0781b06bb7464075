"""``trailmark schema``: the JSON schema of configs."""

from __future__ import annotations

import json

import click

from trailmark.cli.root import plugins_of

__all__ = ["schema_command"]


@click.command("schema")
@click.option("--bench", "is_bench", is_flag=True, help="Of bench configs.")
@click.pass_context
def schema_command(context: click.Context, is_bench: bool) -> None:
    """Print the JSON schema of configs with everything that is installed.

    \b
    Editors then complete and check configs:
      trailmark schema > trailmark.schema.json
    and, as the first line of a config:
      # yaml-language-server: $schema=./trailmark.schema.json
    """
    from trailmark.config.schema import run_config_schema

    schema = run_config_schema(plugins_of(context))
    if is_bench:
        from trailmark.bench.config import BenchSection

        section = BenchSection.model_json_schema(by_alias=True)
        schema["$defs"] |= section.pop("$defs")
        schema["properties"]["bench"] = section
        schema |= {"title": "Trailmark bench", "required": ["bench"]}
    click.echo(json.dumps(schema, indent=1, ensure_ascii=False))
