"""A stranger's plugin: a sensor that tells its own steps, and a localizer that makes motions of base of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from trailmark import hookimpl
from trailmark.config import ExistingFile, PluginConfig, Sensor, SourceConfig
from trailmark.estimates import Belief, Estimate, Motion, information_from_sigmas
from trailmark.frames import Frame, Record, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Localizer, Session


class StepsConfig(SourceConfig):
    """A table of steps."""

    path: ExistingFile
    """Rows of from, to, x, y, theta, as ``.npy``."""


class Steps(FrameSource):
    """Plays the table."""

    def start(self, session: Session) -> None:
        self._name = session.name
        self._rows = np.load(self.config.path)

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {self._name: SensorInfo(self._name, "steps")}

    def frames(self) -> Iterator[Frame]:
        for row in self._rows:
            yield Frame(self._name, float(row[1]), Record({"step": row}))


class StepperConfig(PluginConfig):
    """Which sensor."""

    steps: Sensor["steps"]
    """The sensor."""


class Stepper(Localizer):
    """Tells how base moved, by the place where the sensor is believed to sit."""

    def start(self, session: Session) -> None:
        pose = session.sensors[self.config.steps].pose_base_sensor
        self._mounting = Pose2(pose.x, pose.y, pose.yaw)

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        since_s, stamp_s, *step = frame.payload.arrays["step"].tolist()
        of_base = self._mounting @ Pose2(*step) @ self._mounting.inverse()
        since_s += frame.stamp_s - stamp_s
        return (Motion(since_s, frame.stamp_s, of_base, information_from_sigmas(0.003, 0.003, 0.002)),)


@hookimpl
def trailmark_register(registry) -> None:
    here = __name__
    registry.source("steps", f"{here}:Steps", config=f"{here}:StepsConfig", summary="Steps of a table")
    registry.localizer(
        "stepper", f"{here}:Stepper", config=f"{here}:StepperConfig", summary="Steps as motion", gives=("motion",)
    )
