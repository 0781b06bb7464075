"""Hooks of the bench."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the executors that come with Trailmark."""
    registry.executor(
        "local",
        "trailmark_bench.executors.local:LocalExecutor",
        config="trailmark_bench.executors.config:LocalConfig",
        summary="Bench cells as processes of this machine",
    )
    registry.executor(
        "dask",
        "trailmark_bench.executors.dask:DaskExecutor",
        config="trailmark_bench.executors.config:DaskConfig",
        summary="Bench cells on the workers of a Dask cluster",
        reference="Rocklin 2015",
        extra="dask",
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark bench`."""
    from trailmark_bench.cli.commands import bench_group

    group.add_command(bench_group)
