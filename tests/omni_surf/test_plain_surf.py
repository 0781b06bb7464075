"""SURF alone, as the experiments compare it."""

from __future__ import annotations

from typing import Any

from trailmark.estimates import Belief, Fix, Lost
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_papers.tasaki2010.plain_surf import PlainSurf


def test_plain_surf_answers_and_removes_nothing(omni: Any) -> None:
    room = omni.room()
    config = OmniSurfConfig.model_validate({"camera": "omni"})
    localizer_map = omni.taught(room, config)
    plain = PlainSurf(config)
    plain.start(Session("plain", "replay", {"omni": room.sensor()}, map=localizer_map))
    true = Pose2(0.4, -0.3, 1.0)

    (fix,) = plain.observe(omni.frame(room.render(true), 0.0), Belief(0.0))
    (lost,) = plain.observe(omni.frame(room.render(true) // 255, 1.0), Belief(1.0))

    assert isinstance(fix, Fix)
    assert fix.pose_map_base.distance_to(true) < 2.0
    assert isinstance(lost, Lost)
