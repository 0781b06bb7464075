"""``trailmark schema``: the JSON schema of configs."""

from __future__ import annotations

import json

import click

from trailmark.cli.root import command_of_plugin, plugins_of

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

    if is_bench:
        context.invoke(command_of_plugin(context, "bench", "schema"))
    else:
        click.echo(json.dumps(run_config_schema(plugins_of(context)), indent=1, ensure_ascii=False))
