"""Configs of the live source and of the sink."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from trailmark.config import LiveSourceConfig, PluginConfig

__all__ = ["ColourDepthTopics", "NetworkConfig", "Ros2SinkConfig", "Ros2SourceConfig", "TopicOptions"]


class NetworkConfig(PluginConfig):
    """Which network of ROS 2."""

    domain: int | None = Field(None, ge=0, le=232)
    """Domain of ROS; left out: that of the environment variable ROS_DOMAIN_ID, else 0."""
    interface: str = "loopback"
    """`loopback`: programs of this machine alone. The name or address of a network interface (`eth0`, `10.0.0.7`) opens
    it to everybody on that network, who need no password."""

    @field_validator("interface")
    @classmethod
    def _one_word(cls, interface: str) -> str:
        if not interface or any(letter in interface for letter in "<>\"' \n"):
            raise ValueError(f"{interface!r} is neither loopback nor the name or address of a network interface")
        return interface


class TopicOptions(PluginConfig):
    """One topic, and how it is read."""

    topic: str
    """The topic: `/scan`."""
    type: str | None = None
    """Type of its messages, such as `sensor_msgs/msg/LaserScan`; left out: as its first writer says."""
    height_m: tuple[float, float] = (-0.05, 0.05)
    """Of a PointCloud2: points between these heights, in the sensor's own axes, become the scan [m]."""
    angle_step_deg: float = Field(default=0.5, gt=0, le=10)
    """Of a PointCloud2: angle between the beams of the scan [deg]."""
    odom_frame: str = "odom"
    """Of /tf: the transform from this frame ..."""
    base_frame: str = "base_link"
    """... to this one becomes the odometry."""


class ColourDepthTopics(PluginConfig):
    """The two topics of one colour-and-depth camera."""

    colour: str
    """Topic of the colour pictures."""
    depth: str
    """Topic of the depth pictures: 16UC1 in millimetres or 32FC1 in metres."""
    max_difference_s: float = Field(0.02, gt=0)
    """Colour and depth farther apart are no pair [s]."""


def _checked_topic(topic: str) -> str:
    if not topic.startswith("/") or len(topic) < 2 or any(letter.isspace() for letter in topic):
        raise ValueError(f"{topic!r} is no topic: write it as `ros2 topic list` does, with its slash: /odom")
    return topic


class Ros2SourceConfig(NetworkConfig, LiveSourceConfig):
    """A robot of ROS 2, live; no ROS is needed here."""

    topics: dict[str, str | TopicOptions] = Field(default_factory=dict)
    """Sensors and their topics: `name: /topic`, or `name: {topic: /topic, type: ...}`."""
    rgbd: dict[str, ColourDepthTopics] = Field(default_factory=dict)
    """Colour and depth topics to be paired to one sensor."""
    command: str | None = None
    """Topic that drives the robot (`/cmd_vel`); left out: nothing is ever sent to it."""
    command_type: Literal["twist", "twist_stamped", "ackermann"] = "twist"
    """Twist; TwistStamped, as Nav2 since Kilted; or AckermannDriveStamped."""
    wheelbase_m: float | None = Field(None, gt=0)
    """Of an Ackermann vehicle: distance of its axles; it is then driven by velocities too [m]."""
    watchdog_s: float = Field(0.25, gt=0)
    """The robot is stopped when for so long no command is given, or no message comes from it: zero velocity is on its
    way 0.3 s after a link was lost. A robot whose messages come more seldom needs more [s]."""
    initial_pose: str | None = None
    """Topic on which a person says where the robot is (`/initialpose` of RViz); left out: nobody may."""
    stamps: Literal["header", "receive"] = "header"
    """Stamps of the messages' headers, or when they came."""
    max_offset_s: float = Field(1.0, gt=0)
    """Header stamps that differ more from the time at which the messages come are warned of [s]."""
    base_frame: str = "base_link"
    """Name of base in `tf_static`, which tells where sensors sit; `sensors:` of the config overrides it."""
    map_frame: str = "map"
    """Name of the map in `initial_pose`: a pose that is told in another frame is left alone, as AMCL does. The
    sink has a `map_frame` of its own, which is to be the same."""
    tf_static: str = "/tf_static"
    """Topic of the transforms that never change: `/robot1/tf_static` of a robot in a namespace."""
    start_timeout_s: float = Field(30.0, gt=0)
    """How long to wait at the start for every topic [s]."""
    silence_s: float = Field(5.0, gt=0)
    """A topic without a message for so long is warned of, with the likely reason [s]."""
    on_bad_frame: Literal["error", "skip"] = "skip"
    """A message that cannot be used: counted and skipped, for one from the network may be anything, or ends the run."""
    end_when_silent_s: float | None = Field(None, gt=0)
    """End the run when no topic has a message for so long; left out: wait for ever [s]."""

    @model_validator(mode="after")
    def _names_fit(self) -> Self:
        if not self.topics and not self.rgbd:
            raise ValueError("name a topic, as topics: {wheels: /odom}; `trailmark inspect ros2://0` lists them")
        twice = sorted(self.topics.keys() & self.rgbd.keys())
        if twice:
            raise ValueError(f"{', '.join(twice)} stands in topics and in rgbd")
        named = [options.topic if isinstance(options, TopicOptions) else options for options in self.topics.values()]
        named += [topic for pair in self.rgbd.values() for topic in (pair.colour, pair.depth)]
        named += [topic for topic in (self.command, self.initial_pose, self.tf_static) if topic is not None]
        for topic in named:
            _checked_topic(topic)
        if self.wheelbase_m is not None and self.command_type != "ackermann":
            raise ValueError(f"wheelbase_m is of command_type: ackermann, not of {self.command_type}")
        return self

    def options_of(self, sensor: str) -> TopicOptions:
        """Return the options of a sensor's topic."""
        options = self.topics[sensor]
        return TopicOptions(topic=options) if isinstance(options, str) else options


class Ros2SinkConfig(NetworkConfig):
    """Beliefs for ROS 2: what Nav2 and RViz want of a localizer."""

    odometry: str | None = "/trailmark/odometry"
    """Topic of nav_msgs/Odometry: pose in the map with covariance, velocity; null: none."""
    pose: str | None = "/trailmark/pose"
    """Topic of geometry_msgs/PoseWithCovarianceStamped; null: none."""
    path: str | None = "/trailmark/path"
    """Topic of nav_msgs/Path: the way so far; null: none."""
    taught_path: str | None = "/trailmark/taught_path"
    """Topic of nav_msgs/Path: the path that was taught, sent once to whoever comes; null: none."""
    diagnostics: str | None = "/diagnostics"
    """Topic of diagnostic_msgs/DiagnosticArray, once a second; null: none."""
    tf: Literal["map_odom", "map_base", "none"] = "map_odom"
    """What goes to /tf: map to odom, which completes the robot's own odom to base; map to base, for a robot whose
    odometry sends no transforms; or nothing."""
    tf_topic: str = "/tf"
    """Topic of transforms: `/robot1/tf` of a robot in a namespace."""
    odom: str = "/odom"
    """For `tf: map_odom`: topic of the robot's own odometry."""
    map_frame: str = "map"
    """Name of the map."""
    odom_frame: str | None = None
    """Name of the odometry's frame; left out: as its messages say."""
    base_frame: str = "base_link"
    """Name of base."""
    transform_tolerance_s: float = Field(1.0, ge=0)
    """Transforms are stamped so far ahead, that others find one for now; as AMCL does [s]."""
    path_spacing_m: float = Field(0.05, gt=0)
    """The way so far gets a pose after this distance [m]."""
    tf_while_lost: bool = False
    """Send transforms, poses and odometry also while the robot is lost."""

    @model_validator(mode="after")
    def _topics_are_topics(self) -> Self:
        topics = (self.odometry, self.pose, self.path, self.taught_path, self.diagnostics, self.odom, self.tf_topic)
        for topic in topics:
            if topic is not None:
                _checked_topic(topic)
        return self
