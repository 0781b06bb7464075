"""``trailmark ros2``: a simulated robot behind topics, and tasks by a topic. What is heavy is imported on use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from trailmark.errors import ConfigError

if TYPE_CHECKING:
    from trailmark_ros2.dds import Network

__all__ = ["ros2"]


@click.group("ros2")
def ros2() -> None:
    """Live ROS 2: a simulated robot to try with, and teach, replay and stop by a topic."""


def _network_options(command: Any) -> Any:
    domain = click.option("--domain", type=click.IntRange(0, 232), help="Domain of ROS; default: ROS_DOMAIN_ID, or 0.")
    where = "Name or address of a network interface; everybody on that network needs no password."
    interface = click.option("--interface", default="loopback", show_default=True, help=where)
    return domain(interface(command))


def _network(domain: int | None, interface: str) -> Network:
    try:
        from trailmark_ros2 import dds
    except ModuleNotFoundError as error:
        raise ConfigError(f"{error.name} is missing: pip install 'trailmark[ros2]'") from error
    return dds.Network(dds.default_domain() if domain is None else domain, interface)


@ros2.command("robot")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--mode", type=click.Choice(["teach", "replay"]), default="replay", show_default=True)
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@click.option("--command", default="/cmd_vel", show_default=True, help="Topic of the Twists that drive it.")
@click.option("--pace", default=1.0, show_default=True, help="Seconds of the robot in one second.")
@click.option("--wait", "wait_s", default=60.0, show_default=True, help="How long to wait for readers [s].")
@click.option("--truth", type=click.Path(path_type=Path, dir_okay=False), help="Write where it truly was, as TUM.")
@_network_options
@click.pass_context
def robot_command(
    context: click.Context,
    /,
    config: Path,
    mode: Literal["teach", "replay"],
    settings: tuple[str, ...],
    truth: Path | None,
    **asked: Any,
) -> None:
    """Be the robot: send what the source of CONFIG senses, and follow /cmd_vel.

    In teach a simulated robot drives its route, in replay it follows commands. Sensors are sent as /NAME/image_raw,
    /NAME/odom, /NAME/scan and /NAME/imu; others are not. It stands until somebody reads every topic.
    """
    from trailmark.cli.root import plugins_of
    from trailmark.config import load_run_config
    from trailmark.geometry import write_tum
    from trailmark.interfaces import Session
    from trailmark.pipeline.lifecycle import part_rng

    network = _network(asked["domain"], asked["interface"])
    from trailmark_ros2.robot_node import RobotNode

    run = load_run_config(config, plugins=plugins_of(context), overrides=settings)
    if len(run.sources) != 1:
        raise ConfigError(f"{config}: 'ros2 robot' takes a config with one source, not {len(run.sources)}")
    name, entry = next(iter(run.sources.items()))
    source = entry.construct()
    source.start(Session(name=name, mode=mode, rng=part_rng(run.settings.seed, "source", name)))
    try:
        node = RobotNode(network, source, command=asked["command"], pace=asked["pace"])
        click.echo(f"{', '.join(node.topics.values())}; commands: {asked['command']}")
        if not node.run(asked["wait_s"]):
            raise ConfigError(f"nobody has read {', '.join(node.topics.values())} for {asked['wait_s']:g} s")
    finally:
        found = source.ground_truth()
        if truth is not None and found is not None and len(found):
            write_tum(truth, found)
        source.close()
        network.close()
    for counter, n in source.counters().items():
        click.echo(f"{counter}: {n}")


@ros2.command("serve")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--store", type=click.Path(path_type=Path), required=True, help="The path store: written and followed.")
@click.option("--task", default="/trailmark/task", show_default=True, help="Topic of std_msgs/String: what to do.")
@click.option("--state", default="/trailmark/state", show_default=True, help="Topic of std_msgs/String: what is done.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override a key of the config.")
@_network_options
def serve_command(config: Path, store: Path, task: str, state: str, settings: tuple[str, ...], **asked: Any) -> None:
    """Teach, replay and stop as a topic says.

    `teach` replaces the path in the store, `replay` follows it, `stop` ends either and stops the robot. Whoever reaches
    the domain can say so.
    """
    network = _network(asked["domain"], asked["interface"])
    from trailmark.isolation.tasks import Task, task_command
    from trailmark_ros2.tasks import TaskServer

    def command_of(name: Task) -> list[str]:
        return task_command(name, config, store, settings=settings, extra=["--no-report"])

    try:
        TaskServer(network, task=task, state=state, command_of=command_of).serve()
    finally:
        network.close()
