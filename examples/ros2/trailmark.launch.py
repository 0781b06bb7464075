"""Trailmark beside a robot's own nodes: a program as any other, started and ended by `ros2 launch`.

    ros2 launch ./trailmark.launch.py config:=robot.yaml mode:=replay store:=place.trail set:="sources.robot.domain=7"

At its end launch sends SIGINT, and the run stops the robot, writes what is known, and ends; it gets 10 s for that
before SIGTERM. Nothing of ROS is imported by Trailmark, which may live in an environment of its own: `program`.

It was tested with a stand-in for `launch`, and not run by `ros2 launch`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

#: Name, default and meaning of each argument.
ARGUMENTS = (
    ("config", "robot.yaml", "The run's config."),
    ("mode", "track", "track, teach or replay."),
    ("store", "", "Path store of teach and replay."),
    ("out", "", "Folder of the run's results; empty: a new one under runs/."),
    ("set", "", "Keys of the config that differ, separated by spaces: KEY=VALUE KEY=VALUE."),
    ("program", "trailmark", "The program, or its path in another environment."),
)
#: What `trailmark` calls each mode.
COMMANDS = {"track": "run", "teach": "teach", "replay": "replay"}


def _run(context):
    """Return the process that the arguments ask for."""
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    line = [given["program"], COMMANDS[given["mode"]], given["config"], "--no-report"]
    for name in ("store", "out"):
        if given[name]:
            line += [f"--{name}", given[name]]
    for setting in given["set"].split():
        line += ["--set", setting]
    return [ExecuteProcess(cmd=line, name="trailmark", output="screen", sigterm_timeout="10", sigkill_timeout="5")]


def generate_launch_description():
    """Return what is launched."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning) for name, default, meaning in ARGUMENTS
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_run)])
