"""``trailmark schema``: the JSON schema of configs."""

from __future__ import annotations

import json

import click

from trailmark.cli.root import plugins_of

__all__ = ["schema_command"]


@click.command("schema")
@click.pass_context
def schema_command(context: click.Context) -> None:
    """Print the JSON schema of configs with everything that is installed.

    \b
    Editors then complete and check configs:
      trailmark schema > trailmark.schema.json
    and, as the first line of a config:
      # yaml-language-server: $schema=./trailmark.schema.json
    """
    from trailmark.config.schema import run_config_schema

    click.echo(json.dumps(run_config_schema(plugins_of(context)), indent=1, ensure_ascii=False))
