"""What every follower of a taught path needs at its start."""

from __future__ import annotations

from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path

__all__ = ["starts_in_reverse", "taught_path"]


def taught_path(session: Session, name: str) -> Path:
    """Return the path of a session.

    Parameters
    ----------
    session : Session
        What the controller is told at its start.
    name : str
        The controller's plugin, for the message.

    Returns
    -------
    Path
        The taught path.

    Raises
    ------
    ConfigError
        If there is no taught path to follow.
    """
    if session.path is None:
        raise ConfigError(f"{name} follows a taught path, but there is none: run 'trailmark replay' with --store")
    return session.path


def starts_in_reverse(path: Path, start_pose: Pose2 | None, reverse: bool | None) -> bool:
    """Return whether a robot drives the path from its end to its beginning.

    Parameters
    ----------
    path : Path
        The taught path.
    start_pose : Pose2 or None
        ``pose_map_base`` at the start; None where it is unknown, and the path begins at its first waypoint.
    reverse : bool or None
        What the config says; None: the end at which the robot stands decides.

    Returns
    -------
    bool
        True if the first leg leads back.
    """
    if reverse is not None:
        return reverse
    if start_pose is None:
        return False
    first, last = path[0].pose_map_base, path[len(path) - 1].pose_map_base
    return start_pose.distance_to(last) < start_pose.distance_to(first)
